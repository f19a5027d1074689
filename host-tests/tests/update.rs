//! Updates of the real firmware in QEMU by the real bootloader: a signed image runs after the restart, and remains once it has
//! confirmed itself. After an image that is refused or fails, the previous one runs, also where power fails at any moment.
//!
//! A newer image in these tests is the same firmware with another version in its header, which is the version that it reports.

mod common;

use client::{Client, Error, Framed};
use common::{firmware, synthetic_walk};
use emulation::ACTIVE_IMAGE;
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Looped, Recorded, Time};
use firmware_image::{Image, SigningKey, development_key, flash_image};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
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

fn signed(mut bytes: Vec<u8>, header: &Header, secret: &SigningKey) -> Image {
    let header = header.bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, secret).expect("the image has a header")
}

fn development() -> SigningKey {
    development_key().expect("the development key")
}

/// The firmware with a newer version.
fn newer(firmware: &Path) -> Image {
    signed(flash_image(firmware).expect("the firmware is built"), &Header::new(BOARD, NEW), &development())
}

/// A short image that does not run.
fn broken(version: &str) -> Image {
    signed(vec![0xff; 20 * CHUNK], &Header::new(BOARD, version), &development())
}

/// An insole with one flash chip, which is switched on and off.
struct Insole {
    firmware: PathBuf,
    flash: Option<Vec<u8>>,
}

impl Insole {
    fn new() -> Self {
        Self { firmware: firmware(), flash: None }
    }

    fn start(&self, power_cut: Option<u32>, swapped: bool) -> Board {
        let walk = synthetic_walk(2, 100.0);
        let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::WALKING);
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

    /// Waits until the board is off, and saves its chip; returns true if the bootloader swapped images and requests a restart.
    fn wait(&mut self, mut board: Board) -> bool {
        let swapped = board.wait().expect("the board runs");
        self.flash = Some(board.flash().expect("the chip can be read"));
        swapped
    }

    /// Switches the board off at any moment, and saves its chip.
    fn switch_off(&mut self, board: Board) {
        self.flash = Some(board.flash().expect("the chip can be read"));
    }

    /// The content of the active image's area.
    fn active(&self) -> &[u8] {
        let flash = self.flash.as_ref().expect("a board ran");
        &flash[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize]
    }
}

fn connect(board: &Board) -> Session {
    try_connect(board).expect("the insole answers")
}

/// A session; `None` where the board switches off instead.
fn try_connect(board: &Board) -> Option<Session> {
    let link = board.link().expect("the board has a link");
    link.set_read_timeout(Some(Duration::from_millis(50))).expect("the socket accepts a timeout");
    Client::connect(Framed::new(link), START_TIMEOUT).ok()
}

fn send(session: &mut Session, image: &Image) -> Result<Progress, Error> {
    session.update(Request::Begin(image.offer()))?;
    for number in 0..image.offer().chunks {
        session.update(Request::Chunk { number, chunk: image.chunk(number) })?;
    }
    session.update(Request::Finish)
}

fn refusal(answer: Result<Progress, Error>) -> Option<Refusal> {
    match answer {
        Err(Error::Refused(protocol::Refusal::Update(refusal))) => Some(refusal),
        _ => None,
    }
}

/// Writes an accepted image to an insole's chip, with the insole's own code.
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
    assert!(insole.wait(board), "the insole restarts by itself, and the bootloader swaps");
    assert!(insole.active().starts_with(image.bytes()));

    let board = insole.start(None, true);
    let mut session = connect(&board);
    assert_eq!(session.hello().firmware, NEW);
    let again = Request::Begin(image.offer());
    assert_eq!(refusal(session.update(again)), Some(Refusal::OnTrial), "the image has not scanned yet");
    board.play();
    while refusal(session.update(again)) == Some(Refusal::OnTrial) {}
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
    assert!(insole.wait(board), "the bootloader swaps back");
    let board = insole.start(None, true);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_signed_image_that_crashes_is_swapped_back() {
    let mut insole = Insole::new();
    let board = insole.start(None, false);
    assert_eq!(send(&mut connect(&board), &broken(NEW)).ok(), Some(Progress::Accepted));
    assert!(insole.wait(board));
    assert!(insole.active().starts_with(broken(NEW).bytes()));
    let board = insole.start(None, true);
    assert!(!insole.wait(board), "the image crashes");
    let board = insole.start(None, false);
    assert!(insole.wait(board), "the bootloader swaps back");
    let board = insole.start(None, true);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn invalid_images_are_refused_and_the_running_image_remains() {
    let mut insole = Insole::new();
    let board = insole.start(None, false);
    let mut session = connect(&board);
    let good = broken(NEW);
    let offer = good.offer();
    let other_key = signed(good.bytes().to_vec(), good.header(), &SigningKey::from_bytes(&[1; 32]));
    let older = broken("0.0.9");
    let other_board = signed(good.bytes().to_vec(), &Header::new("stm32wb55", NEW), &development());
    for (image, why) in [(&other_key, Refusal::Signature), (&older, Refusal::Older), (&other_board, Refusal::Board)] {
        assert_eq!(refusal(send(&mut session, image)), Some(why));
    }
    let mut unsigned = offer;
    unsigned.signature = Default::default();
    let mut short = offer;
    short.chunks -= 1;
    for (offer, flipped, why) in [
        (unsigned, None, Refusal::Signature),
        (short, None, Refusal::Signature),
        (offer, Some(5), Refusal::Signature),
        (offer, Some(HEADER as usize / CHUNK), Refusal::Header),
    ] {
        session.update(Request::Begin(offer)).expect("the image is not yet verified");
        for number in 0..offer.chunks {
            let mut chunk = good.chunk(number);
            if flipped == Some(usize::from(number)) {
                chunk[0][0] ^= 0x10;
            }
            session.update(Request::Chunk { number, chunk }).expect("the image is not yet verified");
        }
        assert_eq!(refusal(session.update(Request::Finish)), Some(why));
    }
    let mut long = offer;
    long.chunks = u16::MAX;
    assert_eq!(refusal(session.update(Request::Begin(long))), Some(Refusal::Length));
    // An incomplete update is refused.
    session.update(Request::Begin(offer)).expect("the request is accepted");
    session.update(Request::Chunk { number: 0, chunk: good.chunk(0) }).expect("the request is accepted");
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
    let image = broken(NEW);
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
        // The mark to swap may be written although its answer did not arrive.
        let board = insole.start(None, false);
        match try_connect(&board) {
            Some(session) => assert_eq!(session.hello().firmware, OLD, "cut {cuts}"),
            None => {
                assert!(insole.wait(board), "cut {cuts}");
                assert!(insole.active().starts_with(image.bytes()), "cut {cuts}");
            }
        }
        cuts += 1;
    }
    println!("{cuts} cuts");
}

/// Write and erase operations of a swap from one tested power cut to the next.
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
        assert!(insole.wait(board), "cut {cut}");
        assert!(insole.active().starts_with(image.bytes()), "cut {cut}");
        let board = insole.start(None, true);
        assert_eq!(connect(&board).hello().firmware, NEW, "cut {cut}");
        cuts += 1;
    }
    println!("{cuts} cuts");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_loss_of_power_during_the_swap_back_ends_in_the_old_image() {
    let mut insole = Insole::new();
    accept(&mut insole, &broken(NEW));
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
        assert!(is_swapped, "cut {cut}");
        let board = insole.start(None, is_swapped);
        assert_eq!(connect(&board).hello().firmware, OLD, "cut {cut}");
        cuts += 1;
    }
    println!("{cuts} cuts");
}
