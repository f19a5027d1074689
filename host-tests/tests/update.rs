//! Updates of the real firmware in QEMU by the real bootloader. A signed image runs after the restart, and remains active once it
//! is confirmed. If an image is refused or fails, the previous one runs. Both hold if power fails at any moment.
//!
//! The newer image of these tests is the same firmware with another version in its header, which the firmware reports, or a
//! short image that crashes.

use crate::common::{TIMEOUT, connect};
use crate::updates::{BOARD, Insole, OLD, development, firmware_with, signed};
use client::{Client, Error, Framed};
use emulation::{ACTIVE_IMAGE, InjectedFault, PlannedFault};
use emulator::{Board, Link};
use firmware_image::{Image, SigningKey};
use plantar::firmware::boot_report::MAX_FAILED_STARTS;
use plantar::protocol::update::{CHUNK, Header, Progress, Refusal, Request};
use plantar::protocol::{self, ToDevice};
use plantar::storage::flash_map::{HEADER, MAX_IMAGE, SECTOR};
use std::time::Duration;

/// Version of the image that is sent.
const NEW: &str = "99.0.1";

type Session = Client<Framed<Link>>;

/// A short image with a valid signature that crashes at its start, because it contains no program.
fn crashing_image(version: &str) -> Image {
    signed(vec![0xff; 20 * CHUNK], &Header::new(BOARD, version), &development())
}

/// The content of the area of an insole's chip with the active image.
fn active(insole: &Insole) -> &[u8] {
    let flash = insole.flash.as_ref().expect("a board ran");
    &flash[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize]
}

