//! Updates, the return to the previous image, and acknowledgements on a simulated flash chip, for all sequences of events
//! within bounds.

use critical_section as _; // links the host's implementation of the critical sections that the firmware uses
use embassy_futures::block_on;
use firmware_image::{Image, SigningKey};
use nor_flash::NorFlashChip;
use plantar::protocol::Reset;
use plantar::protocol::update::{CHUNK, Header, Offer, Progress, Refusal, Request};
use plantar::storage::Store;
use plantar::storage::flash_map::{HEADER, MAX_IMAGE, OTHER, PREVIOUS, SECTOR, SMALL_LOG, STATE};
use plantar::storage::previous;
use plantar::storage::update::{Update, confirm, is_on_trial};
use proofs::acknowledgement::record;
use proofs::sequences;
use std::sync::LazyLock;

/// The header of the running image.
const RUNNING: Header = Header::new("board", "1.2.3");

/// The bound of this run: `long` if `cargo xtask assure` has set `PLANTAR_ASSURE`, `short` otherwise.
fn bound<T>(short: T, long: T) -> T {
    if std::env::var_os("PLANTAR_ASSURE").is_some() { long } else { short }
}

/// The private key that signs the images.
static SECRET: LazyLock<SigningKey> = LazyLock::new(|| SigningKey::from_bytes(&[7; 32]));
/// Its public key.
static KEY: LazyLock<[u8; 32]> = LazyLock::new(|| SECRET.verifying_key().to_bytes());

fn ask(update: &mut Update, chip: &mut NorFlashChip, request: &Request) -> Result<Progress, Refusal> {
    block_on(update.handle(chip, &RUNNING, &KEY, request))
}

/// A signed image of three chunks, of which the last one contains the header.
fn image(version: &str) -> Image {
    let mut bytes: Vec<u8> = (0..3 * CHUNK).map(|at| at as u8).collect();
    let header = Header::new("board", version).bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, &SECRET).expect("the image has a header")
}

/// A request for an update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    /// Begins the transfer of an image with a valid signature, or of one with a wrong signature.
    Begin {
        is_signed: bool,
    },
    /// The chunk with this number; both images have the same chunks.
    Chunk(u16),
    Finish,
    Confirm,
}

/// The expected behaviour: the chip contains the chunks that were received in order, and the image is accepted once they are
/// complete and their signature is valid.
#[derive(Default)]
struct Receiver {
    /// Whether the signature of the offered image is valid; `None` if no image was offered.
    offered: Option<bool>,
    /// Number of the next chunk.
    next: u16,
    is_accepted: bool,
}

impl Receiver {
    fn answer(&mut self, asked: Asked) -> Result<Progress, Refusal> {
        match asked {
            Asked::Begin { .. } | Asked::Confirm if self.is_accepted => Err(Refusal::OnTrial),
            Asked::Confirm => Ok(Progress::Confirmed),
            Asked::Begin { is_signed } => {
                if self.offered != Some(is_signed) {
                    (self.offered, self.next) = (Some(is_signed), 0);
                }
                Ok(Progress::Next(self.next))
            }
            Asked::Chunk(_) | Asked::Finish if self.offered.is_none() => Err(Refusal::NotBegun),
            Asked::Chunk(number) => {
                self.next += u16::from(number == self.next && number < 3);
                Ok(Progress::Next(self.next))
            }
            Asked::Finish if self.next < 3 => Err(Refusal::Incomplete),
            Asked::Finish => {
                self.next = 0;
                self.is_accepted = self.offered.take() == Some(true);
                if self.is_accepted { Ok(Progress::Accepted) } else { Err(Refusal::Signature) }
            }
        }
    }
}

#[test]
fn an_image_is_accepted_only_after_all_of_its_chunks_and_with_its_signature() {
    let image = image("1.2.4");
    let offer = image.offer();
    let mut unsigned = offer;
    unsigned.signature[1][3] ^= 1;
    let mut chip = NorFlashChip::new(OTHER.end as usize);
    let alphabet = [
        Asked::Begin { is_signed: true },
        Asked::Begin { is_signed: false },
        Asked::Chunk(0),
        Asked::Chunk(1),
        Asked::Chunk(2),
        Asked::Chunk(3),
        Asked::Finish,
        Asked::Confirm,
    ];
    let mut accepted = 0;
    let mut check = |asked: &[Asked]| {
        for sector in [STATE.start, PREVIOUS.start, OTHER.start] {
            chip.bytes[sector as usize..][..SECTOR as usize].fill(0xff);
        }
        let (mut update, mut receiver) = (Update::new(), Receiver::default());
        for &one in asked {
            let request = match one {
                Asked::Begin { is_signed: true } => Request::Begin(offer),
                Asked::Begin { is_signed: false } => Request::Begin(unsigned),
                Asked::Chunk(number) => Request::Chunk { number, chunk: image.chunk(number.min(2)) },
                Asked::Finish => Request::Finish,
                Asked::Confirm => Request::Confirm,
            };
            assert_eq!(ask(&mut update, &mut chip, &request), receiver.answer(one), "{asked:?}");
            let received = usize::from(receiver.next) * CHUNK;
            assert_eq!(chip.bytes[OTHER.start as usize..][..received], image.bytes()[..received]);
        }
        // Only an accepted image is marked to be swapped in.
        assert_eq!(block_on(is_on_trial(&mut chip)), Ok(receiver.is_accepted));
        accepted += u32::from(receiver.is_accepted);
    };
    sequences(&alphabet, bound(5, 7), &mut check);
    // The same after a transfer that lacks only the request to finish it.
    let complete = [Asked::Begin { is_signed: true }, Asked::Chunk(0), Asked::Chunk(1), Asked::Chunk(2)];
    sequences(&alphabet, bound(2, 4), |asked| check(&[&complete, asked].concat()));
    assert!(accepted > 1);
}

