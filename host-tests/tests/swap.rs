//! Updates on a simulated flash chip: which images are accepted and refused, and which image is active after a loss of power at
//! any moment. The images are swapped by the code that the bootloaders use.

use embassy_boot::{BootError, State};
use embassy_futures::block_on;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, ReadNorFlash};
use emulation::ACTIVE_IMAGE;
use emulation::FLASH_BYTES;
use firmware_image::{Image, SigningKey};
use mcumgr::{CHUNK as PART, Upload};
use plantar::protocol::mcuboot::TRAILER;
use plantar::protocol::update::{CHUNK, Header, Offer, Progress, Refusal, Request};
use plantar::storage::boot::{Blocking, poll_at_most, swap_if_due};
use plantar::storage::flash_map::SMALL_LOG;
use plantar::storage::flash_map::{HEADER, MAX_IMAGE, OTHER, PREVIOUS, SECTOR, STATE};
use plantar::storage::partition::Partition;
use plantar::storage::previous;
use plantar::storage::supplied::Supplied;
use plantar::storage::update::{Update, confirm, is_on_trial};
use proptest::prelude::*;
use std::sync::LazyLock;
use testkit::nor_flash::{NorFlashChip, OperationFailed, Supply, Torn};

/// The key that signs the images.
static SECRET: LazyLock<SigningKey> = LazyLock::new(|| SigningKey::from_bytes(&[7; 32]));
/// The image that is active at first.
static OLD: LazyLock<Image> = LazyLock::new(|| image("1.2.9", 53 * SECTOR as usize + CHUNK));
/// The image that replaces [`OLD`].
static NEW: LazyLock<Image> = LazyLock::new(|| image("1.2.10", 60 * SECTOR as usize));

/// All moments of an operation at which power can fail.
const TORN: [Torn; 3] = [Torn::Before, Torn::Within, Torn::After];

/// A signed image with random content.
fn image(version: &str, len: usize) -> Image {
    let mut random = fastrand::Rng::with_seed(len as u64);
    let mut bytes: Vec<u8> = std::iter::repeat_with(|| random.u8(..)).take(len).collect();
    let header = Header::new("board", version).bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, &SECRET).expect("the image has a header")
}

/// The public key of [`SECRET`].
fn key() -> [u8; 32] {
    SECRET.verifying_key().to_bytes()
}

/// A chip on which the image [`OLD`] is active.
fn chip() -> NorFlashChip {
    let mut chip = NorFlashChip::new(FLASH_BYTES);
    chip.bytes[ACTIVE_IMAGE.start as usize..][..OLD.bytes().len()].copy_from_slice(OLD.bytes());
    chip
}

/// The active image: [`OLD`] or [`NEW`]; `None` if it is a mixture of both.
fn active(chip: &NorFlashChip) -> Option<&'static Image> {
    let bytes = &chip.bytes[ACTIVE_IMAGE.start as usize..ACTIVE_IMAGE.end as usize];
    [&*OLD, &*NEW].into_iter().find(|image| bytes.starts_with(image.bytes()))
}

/// Runs the bootloader's function that swaps images or swaps them back if necessary; returns the state that it found.
fn boot(chip: &mut impl MultiwriteNorFlash) -> Result<State, BootError> {
    let chip = Mutex::new(chip);
    let active = Blocking(Partition::<_, CHUNK>::new(&chip, ACTIVE_IMAGE));
    swap_if_due(&chip, active)
}

/// Passes a request to the insole's update function.
fn ask(update: &mut Update, chip: &mut NorFlashChip, request: Request) -> Result<Progress, Refusal> {
    block_on(update.handle(chip, OLD.header(), &key(), &request))
}

/// The request that transfers a chunk of an image.
fn chunk(image: &Image, number: u16) -> Request {
    Request::Chunk { number, chunk: image.chunk(number) }
}

/// Transfers a complete image.
fn send(update: &mut Update, chip: &mut NorFlashChip, image: &Image) -> Result<Progress, Refusal> {
    ask(update, chip, Request::Begin(image.offer()))?;
    for number in 0..image.offer().chunks {
        ask(update, chip, chunk(image, number))?;
    }
    ask(update, chip, Request::Finish)
}

