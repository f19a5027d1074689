//! Updates of the real firmware in QEMU by the real bootloader. A signed image runs after the restart, and remains active once it
//! has confirmed itself. If an image is refused or fails, the previous one runs. Both hold if power fails at any moment.
//!
//! The newer image of these tests is the same firmware with another version in its header. The firmware reports that version.

mod common;

use client::{Client, Error, Framed};
use common::{firmware, synthetic_walk};
use emulation::ACTIVE_IMAGE;
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Looped, Recorded, Time};
use firmware_image::{Image, SigningKey, development_key, flash_image};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::update::{CHUNK, Header, Progress, Refusal, Request};
use plantar::protocol::{self, ToDevice};
use plantar::storage::flash_map::HEADER;
use plantar::storage::update::{KEY, Update};
use recording::VirtualInsole;
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::Duration;
use testkit::nor_flash::NorFlashChip;

const BOARD: &str = "emulated";
const OLD: &str = env!("PLANTAR_VERSION");
const NEW: &str = "99.0.1";
/// Longest time from the start of an insole to its first answer.
const START_TIMEOUT: Duration = Duration::from_secs(20);

type Session = Client<Framed<TcpStream>>;

/// An image of these bytes, with this header and a signature by `secret`.
fn signed(mut bytes: Vec<u8>, header: &Header, secret: &SigningKey) -> Image {
    let header = header.bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, secret).expect("the image has a header")
}

/// The key that signs development images, which the emulated board accepts.
fn development() -> SigningKey {
    development_key().expect("the development key is valid")
}

/// The firmware with a newer version.
fn newer(firmware: &Path) -> Image {
    signed(flash_image(firmware).expect("the firmware is built"), &Header::new(BOARD, NEW), &development())
}

/// A short image with a valid signature that crashes at its start, because it contains no program.
fn crashing_image(version: &str) -> Image {
    signed(vec![0xff; 20 * CHUNK], &Header::new(BOARD, version), &development())
}

/// An insole that is switched on and off. Its flash chip remains the same.
struct Insole {
    /// The firmware file of the first start.
    firmware: PathBuf,
    /// The content of the flash chip while the insole is off; `None` for a new chip.
    flash: Option<Vec<u8>>,
}

impl Insole {
    fn new() -> Self {
        Self { firmware: firmware(), flash: None }
    }

    /// Switches the insole on. With `power_cut`, power fails in the write or erase operation of the chip with this number,
    /// counted from 0. `swapped` is the result of [`Self::wait`] for the start before: true if the active image in the chip is to
    /// run.
    fn start(&self, power_cut: Option<u32>, swapped: bool) -> Board {
        let walk = synthetic_walk(2, 100.0);
        let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let config = EmulatorConfig { power_cut, ..EmulatorConfig::new(virtual_insole.setup) };
        let cells = virtual_insole.cells.clone();
        let hardware = Hardware { flash: self.flash.clone(), swapped, ..Hardware::default() };
        Board::start_with(
            &self.firmware,
            &config,
            &cells,
            Time::Max,
            Looped(Recorded::new(walk, virtual_insole)),
            &hardware,
        )
        .expect("the board boots")
    }

    /// Waits until the board ends by a swap, a crash or a power cut, and saves its chip. Returns true if the bootloader swapped
    /// images, so that the insole must be started again.
    fn wait(&mut self, mut board: Board) -> bool {
        let swapped = board.wait().expect("the board runs");
        self.flash = Some(board.flash().expect("the chip can be read"));
        swapped
    }

    /// Switches the board off now, and saves its chip.
    fn switch_off(&mut self, board: Board) {
        self.flash = Some(board.flash().expect("the chip can be read"));
    }

    /// The content of the area of the chip with the active image.
    fn active(&self) -> &[u8] {
        let flash = self.flash.as_ref().expect("a board ran");
        &flash[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize]
    }
}

fn connect(board: &Board) -> Session {
    try_connect(board).expect("the insole answers")
}

/// A session; `None` if the board ends before its first answer.
fn try_connect(board: &Board) -> Option<Session> {
    let link = board.link().expect("the board has a link");
    link.set_read_timeout(Some(Duration::from_millis(50))).expect("the socket accepts a timeout");
    Client::connect(Framed::new(link), START_TIMEOUT).ok()
}

/// Transfers a complete image.
fn send(session: &mut Session, image: &Image) -> Result<Progress, Error> {
    session.update(Request::Begin(image.offer()))?;
    for number in 0..image.offer().chunks {
        session.update(Request::Chunk { number, chunk: image.chunk(number) })?;
    }
    session.update(Request::Finish)
}