#[test]
fn an_update_begins_only_if_its_image_contains_a_header_and_fits() {
    let mut chip = NorFlashChip::new(OTHER.end as usize);
    for chunks in 0..=u16::MAX {
        let offer = Offer { header: Header::new("board", "1.2.3"), chunks, signature: [[0; 32]; 2] };
        // The header of 40 bytes follows 512 bytes after the beginning.
        let fits = (552..=u64::from(MAX_IMAGE)).contains(&(u64::from(chunks) * 256));
        let expected = if fits { Ok(Progress::Next(0)) } else { Err(Refusal::Length) };
        assert_eq!(ask(&mut Update::new(), &mut chip, &Request::Begin(offer)), expected);
    }
}

/// All texts of up to five characters that are digits from 0 to 4 or points: versions, and texts that are not versions.
#[test]
fn an_older_image_and_one_for_another_board_are_refused() {
    let mut chip = NorFlashChip::new(OTHER.end as usize);
    sequences(&['0', '1', '2', '3', '4', '.'], 5, |version| {
        let version: String = version.iter().collect();
        for board in ["board", "boar", "board2", ""] {
            let offer = Offer { header: Header::new(board, &version), chunks: 3, signature: [[0; 32]; 2] };
            let numbers: Vec<Option<u16>> = version.split('.').map(|part| part.parse().ok()).collect();
            let is_older = match numbers[..] {
                [Some(major), Some(minor), Some(patch)] => (major, minor, patch) < (1, 2, 3),
                _ => true,
            };
            let expected = match (board, is_older) {
                ("board", false) => Ok(Progress::Next(0)),
                ("board", true) => Err(Refusal::Older),
                _ => Err(Refusal::Board),
            };
            assert_eq!(ask(&mut Update::new(), &mut chip, &Request::Begin(offer)), expected, "{board} {version}");
        }
    });
}

/// Every chunk of the longest image is written to its place, into a sector that was erased exactly once. The note about the
/// previous image is erased.
#[test]
fn the_chunks_of_the_longest_image_fill_its_area_and_nothing_else() {
    let chunks = (MAX_IMAGE / CHUNK as u32) as u16;
    let used = vec![0x5a; (OTHER.end + SECTOR) as usize];
    let mut chip = NorFlashChip::of(used.clone());
    chip.bytes[STATE.start as usize..STATE.end as usize].fill(0xff);
    let before = chip.bytes.clone();
    let mut update = Update::new();
    let offer = Offer { header: RUNNING, chunks, signature: [[0; 32]; 2] };
    assert_eq!(ask(&mut update, &mut chip, &Request::Begin(offer)), Ok(Progress::Next(0)));
    for number in 0..chunks {
        let chunk = [[(number % 251) as u8; 32]; CHUNK / 32];
        assert_eq!(ask(&mut update, &mut chip, &Request::Chunk { number, chunk }), Ok(Progress::Next(number + 1)));
    }
    let image = OTHER.start as usize..(OTHER.start + MAX_IMAGE) as usize;
    for (at, (now, before)) in chip.bytes.iter().zip(&before).enumerate() {
        let expected = if image.contains(&at) {
            ((at - image.start) / CHUNK % 251) as u8
        } else if PREVIOUS.contains(&(at as u32)) {
            0xff
        } else {
            *before
        };
        assert_eq!(*now, expected, "address {at}");
    }
    for (sector, erasures) in chip.erasures.iter().enumerate() {
        let at = sector as u32 * SECTOR;
        let is_erased = image.contains(&(at as usize)) || at == PREVIOUS.start;
        assert_eq!(*erasures, u32::from(is_erased), "sector {sector}");
    }
}

/// An event of the log.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// A record is stored.
    Record,
    /// The oldest stored record is acknowledged. An acknowledgement is also that of all earlier records.
    AcknowledgeOldest,
    /// The newest stored record is acknowledged, and with it all stored ones.
    AcknowledgeNewest,
    /// A later record is acknowledged that the log does not contain, because it could not be stored, and with it all stored ones.
    AcknowledgeMissing,
    /// The store is opened again, as after a reset.
    Restart,
}

