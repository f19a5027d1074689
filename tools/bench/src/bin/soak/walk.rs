//! Simulates a day of walking with both feet, as fast as the emulator can run. The sequence numbers wrap during the walk.

use anyhow::{Result, anyhow, bail, ensure};
use bench::Figures;
use client::{Client, Framed, READ_TIMEOUT};
use emulation::{EmulatorConfig, FLASH_BYTES};
use emulator::{Board, Hardware, Link, Recorded, Scan, Time, Walk};
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Bout, LoadRecord, Reset, Status, Step, ToDevice, ToHost};
use plantar::storage::Store;
use recording::{VirtualInsole, synthetic};
use std::path::Path;
use std::time::{Duration, Instant};
use testkit::nor_flash::{NorFlashChip, block_on};
use testkit::step;

/// Number of steps of both feet together.
const STEPS: u32 = 50_000;
/// Number of steps of both feet together in the short test.
const SHORT_STEPS: u32 = 400;
/// The number of the first scan is this number below the largest one, after which the numbers continue with 0.
const SCANS_BEFORE_WRAP: u32 = 5_000;
/// The same for the number of the first record.
const RECORDS_BEFORE_WRAP: u32 = 20;
/// The live stream is on during this number of steps. It is then switched off, because each of its bytes costs the emulator a
/// system call.
const LIVE_STEPS: u32 = 1_000;
/// Number of steps between two requests for the status.
const STATUS_INTERVAL: u32 = 100;
/// The board counts as stalled after this number of successive read timeouts without a message.
const MAX_TIMEOUTS: u32 = 2_000;

/// A walk that is repeated without end.
struct Repeated {
    walk: Recorded,
    /// Number of the first scan.
    first: u32,
}

impl Walk for Repeated {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.walk.scan(seq.wrapping_sub(self.first) % self.walk.scans(), codes)
    }
}

/// The results of one foot.
struct Walked {
    /// The insole's counters at the end.
    status: Status,
    /// Number of scans that the insole counted, including missed and dropped ones.
    scans: u32,
    /// Number of received steps.
    steps: u32,
    /// Number of received live frames.
    live: u32,
    /// Deepest stack at the first status and at the last, bytes.
    stack_bytes: (u32, u32),
}