/// A chip on which [`OLD`] is active and [`NEW`] was accepted, so that the next start swaps them.
fn accepted() -> NorFlashChip {
    let mut chip = chip();
    assert_eq!(send(&mut Update::new(), &mut chip, &NEW), Ok(Progress::Accepted));
    chip.restarted()
}

/// The bootloader waits for a busy chip for a limited time, and then starts the image without a swap.
#[test]
fn a_wait_for_a_chip_that_stays_busy_ends() {
    let mut polls = 0;
    let busy_for = async |times: u32| {
        for _ in 0..times {
            embassy_futures::yield_now().await;
        }
    };
    assert_eq!(poll_at_most(100, busy_for(99)), Some(()));
    assert_eq!(poll_at_most(100, busy_for(100)), None);
    let counted = std::future::poll_fn(|_| {
        polls += 1;
        std::task::Poll::<()>::Pending
    });
    assert_eq!(poll_at_most(100, counted), None);
    assert_eq!(polls, 100);
}

/// The flash chip answers, but does not return the stored state. The bootloader must start the active image: it cannot swap
/// images without the state, so a reset, as after a swap that failed, would be repeated without end.
#[test]
fn a_state_that_cannot_be_read_leaves_the_active_image() {
    let accepted = accepted();
    // The bootloader tries to read the state three times.
    for (failing_reads, state, image) in
        [(2, State::Swap, &*NEW), (3, State::Boot, &*OLD), (u64::MAX, State::Boot, &*OLD)]
    {
        let mut chip = accepted.clone();
        chip.failing_reads = failing_reads;
        assert_eq!((boot(&mut chip), active(&chip)), (Ok(state), Some(image)), "{failing_reads} reads fail");
        assert_eq!(chip.bytes == accepted.bytes, image == &*OLD, "{failing_reads} reads fail");
    }
}

#[test]
fn a_signed_image_is_swapped_in_and_back_unless_it_is_confirmed() {
    let mut chip = accepted();
    assert_eq!(boot(&mut chip), Ok(State::Swap));
    assert!(active(&chip) == Some(&NEW) && block_on(is_on_trial(&mut chip)) == Ok(true));
    // While the new image is on trial, the area of the old one must not be overwritten.
    assert_eq!(send(&mut Update::new(), &mut chip, &NEW), Err(Refusal::OnTrial));

    let mut confirmed = chip.clone();
    assert_eq!(block_on(confirm(&mut confirmed, NEW.header())), Ok(()));
    assert_eq!(boot(&mut confirmed), Ok(State::Boot));
    assert!(active(&confirmed) == Some(&NEW) && block_on(is_on_trial(&mut confirmed)) == Ok(false));

    boot(&mut chip).expect("the chip works");
    assert!(active(&chip) == Some(&OLD) && block_on(is_on_trial(&mut chip)) == Ok(false));
    // The new image can be installed again.
    assert_eq!(send(&mut Update::new(), &mut chip, &NEW), Ok(Progress::Accepted));
    boot(&mut chip).expect("the chip works");
    assert_eq!(active(&chip), Some(&*NEW));
}

/// The bootloader resets the board if a swap fails, and continues it at the next start. An image runs only after a complete swap.
#[test]
fn a_swap_waits_for_the_supply_at_any_moment() {
    let boot_supplied = |chip: &mut NorFlashChip, supply: &Supply| {
        boot(&mut Supplied::new(chip, FLASH_BYTES as u32, || supply.is_sufficient()))
    };
    let accepted = accepted();
    let steady = Supply::new(u64::MAX, 0);
    boot_supplied(&mut accepted.clone(), &steady).expect("the swap is complete");
    assert!(steady.operations() > 100, "{}", steady.operations());
    for sufficient in (0..steady.operations()).step_by(7) {
        let mut chip = accepted.clone();
        let supply = Supply::new(sufficient, 3);
        let mut failed_starts = 0;
        while boot_supplied(&mut chip, &supply).is_err() {
            failed_starts += 1;
        }
        assert_eq!(active(&chip), Some(&*NEW), "low supply from operation {sufficient} on");
        assert_eq!(failed_starts, 3, "each refused operation must end a start");
    }
}