/// After any sequence of events and a restart, the log has exactly the records after the last acknowledged one, and the number
/// of the next record follows the highest number that was stored or acknowledged.
#[test]
fn a_log_contains_exactly_the_records_that_were_not_acknowledged() {
    let alphabet =
        [Event::Record, Event::AcknowledgeOldest, Event::AcknowledgeNewest, Event::AcknowledgeMissing, Event::Restart];
    let mut blank = NorFlashChip::new(SMALL_LOG.end as usize);
    let _ = block_on(Store::open(Some(&mut blank), Reset::Power));
    sequences(&alphabet, bound(4, 6), |events| {
        let mut chip = blank.clone();
        let mut stored: Vec<u32> = Vec::new();
        let mut next = 0;
        let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
        for event in events {
            let acknowledged = match event {
                Event::Record => {
                    assert_eq!(block_on(store.push_record(record(next))), Ok(0));
                    stored.push(next);
                    next += 1;
                    None
                }
                Event::AcknowledgeOldest => stored.first().copied(),
                Event::AcknowledgeNewest => stored.last().copied(),
                Event::AcknowledgeMissing => Some(next + 1),
                Event::Restart => {
                    store = block_on(Store::open(Some(&mut chip), Reset::Software));
                    None
                }
            };
            if let Some(number) = acknowledged {
                assert_eq!(block_on(store.acknowledge(number)), Ok(false));
                stored.retain(|stored| *stored > number);
                next = next.max(number + 1);
            }
        }
        let mut store = block_on(Store::open(Some(&mut chip), Reset::Power));
        let mut read = Vec::new();
        let has_more = block_on(store.records(None, |record| {
            read.push(record.number());
            true
        }));
        assert_eq!((has_more, read), (Ok(false), stored), "{events:?}");
        assert_eq!(store.contents().next_record, next);
        assert_eq!(store.contents().erased, 0);
    });
}

/// An event that concerns the return to the previous image.
#[derive(Clone, Copy, Debug)]
enum Return {
    /// The image `RUNNING` is confirmed, which notes the previous image.
    Confirm,
    /// Another running image is confirmed.
    ConfirmOther,
    /// The note about the previous image is erased.
    Forget,
    /// The last byte of the previous image changes.
    Damage,
    /// The header of the previous image changes to that of another board.
    Board,
    /// The image `RUNNING` requests the return to the previous image.
    SwapBack,
}

/// The previous image is marked to be swapped back if and only if it was noted as the image that the running one replaced, is
/// for the same board and unchanged since then, and no image is on trial.
#[test]
fn only_an_unchanged_previous_image_that_was_noted_returns() {
    const OTHER_RUNNING: Header = Header::new("board", "1.2.4");
    let previous_header = (OTHER.start + SECTOR + HEADER) as usize;
    let last = (OTHER.start + SECTOR + MAX_IMAGE) as usize - 1;
    let mut blank = NorFlashChip::new(OTHER.end as usize);
    let bytes = Header::new("board", "1.2.2").bytes();
    blank.bytes[previous_header..][..bytes.len()].copy_from_slice(&bytes);
    let mut returned = 0;
    let alphabet =
        [Return::Confirm, Return::ConfirmOther, Return::Forget, Return::Damage, Return::Board, Return::SwapBack];
    sequences(&alphabet, bound(3, 5), |events| {
        let mut chip = blank.clone();
        // The expected state: how often the previous image was damaged, whether it is for this board, and whether an image is
        // on trial; `noted` has the running image of the note, and the state of the previous image at that time.
        let (mut damages, mut is_of_board, mut is_on_trial_now) = (0u8, true, false);
        let mut noted = None;
        for event in events.iter().chain([&Return::SwapBack]) {
            match event {
                Return::Confirm | Return::ConfirmOther => {
                    let running = if matches!(event, Return::Confirm) { RUNNING } else { OTHER_RUNNING };
                    assert_eq!(block_on(confirm(&mut chip, &running)), Ok(()));
                    noted = Some((running, damages, is_of_board));
                    is_on_trial_now = false;
                }
                Return::Forget => {
                    assert_eq!(block_on(previous::forget(&mut chip)), Ok(()));
                    noted = None;
                }
                Return::Damage => {
                    damages += 1;
                    chip.bytes[last] = 0xff - damages;
                }
                Return::Board => {
                    is_of_board = false;
                    chip.bytes[previous_header + 8] = b'x';
                }
                Return::SwapBack => {
                    let is_due = is_of_board && !is_on_trial_now && noted == Some((RUNNING, damages, is_of_board));
                    let swapped = block_on(previous::swap_back(&mut chip, &RUNNING));
                    assert_eq!(swapped, Ok(is_due), "{events:?}");
                    is_on_trial_now |= is_due;
                    returned += u32::from(is_due);
                }
            }
            assert_eq!(block_on(is_on_trial(&mut chip)), Ok(is_on_trial_now), "{events:?}");
        }
    });
    assert!(returned > 1);
}