/// Walks [`STEPS`] steps, or [`SHORT_STEPS`] if `short` is true, with both feet in parallel, each on a board of its own.
pub fn soak(firmware: &Path, short: bool, figures: &mut Figures) -> Result<()> {
    let steps = if short { SHORT_STEPS } else { STEPS } / 2;
    let begin = Instant::now();
    let feet = std::thread::scope(|scope| {
        let feet = [Side::Left, Side::Right].map(|side| scope.spawn(move || walk(firmware, side, steps)));
        feet.map(|foot| foot.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let [left, right] = feet;
    let feet = [left?, right?];
    let sum = |count: fn(&Walked) -> u32| feet.iter().map(count).sum::<u32>();
    let hours = f64::from(feet[0].scans) / 100.0 / 3600.0;
    figures.add("walk.steps", sum(|foot| foot.steps), "steps of both feet, each received once and equal to a replay");
    figures.add("walk.hours", (hours * 100.0).round() / 100.0, "hours of walking at 100 frames per second");
    figures.add("walk.frames", sum(|foot| foot.status.frames), "frames of both feet");
    figures.add(
        "walk.frames_missed",
        sum(|foot| foot.status.frames_missed),
        "frames without a complete scan, because the matrix did not answer in time",
    );
    figures.add(
        "walk.frames_overrun",
        sum(|foot| foot.status.frames_overrun),
        "frames that the insole dropped, because processing was late",
    );
    figures.add(
        "walk.live",
        sum(|foot| foot.live),
        "live frames received during the first 1,000 steps of each foot, or all if fewer; none lost",
    );
    let growth = feet.iter().map(|foot| foot.stack_bytes.1 - foot.stack_bytes.0).max();
    figures.add(
        "walk.stack_growth_bytes",
        growth,
        "growth of the deepest stack from the first minutes to the end, bytes",
    );
    let speed = f64::from(feet[0].scans) / 100.0 / begin.elapsed().as_secs_f64();
    figures.add("walk.speed", speed.round(), "speed of the walk, relative to real time");
    Ok(())
}

/// Plays the walk of one foot into an emulated board, and compares the steps with a replay.
fn walk(firmware: &Path, side: Side, steps: u32) -> Result<Walked> {
    let walk = synthetic::SyntheticWalk { steps: 20, side, ..Default::default() };
    let recording = synthetic::walk(&walk).recording;
    let insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let first_scan = u32::MAX - SCANS_BEFORE_WRAP;
    let first_record = u32::MAX - RECORDS_BEFORE_WRAP;
    let repeated = || Repeated { walk: Recorded::new(recording.clone(), insole.clone()), first: first_scan };

    let config = EmulatorConfig { first_scan, ..EmulatorConfig::new(insole.setup) };
    let hardware = Hardware { flash: Some(used_chip(first_record)?), ..Hardware::default() };
    let board = Board::start_with(firmware, &config, &insole.cells, Time::Fastest, repeated(), &hardware)?;
    let mut link = board.link()?;
    link.set_read_timeout(Some(READ_TIMEOUT))?;
    let mut client = Client::connect(Framed::new(link), Duration::from_secs(20))?;
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    client.set_tissue(&tissue)?;
    client.send(ToDevice::Stream { live: true })?;
    board.play();

    let mut replay = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    replay.set_up(insole.setup, insole.cells.iter().copied())?;
    replay.set_tissue(&tissue).map_err(anyhow::Error::msg)?;
    replay.set_next_record_number(first_record);
    let mut walk = repeated();
    let mut codes = vec![0; insole.cells.len()];
    let mut scans = 0;
    let expected = || loop {
        let seq = first_scan.wrapping_add(scans);
        walk.scan(seq, &mut codes);
        scans += 1;
        if replay.frame(seq, &codes) {
            return Some(Step::new(&replay.whole_step()?).into());
        }
        if let Some(bout) = replay.take_bout() {
            return Some(Bout::new(&bout).into());
        }
    };

    let walked = receive(&mut client, side, steps, expected)?;
    ensure!(
        board.plant().scans().wrapping_sub(first_scan) - walked.scans <= 10,
        "the plant played at least 11 scans more than the insole counted: {:?}",
        walked.status
    );
    Ok(walked)
}

/// A flash chip on which the record before `first_record` was stored and acknowledged.
fn used_chip(first_record: u32) -> Result<Vec<u8>> {
    let mut chip = NorFlashChip::new(FLASH_BYTES);
    let last_record = first_record.wrapping_sub(1);
    block_on(async {
        let mut store = Store::open(Some(&mut chip), Reset::Power).await;
        store.push_record(step(last_record)).await?;
        store.acknowledge(last_record).await
    })
    .map_err(|error| anyhow!("cannot prepare the flash chip: {error:?}"))?;
    Ok(chip.bytes)
}

/// Receives and acknowledges steps and load bouts until `steps` steps have arrived, and compares each with the next one of a
/// replay, which `expected` returns.
fn receive(
    client: &mut Client<Framed<Link>>,
    side: Side,
    steps: u32,
    mut expected: impl FnMut() -> Option<LoadRecord>,
) -> Result<Walked> {
    let (mut received, mut live, mut lost, mut first_stack_bytes, mut timeouts) = (0, 0, None, None, 0);
    let status = loop {
        match client.receive()? {
            Some(ToHost::Live(_)) => live += 1,
            Some(ToHost::Step(step)) => {
                let expected = expected();
                ensure!(
                    expected == Some(Step { start_unix_us: None, ..step }.into()),
                    "step {received} of the {} foot differs from the replay: {step:?}, {expected:?}",
                    side.name()
                );
                client.send(ToDevice::Acknowledge { number: step.step })?;
                received += 1;
                if received == steps {
                    break client.status()?;
                }
                if received == LIVE_STEPS {
                    // The count ends here, because live frames that the insole has queued are not sent any more.
                    lost = Some(client.counters().frames_lost);
                    client.send(ToDevice::Stream { live: false })?;
                }
                if received % STATUS_INTERVAL == 0 {
                    client.send(ToDevice::GetStatus)?;
                }
                if received % 1000 == 0 {
                    eprintln!("{} foot: {received} of {steps} steps", side.name());
                }
            }
            Some(ToHost::Bout(bout)) => {
                let expected = expected();
                ensure!(
                    expected == Some(Bout { start_unix_us: None, ..bout }.into()),
                    "load bout {} of the {} foot differs from the replay: {bout:?}, {expected:?}",
                    bout.number,
                    side.name()
                );
                client.send(ToDevice::Acknowledge { number: bout.number })?;
            }
            Some(ToHost::Status(status)) => drop(first_stack_bytes.get_or_insert(status.stack_bytes)),
            Some(ToHost::Hello(hello)) => bail!("the insole restarted: {:?}", hello.fault),
            Some(_) => {}
            None => {
                timeouts += 1;
                ensure!(timeouts < MAX_TIMEOUTS, "the board has stopped sending");
                continue;
            }
        }
        timeouts = 0;
    };
    let counters = client.counters();
    let lost = lost.unwrap_or(counters.frames_lost);
    ensure!(lost == 0 && counters.crc_errors == 0, "{lost} live frames were lost: {counters:?}");
    ensure!(
        status.records_dropped == 0 && status.not_stored == 0,
        "records were dropped, or items could not be stored: {status:?}"
    );
    let scans = status.frame_times();
    let stack_bytes = (first_stack_bytes.unwrap_or(status.stack_bytes), status.stack_bytes);
    Ok(Walked { status, scans, steps: received, live, stack_bytes })
}