#[test]
fn a_refused_image_is_not_swapped_in() {
    let other_key = SigningKey::from_bytes(&[8; 32]);
    let other_key = Image::sign(NEW.bytes().to_vec(), &other_key).expect("the image has a header");
    for (image, refusal) in [(&other_key, Refusal::Signature), (&image("1.1.99", 8 * CHUNK), Refusal::Older)] {
        let mut chip = chip();
        assert_eq!(send(&mut Update::new(), &mut chip, image), Err(refusal));
        assert!(boot(&mut chip) == Ok(State::Boot) && active(&chip) == Some(&OLD));
    }
    for (offer, refusal) in [
        (Offer { header: Header::new("other", "9.9.9"), ..NEW.offer() }, Refusal::Board),
        // A version that does not consist of three numbers counts as older.
        (Offer { header: Header::new("board", "9"), ..NEW.offer() }, Refusal::Older),
        (Offer { chunks: 0, ..NEW.offer() }, Refusal::Length),
        // Its signature would not cover the header.
        (Offer { chunks: 2, ..NEW.offer() }, Refusal::Length),
        (Offer { chunks: (MAX_IMAGE as usize / CHUNK) as u16 + 1, ..NEW.offer() }, Refusal::Length),
        // The signature covers the header, so an offer with another version does not match.
        (Offer { header: Header::new("board", "9.9.9"), ..NEW.offer() }, Refusal::Header),
        (Offer { signature: [[0; 32]; 2], ..NEW.offer() }, Refusal::Signature),
        // The image is truncated.
        (Offer { chunks: NEW.offer().chunks - 1, ..NEW.offer() }, Refusal::Signature),
    ] {
        let (mut update, mut chip) = (Update::new(), chip());
        let mut answer = ask(&mut update, &mut chip, Request::Begin(offer));
        for number in 0..offer.chunks {
            answer = answer.and_then(|_| ask(&mut update, &mut chip, chunk(&NEW, number)));
        }
        answer = answer.and_then(|_| ask(&mut update, &mut chip, Request::Finish));
        assert_eq!(answer, Err(refusal));
        assert!(boot(&mut chip) == Ok(State::Boot) && active(&chip) == Some(&OLD));
    }
    // Requests without `Begin`, and a transfer without its chunks, are refused.
    let (mut update, mut chip) = (Update::new(), chip());
    assert_eq!(ask(&mut update, &mut chip, chunk(&NEW, 0)), Err(Refusal::NotBegun));
    assert_eq!(ask(&mut update, &mut chip, Request::Finish), Err(Refusal::NotBegun));
    assert_eq!(ask(&mut update, &mut chip, Request::Begin(NEW.offer())), Ok(Progress::Next(0)));
    assert_eq!(ask(&mut update, &mut chip, Request::Finish), Err(Refusal::Incomplete));
}

/// When all chunks were received, the supply is too low to mark the image for the swap, or a read fails. The same request
/// succeeds later, without another transfer of the chunks.
#[test]
fn a_complete_image_remains_if_the_chip_fails_at_the_end_of_the_transfer() {
    for (refuses_changes, failing_reads) in [(true, 0), (false, 1)] {
        let (mut update, mut chip) = (Update::new(), chip());
        ask(&mut update, &mut chip, Request::Begin(NEW.offer())).expect("the offer is accepted");
        for number in 0..NEW.offer().chunks {
            ask(&mut update, &mut chip, chunk(&NEW, number)).expect("the chunk is accepted");
        }
        (chip.refuses_changes, chip.failing_reads) = (refuses_changes, failing_reads);
        assert_eq!(ask(&mut update, &mut chip, Request::Finish), Err(Refusal::Chip));
        (chip.refuses_changes, chip.failing_reads) = (false, 0);
        assert_eq!(ask(&mut update, &mut chip, Request::Begin(NEW.offer())), Ok(Progress::Next(NEW.offer().chunks)));
        assert_eq!(ask(&mut update, &mut chip, Request::Finish), Ok(Progress::Accepted));
        assert!(boot(&mut chip) == Ok(State::Swap) && active(&chip) == Some(&NEW));
    }
}

