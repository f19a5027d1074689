//! Shared parts of the tests of updates in QEMU: signed images, and an insole that is switched on and off.

use crate::common::{connect, firmware, synthetic_walk};
use emulation::{EmulatorConfig, PlannedFault};
use emulator::{Board, Hardware, Looped, Recorded, Time};
use firmware_image::{Image, SigningKey, development_key, flash_image};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::update::{Header, Request};
use plantar::storage::flash_map::HEADER;
use plantar::storage::update::{KEY, Update};
use recording::VirtualInsole;
use testkit::nor_flash::NorFlashChip;

/// The name of the board in the header of the firmware.
pub const BOARD: &str = "emulated";
/// The version in the header of the firmware.
pub const OLD: &str = env!("PLANTAR_VERSION");

/// The key that signs development images, which the emulated board accepts.
pub fn development() -> SigningKey {
    development_key().expect("the development key is valid")
}

/// An image of these bytes, with this header and a signature by `secret`.
pub fn signed(mut bytes: Vec<u8>, header: &Header, secret: &SigningKey) -> Image {
    let header = header.bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, secret).expect("the image has a header")
}

/// An image of the firmware with another version, signed with `secret`.
pub fn firmware_with(version: &str, secret: &SigningKey) -> Image {
    signed(flash_image(&firmware()).expect("the firmware is built"), &Header::new(BOARD, version), secret)
}

/// An insole that is switched on and off. Its flash chip remains the same.
pub struct Insole {
    /// The content of the flash chip while the insole is off; `None` for a new chip.
    pub flash: Option<Vec<u8>>,
    /// The fault to inject into the firmware; `None` for no fault.
    pub fault: Option<PlannedFault>,
}

impl Insole {
    /// An insole with a new chip.
    pub fn new() -> Self {
        Self { flash: None, fault: None }
    }

    /// Switches the insole on. With `power_cut`, power fails in the write or erase operation of the chip with this number,
    /// counted from 0; the bootloader and the application each count their own operations. `swapped` is the result of
    /// [`Self::wait`] for the previous start: true if the active image in the chip is to run. `hci` is the TCP port of the
    /// simulated Bluetooth controller; `None` for an insole without Bluetooth.
    pub fn start(&self, power_cut: Option<u32>, swapped: bool, hci: Option<u64>) -> Board {
        let walk = synthetic_walk(2, 100.0);
        let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let config = EmulatorConfig { power_cut, fault: self.fault, ..EmulatorConfig::new(virtual_insole.setup) };
        let cells = virtual_insole.cells.clone();
        let hci = hci.map(|port| ([127, 0, 0, 1], port as u16).into());
        let hardware = Hardware { flash: self.flash.clone(), swapped, hci };
        let walk = Looped(Recorded::new(walk, virtual_insole));
        Board::start_with(&firmware(), &config, &cells, Time::Fastest, walk, &hardware).expect("the board boots")
    }

    /// Waits until the board ends by a swap, a crash or a power cut, and saves its chip. Returns true if the bootloader swapped
    /// images, so that the insole must be started again.
    pub fn wait(&mut self, mut board: Board) -> bool {
        let swapped = board.wait().expect("the board runs");
        self.flash = Some(board.flash().expect("the chip can be read"));
        swapped
    }

    /// Switches the board off now, and saves its chip.
    pub fn switch_off(&mut self, board: Board) {
        self.flash = Some(board.flash().expect("the chip can be read"));
    }

    /// Writes an image to the chip as an accepted update, by the insole's own code. This is faster than a transfer over the link.
    pub fn accept(&mut self, image: &Image) {
        let board = self.start(None, false, None);
        connect(&board);
        let mut chip = NorFlashChip::of(board.flash().expect("the chip can be read"));
        let mut update = Update::new();
        let chunks = (0..image.offer().chunks).map(|number| Request::Chunk { number, chunk: image.chunk(number) });
        for request in [Request::Begin(image.offer())].into_iter().chain(chunks).chain([Request::Finish]) {
            let running = Header::new(BOARD, OLD);
            embassy_futures::block_on(update.handle(&mut chip, &running, &KEY, &request))
                .expect("the request is accepted");
        }
        self.flash = Some(chip.bytes);
    }
}