/// A session; `None` if the board ends before its first answer.
fn try_connect(board: &Board) -> Option<Session> {
    let mut link = board.link().expect("the board has a link");
    link.set_read_timeout(Some(Duration::from_millis(50))).expect("a timeout");
    Client::connect(Framed::new(link), TIMEOUT).ok()
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

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_update_runs_after_the_restart_and_remains_once_it_is_confirmed() {
    let mut insole = Insole::new();
    let image = firmware_with(NEW, &development());
    let board = insole.start(None, false, None);
    let mut session = connect(&board);
    assert_eq!((session.hello().firmware.as_str(), session.hello().board.as_str()), (OLD, BOARD));
    assert_eq!(send(&mut session, &image).ok(), Some(Progress::Accepted));
    assert!(insole.wait(board), "the bootloader must swap the images after the insole's own restart");
    assert!(active(&insole).starts_with(image.bytes()));

    let board = insole.start(None, true, None);
    let mut session = connect(&board);
    assert_eq!(session.hello().firmware, NEW);
    let again = Request::Begin(image.offer());
    assert_eq!(
        refusal(session.update(again)),
        Some(Refusal::OnTrial),
        "the image is on trial until its checks are complete"
    );
    board.play();
    while refusal(session.update(Request::Confirm)) == Some(Refusal::OnTrial) {}
    // An older image is refused now, including the previous one.
    let previous = firmware_with(OLD, &development());
    assert_eq!(refusal(session.update(Request::Begin(previous.offer()))), Some(Refusal::Older));
    insole.switch_off(board);

    let board = insole.start(None, false, None);
    assert_eq!(connect(&board).hello().firmware, NEW);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_image_that_makes_no_progress_is_swapped_back_at_the_next_start() {
    let mut insole = Insole::new();
    let image = firmware_with(NEW, &development());
    insole.accept(&image);
    let board = insole.start(None, false, None);
    assert!(insole.wait(board));
    // Without `play` the new image cannot scan, so it is not confirmed.
    let board = insole.start(None, true, None);
    let mut session = connect(&board);
    assert_eq!(session.hello().firmware, NEW);
    session.send(ToDevice::Restart).expect("the link works");
    assert!(insole.wait(board), "the bootloader must swap back");
    let board = insole.start(None, true, None);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_signed_image_that_crashes_is_swapped_back() {
    let mut insole = Insole::new();
    let board = insole.start(None, false, None);
    assert_eq!(send(&mut connect(&board), &crashing_image(NEW)).ok(), Some(Progress::Accepted));
    assert!(insole.wait(board));
    assert!(active(&insole).starts_with(crashing_image(NEW).bytes()));
    let board = insole.start(None, true, None);
    assert!(!insole.wait(board), "the image must crash, and not be swapped");
    let board = insole.start(None, false, None);
    assert!(insole.wait(board), "the bootloader must swap back");
    let board = insole.start(None, true, None);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

/// An image that begins to crash after it was confirmed. The bootloader does not swap a confirmed image back by itself: the
/// firmware's own start requests the swap after three failed starts, although the image processes frames before each crash.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_confirmed_image_that_crashes_again_and_again_is_swapped_back() {
    let mut insole = Insole::new();
    insole.accept(&firmware_with(NEW, &development()));
    let board = insole.start(None, false, None);
    assert!(insole.wait(board));
    let board = insole.start(None, true, None);
    let mut session = connect(&board);
    assert_eq!(session.hello().firmware, NEW);
    board.play();
    while refusal(session.update(Request::Confirm)) == Some(Refusal::OnTrial) {}
    insole.switch_off(board);

    insole.fault = Some(PlannedFault { kind: InjectedFault::Panic, after_ms: 1000, is_repeated: true });
    let board = insole.start(None, false, None);
    // The walk of each start, also of those after a crash, waits for a `play` of its own.
    (0..=MAX_FAILED_STARTS).for_each(|_| board.play());
    assert!(insole.wait(board), "the bootloader must swap back");
    insole.fault = None;
    let board = insole.start(None, true, None);
    assert_eq!(connect(&board).hello().firmware, OLD);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn invalid_images_are_refused_and_the_running_image_remains() {
    let mut insole = Insole::new();
    let board = insole.start(None, false, None);
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
    // The offer, the number of a chunk with a flipped bit, and the reason for the refusal.
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

    assert_eq!(session.reconnect(TIMEOUT).expect("the insole answers").firmware, OLD);
    insole.switch_off(board);
    let board = insole.start(None, false, None);
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
        let board = insole.start(Some(cuts), false, None);
        // Power may fail before the first answer.
        let sent = try_connect(&board).map(|mut session| send(&mut session, &image));
        let is_accepted = matches!(sent, Some(Ok(Progress::Accepted)));
        insole.wait(board);
        if is_accepted {
            break;
        }
        // The insole may have marked the image for the swap although its answer did not arrive.
        let board = insole.start(None, false, None);
        match try_connect(&board) {
            Some(session) => assert_eq!(session.hello().firmware, OLD, "after the cut in operation {cuts}"),
            None => {
                assert!(insole.wait(board), "no swap after the cut in operation {cuts}");
                assert!(active(&insole).starts_with(image.bytes()), "after the cut in operation {cuts}");
            }
        }
        cuts += 1;
    }
    // Every chunk is written in one operation.
    assert!(cuts > u32::from(image.offer().chunks), "only {cuts} cuts");
    println!("{cuts} cuts");
}

/// Number of write and erase operations of a swap from one tested power cut to the next. Testing every operation would take too
/// long in the emulator; `swap.rs` does that on a simulated chip.
const STRIDE: usize = 29;

/// Asserts that there were enough power cuts, one in every [`STRIDE`] operations, to cover a whole swap, which erases each sector
/// of both images.
fn assert_whole_swap(cuts: usize) {
    assert!(cuts * STRIDE >= 2 * (MAX_IMAGE / SECTOR) as usize, "only {cuts} cuts");
    println!("{cuts} cuts");
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_loss_of_power_during_the_swap_ends_in_the_new_image() {
    let mut insole = Insole::new();
    let image = firmware_with(NEW, &development());
    insole.accept(&image);
    let accepted = insole.flash.clone();
    let mut cuts = 0;
    for cut in (0..).step_by(STRIDE) {
        insole.flash = accepted.clone();
        let board = insole.start(Some(cut), false, None);
        if insole.wait(board) {
            break;
        }
        let board = insole.start(None, false, None);
        assert!(insole.wait(board), "no swap after the cut in operation {cut}");
        assert!(active(&insole).starts_with(image.bytes()), "after the cut in operation {cut}");
        let board = insole.start(None, true, None);
        assert_eq!(connect(&board).hello().firmware, NEW, "after the cut in operation {cut}");
        cuts += 1;
    }
    assert_whole_swap(cuts);
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn a_loss_of_power_during_the_swap_back_ends_in_the_old_image() {
    let mut insole = Insole::new();
    insole.accept(&crashing_image(NEW));
    let board = insole.start(None, false, None);
    assert!(insole.wait(board));
    let swapped = insole.flash.clone();
    let mut cuts = 0;
    for cut in (0..).step_by(STRIDE) {
        insole.flash = swapped.clone();
        let board = insole.start(Some(cut), false, None);
        if insole.wait(board) {
            break;
        }
        let board = insole.start(None, false, None);
        let is_swapped = insole.wait(board);
        assert!(is_swapped, "no swap after the cut in operation {cut}");
        let board = insole.start(None, true, None);
        assert_eq!(connect(&board).hello().firmware, OLD, "after the cut in operation {cut}");
        cuts += 1;
    }
    assert_whole_swap(cuts);
}