/// The same with an image that was received as a file and is then marked by a management tool.
#[test]
fn a_file_remains_if_the_chip_fails_while_it_is_marked() {
    let (mut update, mut chip) = (Update::new(), chip());
    let file = NEW.file();
    for (index, data) in file[..file.len() - TRAILER].chunks(PART).chain([&file[file.len() - TRAILER..]]).enumerate() {
        let offset = (index * PART).min(file.len() - TRAILER) as u32;
        let part = Upload {
            offset,
            file_bytes: Some(file.len() as u32),
            sha256: None,
            must_be_newer: false,
            data: data.iter().copied().collect(),
        };
        block_on(update.upload(&mut chip, OLD.header(), &part)).expect("the part is accepted");
    }
    let received = update.received().expect("the file is complete");
    chip.refuses_changes = true;
    assert_eq!(block_on(update.mark(&mut chip, &key())), Err(Refusal::Chip));
    assert_eq!(update.received(), Some(received));
    chip.refuses_changes = false;
    assert_eq!(block_on(update.mark(&mut chip, &key())), Ok(()));
    assert_eq!(boot(&mut chip), Ok(State::Swap));
}

#[test]
fn a_flipped_bit_in_the_chip_is_detected() {
    let mut random = fastrand::Rng::with_seed(3);
    for _ in 0..8 {
        let (mut update, mut chip) = (Update::new(), chip());
        ask(&mut update, &mut chip, Request::Begin(NEW.offer())).expect("the offer is accepted");
        for number in 0..NEW.offer().chunks {
            ask(&mut update, &mut chip, chunk(&NEW, number)).expect("the chunk is accepted");
        }
        let index = random.usize(0..NEW.bytes().len());
        chip.bytes[OTHER.start as usize + index] ^= 1 << random.u8(0..8);
        let answer = ask(&mut update, &mut chip, Request::Finish);
        assert!(matches!(answer, Err(Refusal::Signature | Refusal::Header)), "{answer:?} at byte {index}");
        assert!(boot(&mut chip) == Ok(State::Boot) && active(&chip) == Some(&OLD));
    }
}

/// A chip that returns the first byte of the received image with a flipped bit in one of its readings.
struct ChipWithWrongReading<'c> {
    chip: &'c mut NorFlashChip,
    /// Number of times that the image was read so far.
    readings: usize,
    /// The reading with the flipped bit, from 1.
    wrong_reading: usize,
}

impl ErrorType for ChipWithWrongReading<'_> {
    type Error = OperationFailed;
}

impl ReadNorFlash for ChipWithWrongReading<'_> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), OperationFailed> {
        self.chip.read(offset, bytes).await?;
        if offset == OTHER.start {
            self.readings += 1;
            bytes[0] ^= u8::from(self.readings == self.wrong_reading);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.chip.capacity()
    }
}

impl NorFlash for ChipWithWrongReading<'_> {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR as usize;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), OperationFailed> {
        self.chip.erase(from, to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), OperationFailed> {
        self.chip.write(offset, bytes).await
    }
}