/// The insole's reason for a refusal; `None` for any other answer.
fn refusal(answer: Result<Progress, Error>) -> Option<Refusal> {
    match answer {
        Err(Error::Refused(protocol::Refusal::Update(refusal))) => Some(refusal),
        _ => None,
    }
}

/// Writes an image to an insole's chip as an accepted update, by the insole's own code. This is faster than a transfer
/// over the link.
fn accept(insole: &mut Insole, image: &Image) {
    let board = insole.start(None, false);
    connect(&board);
    insole.switch_off(board);
    let flash = insole.flash.take().expect("a board ran");
    let mut chip = NorFlashChip::new(flash.len());
    chip.bytes = flash;
    let mut update = Update::new();
    let chunks = (0..image.offer().chunks).map(|number| Request::Chunk { number, chunk: image.chunk(number) });
    for request in [Request::Begin(image.offer())].into_iter().chain(chunks).chain([Request::Finish]) {
        let running = Header::new(BOARD, OLD);
        embassy_futures::block_on(update.handle(&mut chip, &running, &KEY, &request)).expect("the request is accepted");
    }
    insole.flash = Some(chip.bytes);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_update_runs_after_the_restart_and_remains_once_it_is_confirmed() {
    let mut insole = Insole::new();
    let image = newer(&insole.firmware);
    let board = insole.start(None, false);
    let mut session = connect(&board);
    assert_eq!((session.hello().firmware.as_str(), session.hello().board.as_str()), (OLD, BOARD));
    assert_eq!(send(&mut session, &image).ok(), Some(Progress::Accepted));
    assert!(insole.wait(board), "the bootloader must swap the images after the insole's own restart");
    assert!(insole.active().starts_with(image.bytes()));

    let board = insole.start(None, true);
    let mut session = connect(&board);
    assert_eq!(session.hello().firmware, NEW);
    let again = Request::Begin(image.offer());
    assert_eq!(refusal(session.update(again)), Some(Refusal::OnTrial), "an image is on trial until it has scanned");
    board.play();
    while refusal(session.update(Request::Confirm)) == Some(Refusal::OnTrial) {}
    // An older image is refused now, including the previous one.
    let previous = flash_image(&insole.firmware).expect("the firmware is built");
    let previous = signed(previous, &Header::new(BOARD, OLD), &development());
    assert_eq!(refusal(session.update(Request::Begin(previous.offer()))), Some(Refusal::Older));
    insole.switch_off(board);

    let board = insole.start(None, false);
    assert_eq!(connect(&board).hello().firmware, NEW);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_image_that_makes_no_progress_is_swapped_back_at_the_next_start() {
    let mut insole = Insole::new();
    let image = newer(&insole.firmware);
    accept(&mut insole, &image);
    let board = insole.start(None, false);
    assert!(insole.wait(board));
    // Without `play` the new image cannot scan, so it does not confirm itself.
    let board = insole.start(None, true);
    let mut session = connect(&board);
    assert_eq!(session.hello().firmware, NEW);
    session.send(ToDevice::Restart).expect("the link works");
    assert!(insole.wait(board), "the bootloader must swap back");
    let board = insole.start(None, true);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_signed_image_that_crashes_is_swapped_back() {
    let mut insole = Insole::new();
    let board = insole.start(None, false);
    assert_eq!(send(&mut connect(&board), &crashing_image(NEW)).ok(), Some(Progress::Accepted));
    assert!(insole.wait(board));
    assert!(insole.active().starts_with(crashing_image(NEW).bytes()));
    let board = insole.start(None, true);
    assert!(!insole.wait(board), "the image must crash, and not be swapped");
    let board = insole.start(None, false);
    assert!(insole.wait(board), "the bootloader must swap back");
    let board = insole.start(None, true);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn invalid_images_are_refused_and_the_running_image_remains() {
    let mut insole = Insole::new();
    let board = insole.start(None, false);
    let mut session = connect(&board);
    let signed_image = crashing_image(NEW);
    let offer = signed_image.offer();
    let other_key = signed(signed_image.bytes().to_vec(), signed_image.header(), &SigningKey::from_bytes(&[1; 32]));
    let older = crashing_image("0.0.9");
    let other_board = signed(signed_image.bytes().to_vec(), &Header::new("stm32wb55", NEW), &development());
    for (image, reason) in [(&other_key, Refusal::Signature), (&older, Refusal::Older), (&other_board, Refusal::Board)]
    {
        assert_eq!(refusal(send(&mut session, image)), Some(reason));
    }
    let mut unsigned = offer;
    unsigned.signature = Default::default();
    let mut short = offer;
    short.chunks -= 1;
    // The third and the fourth image have a flipped bit in this chunk.
    for (offer, flipped, reason) in [
        (unsigned, None, Refusal::Signature),
        (short, None, Refusal::Signature),
        (offer, Some(5), Refusal::Signature),
        (offer, Some(HEADER as usize / CHUNK), Refusal::Header),
    ] {
        session.update(Request::Begin(offer)).expect("an image is accepted until it is verified");
        for number in 0..offer.chunks {
            let mut chunk = signed_image.chunk(number);
            if flipped == Some(usize::from(number)) {
                chunk[0][0] ^= 0x10;
            }
            session.update(Request::Chunk { number, chunk }).expect("an image is accepted until it is verified");
        }
        assert_eq!(refusal(session.update(Request::Finish)), Some(reason));
    }
    let mut long = offer;
    long.chunks = u16::MAX;
    assert_eq!(refusal(session.update(Request::Begin(long))), Some(Refusal::Length));
    // A transfer without all of its chunks is refused.
    session.update(Request::Begin(offer)).expect("the request is accepted");
    session.update(Request::Chunk { number: 0, chunk: signed_image.chunk(0) }).expect("the request is accepted");
    assert_eq!(refusal(session.update(Request::Finish)), Some(Refusal::Incomplete));

    assert_eq!(session.reconnect(START_TIMEOUT).expect("the insole answers").firmware, OLD);
    insole.switch_off(board);
    let board = insole.start(None, false);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_loss_of_power_during_the_transfer_leaves_the_running_image() {
    let mut insole = Insole::new();
    let image = crashing_image(NEW);
    let mut cuts = 0;
    loop {
        insole.flash = None;
        let board = insole.start(Some(cuts), false);
        // Power may fail before the first answer.
        let sent = try_connect(&board).map(|mut session| send(&mut session, &image));
        let is_accepted = matches!(sent, Some(Ok(Progress::Accepted)));
        insole.wait(board);
        if is_accepted {
            break;
        }
        // The insole may have marked the image for the swap although its answer did not arrive.
        let board = insole.start(None, false);
        match try_connect(&board) {
            Some(session) => assert_eq!(session.hello().firmware, OLD, "after the cut in operation {cuts}"),
            None => {
                assert!(insole.wait(board), "no swap after the cut in operation {cuts}");
                assert!(insole.active().starts_with(image.bytes()), "after the cut in operation {cuts}");
            }
        }
        cuts += 1;
    }
    println!("{cuts} cuts");
}

/// Number of write and erase operations of a swap from one tested power cut to the next. Testing every operation would take too
/// long in the emulator; the test `swap` does that on a simulated chip.
const STRIDE: usize = 29;

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_loss_of_power_during_the_swap_ends_in_the_new_image() {
    let mut insole = Insole::new();
    let image = newer(&insole.firmware);
    accept(&mut insole, &image);
    let accepted = insole.flash.clone();
    let mut cuts = 0;
    for cut in (0..).step_by(STRIDE) {
        insole.flash = accepted.clone();
        let board = insole.start(Some(cut), false);
        if insole.wait(board) {
            break;
        }
        let board = insole.start(None, false);
        assert!(insole.wait(board), "no swap after the cut in operation {cut}");
        assert!(insole.active().starts_with(image.bytes()), "after the cut in operation {cut}");
        let board = insole.start(None, true);
        assert_eq!(connect(&board).hello().firmware, NEW, "after the cut in operation {cut}");
        cuts += 1;
    }
    println!("{cuts} cuts");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_loss_of_power_during_the_swap_back_ends_in_the_old_image() {
    let mut insole = Insole::new();
    accept(&mut insole, &crashing_image(NEW));
    let board = insole.start(None, false);
    assert!(insole.wait(board));
    let swapped = insole.flash.clone();
    let mut cuts = 0;
    for cut in (0..).step_by(STRIDE) {
        insole.flash = swapped.clone();
        let board = insole.start(Some(cut), false);
        if insole.wait(board) {
            break;
        }
        let board = insole.start(None, false);
        let is_swapped = insole.wait(board);
        assert!(is_swapped, "no swap after the cut in operation {cut}");
        let board = insole.start(None, true);
        assert_eq!(connect(&board).hello().firmware, OLD, "after the cut in operation {cut}");
        cuts += 1;
    }
    println!("{cuts} cuts");
}