/// The signature is verified twice, each time with the bytes that the chip returns then.
#[test]
fn an_image_that_the_chip_returns_wrong_once_is_refused() {
    for (wrong_reading, expected) in
        [(1, Err(Refusal::Signature)), (2, Err(Refusal::Signature)), (3, Ok(Progress::Accepted))]
    {
        let (mut update, mut chip) = (Update::new(), chip());
        ask(&mut update, &mut chip, Request::Begin(NEW.offer())).expect("the image is offered");
        for number in 0..NEW.offer().chunks {
            ask(&mut update, &mut chip, chunk(&NEW, number)).expect("the chunk is accepted");
        }
        let mut faulty = ChipWithWrongReading { chip: &mut chip, readings: 0, wrong_reading };
        let answer = block_on(update.handle(&mut faulty, OLD.header(), &key(), &Request::Finish));
        assert_eq!(answer, expected, "wrong in reading {wrong_reading}");
        assert_eq!(boot(&mut chip) == Ok(State::Swap), expected.is_ok(), "wrong in reading {wrong_reading}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Chunks are lost, repeated or late, and hosts begin again. The transferred image must be complete and correct.
    #[test]
    fn a_disturbed_transfer_continues_where_it_was(seed: u64) {
        let mut random = fastrand::Rng::with_seed(seed);
        let image = image("2.0.0", random.usize(3..80) * CHUNK);
        let (mut update, mut chip) = (Update::new(), chip());
        let chunks = image.offer().chunks;
        let mut next = 0;
        while next < chunks {
            let answer = match random.u8(0..8) {
                0 => ask(&mut update, &mut chip, Request::Begin(image.offer())),
                1 => ask(&mut update, &mut chip, chunk(&image, random.u16(0..2 * chunks))),
                _ => ask(&mut update, &mut chip, chunk(&image, next)),
            };
            next = match answer {
                Ok(Progress::Next(now)) => { prop_assert!(now == next || now == next + 1); now }
                // The chunk was sent before the first `Begin`.
                answer => { prop_assert_eq!(answer, Err(Refusal::NotBegun)); 0 }
            };
        }
        prop_assert_eq!(&chip.bytes[OTHER.start as usize..][..image.bytes().len()], image.bytes());
        prop_assert_eq!(ask(&mut update, &mut chip, Request::Finish), Ok(Progress::Accepted));
    }
}

/// Number of write and erase operations of `work` on a copy of the chip `before`.
fn operations(before: &NorFlashChip, work: impl Fn(&mut NorFlashChip)) -> u64 {
    let mut chip = before.restarted();
    chip.operations = 0;
    work(&mut chip);
    chip.operations
}

/// Runs `work` on copies of the chip `before`, each with one power cut: in every `stride`th write or erase operation of `work`,
/// at each of the moments [`TORN`]. Passes each chip to `check` afterwards, with the number of the operation and the moment.
/// Returns the number of cuts.
fn cuts(
    before: &NorFlashChip,
    stride: usize,
    work: impl Fn(&mut NorFlashChip),
    mut check: impl FnMut(&mut NorFlashChip, u64, Torn),
) -> usize {
    let operations = operations(before, &work);
    assert!(operations > 0, "without an operation, power cannot fail in one");
    let mut count = 0;
    for operation in (0..operations).step_by(stride) {
        for torn in TORN {
            let mut chip = before.restarted();
            (chip.operations, chip.cut) = (0, Some((operation, torn)));
            work(&mut chip);
            check(&mut chip.restarted(), operation, torn);
            count += 1;
        }
    }
    count
}

#[test]
fn a_loss_of_power_during_the_transfer_leaves_the_old_image() {
    let work = |chip: &mut NorFlashChip| {
        let _ = send(&mut Update::new(), chip, &NEW);
    };
    let last = operations(&chip(), work) - 1;
    let count = cuts(&chip(), 7, work, |chip, operation, torn| {
        // Only the last operation marks the image for the swap.
        let is_marked = boot(chip) == Ok(State::Swap);
        assert!(!is_marked || operation == last, "{torn:?} operation {operation}");
        assert_eq!(active(chip), Some(if is_marked { &*NEW } else { &*OLD }), "{torn:?} operation {operation}");
    });
    println!("{count} cuts");
}

#[test]
fn a_loss_of_power_anywhere_in_the_swap_ends_in_the_new_image() {
    let before = accepted();
    let work = |chip: &mut NorFlashChip| {
        let _ = boot(chip);
    };
    let last = operations(&before, work) - 1;
    let count = cuts(&before, 1, work, |chip, operation, torn| {
        // If power fails after the last operation, the swap is already complete. This start is then the second one, and swaps
        // back.
        let is_complete = (operation, torn) == (last, Torn::After);
        let image = if is_complete { &*OLD } else { &*NEW };
        assert_eq!((boot(chip), active(chip)), (Ok(State::Swap), Some(image)), "{torn:?} operation {operation}");
        block_on(confirm(chip, NEW.header())).expect("the chip works");
        assert_eq!(boot(chip), Ok(State::Boot), "{torn:?} operation {operation}");
    });
    println!("{count} cuts");
}

#[test]
fn a_loss_of_power_anywhere_in_the_swap_back_ends_in_the_old_image() {
    let mut before = accepted();
    boot(&mut before).expect("the chip works");
    let work = |chip: &mut NorFlashChip| {
        let _ = boot(chip);
    };
    let count = cuts(&before.restarted(), 1, work, |chip, operation, torn| {
        boot(chip).expect("the chip works");
        assert_eq!(active(chip), Some(&*OLD), "{torn:?} operation {operation}");
        assert_eq!(block_on(is_on_trial(chip)), Ok(false), "{torn:?} operation {operation}");
    });
    println!("{count} cuts");
}

#[test]
fn a_loss_of_power_during_the_confirmation_leaves_one_of_the_two_images() {
    let mut before = accepted();
    boot(&mut before).expect("the chip works");
    let work = |chip: &mut NorFlashChip| {
        let _ = block_on(confirm(chip, NEW.header()));
    };
    let count = cuts(&before.restarted(), 1, work, |chip, operation, torn| {
        boot(chip).expect("the chip works");
        assert!(active(chip).is_some(), "{torn:?} operation {operation}");
        assert_eq!(send(&mut Update::new(), chip, &NEW), Ok(Progress::Accepted), "{torn:?} operation {operation}");
        boot(chip).expect("the chip works");
        assert_eq!(active(chip), Some(&*NEW), "{torn:?} operation {operation}");
    });
    println!("{count} cuts");
}

/// A chip on which [`NEW`] is active and confirmed, and [`OLD`] is the previous image.
fn confirmed() -> NorFlashChip {
    let mut chip = accepted();
    boot(&mut chip).expect("the chip works");
    block_on(confirm(&mut chip, NEW.header())).expect("the chip works");
    assert_eq!(boot(&mut chip), Ok(State::Boot));
    chip.restarted()
}

#[test]
fn a_confirmed_image_that_crashes_is_swapped_back_once() {
    let mut chip = confirmed();
    assert_eq!(block_on(previous::swap_back(&mut chip, NEW.header())), Ok(true));
    assert_eq!(boot(&mut chip), Ok(State::Swap));
    assert_eq!((active(&chip), block_on(is_on_trial(&mut chip))), (Some(&*OLD), Ok(false)));
    assert_eq!(block_on(previous::swap_back(&mut chip, OLD.header())), Ok(false));
    assert_eq!(block_on(previous::swap_back(&mut chip, NEW.header())), Ok(false));
    assert_eq!(boot(&mut chip), Ok(State::Revert));
    assert_eq!(active(&chip), Some(&*OLD));
    // The new image can be installed again.
    assert_eq!(send(&mut Update::new(), &mut chip, &NEW), Ok(Progress::Accepted));
    boot(&mut chip).expect("the chip works");
    assert_eq!(active(&chip), Some(&*NEW));
}

#[test]
fn a_loss_of_power_anywhere_in_the_return_of_the_previous_image_leaves_one_of_the_two_images() {
    let work = |chip: &mut NorFlashChip| {
        if block_on(previous::swap_back(chip, NEW.header())) == Ok(true) {
            let _ = boot(chip);
        }
    };
    let mut returned = 0;
    let count = cuts(&confirmed(), 7, work, |chip, operation, torn| {
        boot(chip).expect("the chip works");
        let image = active(chip).unwrap_or_else(|| panic!("{torn:?} operation {operation}: a mixture of both images"));
        returned += usize::from(image.header() == OLD.header());
        assert_eq!(block_on(is_on_trial(chip)), Ok(false), "{torn:?} operation {operation}");
        assert_eq!(send(&mut Update::new(), chip, &NEW), Ok(Progress::Accepted), "{torn:?} operation {operation}");
    });
    // The swap has far more operations than marking the image for it, so most of the cuts are in the swap.
    assert!(returned > count / 2, "{returned} of {count}");
    println!("{count} cuts");
}

/// Repeats `work` until an attempt is not interrupted. In each attempt, power fails in a random one of the first `within` write
/// and erase operations, if the attempt has so many. Returns the number of cuts.
fn interrupted(
    chip: &mut NorFlashChip,
    random: &mut fastrand::Rng,
    within: u64,
    work: impl Fn(&mut NorFlashChip),
) -> usize {
    for count in 0.. {
        let operation = random.u64(0..within);
        (chip.operations, chip.cut) = (0, Some((operation, TORN[random.usize(..TORN.len())])));
        work(chip);
        let is_interrupted = chip.is_off();
        chip.cut = None;
        if !is_interrupted {
            return count;
        }
    }
    unreachable!("the range does not end")
}

/// Power fails several times in the same swap, and again in the swap that continues it.
#[test]
fn many_losses_of_power_leave_one_of_the_two_images() {
    const CUTS: usize = 10_000;
    // Power fails within these numbers of operations. A swap in either direction has at most 579, and a confirmation has 4, so
    // that some attempts succeed.
    const SWAP: u64 = 700;
    const CONFIRMATION: u64 = 8;
    let mut random = fastrand::Rng::with_seed(11);
    let start = |chip: &mut NorFlashChip| {
        let _ = boot(chip);
    };
    let confirm_new = |chip: &mut NorFlashChip| {
        let _ = block_on(confirm(chip, NEW.header()));
    };
    let request_swap_back = |chip: &mut NorFlashChip| {
        let _ = block_on(previous::swap_back(chip, NEW.header()));
    };
    let (mut cuts, mut updates, mut returns) = (0, 0, 0);
    let before = accepted();
    while cuts < CUTS {
        let mut chip = before.clone();
        cuts += interrupted(&mut chip, &mut random, SWAP, start);
        // If power failed after the last operation of the swap, the repeated start has already swapped back. Otherwise the new
        // image is on trial: without a confirmation, the next start swaps back.
        if random.bool() && active(&chip) == Some(&*NEW) && block_on(is_on_trial(&mut chip)) == Ok(true) {
            cuts += interrupted(&mut chip, &mut random, CONFIRMATION, confirm_new);
            assert_eq!(active(&chip), Some(&*NEW), "after {cuts} cuts");
            if random.bool() {
                cuts += interrupted(&mut chip, &mut random, SWAP, request_swap_back);
            }
        }
        cuts += interrupted(&mut chip, &mut random, SWAP, start);
        boot(&mut chip).expect("the chip works");
        let image = active(&chip).unwrap_or_else(|| panic!("a mixture of both images after {cuts} cuts"));
        (updates, returns) = match image == &*NEW {
            true => (updates + 1, returns),
            false => (updates, returns + 1),
        };
        assert_eq!(block_on(is_on_trial(&mut chip)), Ok(false), "after {cuts} cuts");
        // The insole still accepts updates. A transfer takes longer than a swap, so only some chips receive one.
        if random.u8(0..8) == 0 {
            assert_eq!(send(&mut Update::new(), &mut chip, &NEW), Ok(Progress::Accepted), "after {cuts} cuts");
        }
    }
    assert!(updates > 0 && returns > 0, "{updates} {returns}");
    println!("{cuts} cuts: {updates} times the new image, {returns} times the old one");
}

/// An image that a host sends is written before it is verified. It must not run instead of the previous one.
#[test]
fn only_the_image_that_was_replaced_returns() {
    let other_key =
        Image::sign(image("9.0.0", 60 * SECTOR as usize).bytes().to_vec(), &SigningKey::from_bytes(&[8; 32]))
            .expect("the image has a header");
    for chunks in [1, 16, 17, other_key.offer().chunks] {
        let (mut chip, mut update) = (confirmed(), Update::new());
        let mut ask = |request| block_on(update.handle(&mut chip, NEW.header(), &key(), &request));
        ask(Request::Begin(other_key.offer())).expect("the offer is accepted");
        for number in 0..chunks {
            ask(chunk(&other_key, number)).expect("the chunk is accepted");
        }
        if chunks == other_key.offer().chunks {
            assert_eq!(ask(Request::Finish), Err(Refusal::Signature));
        }
        assert_eq!(block_on(previous::swap_back(&mut chip, NEW.header())), Ok(false), "after {chunks} chunks");
        assert_eq!((boot(&mut chip), active(&chip)), (Ok(State::Boot), Some(&*NEW)));
    }
    // Another image was flashed since, or a bit of the previous image is damaged, or the note about the previous image was
    // erased, as it is after an hour.
    assert_eq!(block_on(previous::swap_back(&mut confirmed(), OLD.header())), Ok(false));
    let mut damaged = confirmed();
    damaged.bytes[(OTHER.start + 9 * SECTOR) as usize + 77] ^= 2;
    assert_eq!(block_on(previous::swap_back(&mut damaged, NEW.header())), Ok(false));
    let mut without_note = confirmed();
    block_on(previous::forget(&mut without_note)).expect("the chip works");
    assert_eq!(block_on(previous::swap_back(&mut without_note, NEW.header())), Ok(false));
}

#[test]
fn an_update_erases_only_the_areas_of_images_and_state() {
    let mut chip = accepted();
    boot(&mut chip).expect("the chip works");
    boot(&mut chip).expect("the chip works");
    for (sector, erasures) in chip.erasures.iter().enumerate() {
        let address = sector as u32 * SECTOR;
        let is_allowed = [STATE, PREVIOUS, OTHER, ACTIVE_IMAGE].iter().any(|range| range.contains(&address));
        assert!(*erasures == 0 || is_allowed, "the sector at {address:#x} was erased");
    }
    const { assert!(SMALL_LOG.end <= STATE.start) };
}
