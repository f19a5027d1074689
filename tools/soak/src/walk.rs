//! A day of walking with both feet, as fast as the emulator can, across the ends of all counters.

use anyhow::{Context, Result, ensure};
use client::{Client, Framed};
use emulation::{EmulatorConfig, FLASH_BYTES};
use emulator::{Board, Parts, Recorded, Scan, Time, Walk};
use figures::Figures;
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance::StanceRule;
use plantar::protocol::{Reset, Status, Step, ToDevice, ToHost};
use plantar::storage::Store;
use recording::{VirtualInsole, synthetic};
use std::path::Path;
use std::time::{Duration, Instant};
use testkit::nor_flash::{NorFlashChip, now};
use testkit::step;

/// Steps of a day, both feet together.
const STEPS: u32 = 50_000;
const SHORT_STEPS: u32 = 400;
/// Scans and steps until their numbers begin anew.
const SCANS_LEFT: u32 = 5_000;
const STEPS_LEFT: u32 = 20;
/// Steps with live frames, after which there are none: each of their bytes is a system call of the emulator.
const LIVE_STEPS: u32 = 1_000;
/// Steps between looks at the counters.
const LOOK: u32 = 100;
/// Reads of 50 ms without a message after which the board has stopped.
const SILENT_READS: u32 = 400;

/// A walk over and over, from any scan number on.
struct Again {
    walk: Recorded,
    first: u32,
}

impl Walk for Again {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.walk.scan(seq.wrapping_sub(self.first) % self.walk.scans(), codes)
    }
}

struct Walked {
    status: Status,
    scans: u32,
    steps: u32,
    live: u32,
    /// Deepest stack at the first look and at the last.
    stack_bytes: (u32, u32),
}

pub fn soak(firmware: &Path, short: bool, figures: &mut Figures) -> Result<()> {
    let steps = if short { SHORT_STEPS } else { STEPS } / 2;
    let begin = Instant::now();
    let feet = std::thread::scope(|scope| {
        let feet = [Side::Left, Side::Right].map(|side| scope.spawn(move || foot(firmware, side, steps)));
        feet.map(|foot| foot.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let [left, right] = feet;
    let feet = [left?, right?];
    let sum = |of: fn(&Walked) -> u32| feet.iter().map(of).sum::<u32>();
    let hours = f64::from(feet[0].scans) / 100.0 / 3600.0;
    figures.add("walk.steps", sum(|foot| foot.steps), "steps of both feet, each once and equal to a replay's");
    figures.add("walk.hours", (hours * 100.0).round() / 100.0, "hours of walking at 100 frames a second");
    figures.add("walk.frames", sum(|foot| foot.status.frames), "frames of both feet");
    figures.add(
        "walk.frames_missed",
        sum(|foot| foot.status.frames_missed),
        "frames that the matrix did not answer in time, counted",
    );
    figures.add(
        "walk.frames_overrun",
        sum(|foot| foot.status.frames_overrun),
        "frames that processing had no room for, counted",
    );
    figures.add("walk.live", sum(|foot| foot.live), "live frames received, in the first 1,000 steps of each foot");
    let deeper = feet.iter().map(|foot| foot.stack_bytes.1 - foot.stack_bytes.0).max();
    figures.add(
        "walk.stack_growth_bytes",
        deeper,
        "how much deeper the stack was at the end than after the first minutes",
    );
    let speed = f64::from(feet[0].scans) / 100.0 / begin.elapsed().as_secs_f64();
    figures.add("walk.speed", speed.round(), "times as fast as walking");
    Ok(())
}

fn foot(firmware: &Path, side: Side, steps: u32) -> Result<Walked> {
    let walk = synthetic::SyntheticWalk { steps: 20, side, ..Default::default() };
    let recording = synthetic::walk(&walk).recording;
    let worn = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
    let first = u32::MAX - SCANS_LEFT;
    let again = || Again { walk: Recorded::new(recording.clone(), worn.clone()), first };
    let first_step = u32::MAX - STEPS_LEFT;
    let mut chip = NorFlashChip::new(FLASH_BYTES);
    now(async {
        let mut store = Store::open(Some(&mut chip), Reset::Power).await;
        store.push_step(&step(first_step.wrapping_sub(1))).await?;
        store.acknowledge(first_step.wrapping_sub(1)).await
    })
    .ok()
    .context("the chip works")?;

    let head = EmulatorConfig { first_scan: first, ..EmulatorConfig::new(worn.setup) };
    let parts = Parts { flash: Some(chip.bytes), ..Parts::default() };
    let board = Board::start_with(firmware, &head, &worn.cells, Time::Max, again(), &parts)?;
    let link = board.link()?;
    link.set_read_timeout(Some(Duration::from_millis(50)))?;
    let mut client = Client::connect(Framed::new(link), Duration::from_secs(20))?;
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    client.set_tissue(&tissue)?;
    client.send(ToDevice::Stream { live: true })?;
    board.play();

    // What a host computes of the same codes.
    let mut replay = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    replay.set_up(worn.setup, worn.cells.iter().copied())?;
    replay.set_tissue(&tissue).map_err(anyhow::Error::msg)?;
    replay.count_steps_from(first_step);
    let mut walked = again();
    let mut codes = vec![0; worn.cells.len()];
    let mut scans = 0;
    let mut expected = || loop {
        let seq = first.wrapping_add(scans);
        walked.scan(seq, &mut codes);
        scans += 1;
        if replay.frame(seq, &codes) {
            return Some(Step::new(&replay.whole_step()?));
        }
    };

    let (mut done, mut live, mut lost, mut stack_bytes, mut silent) = (0, 0, None, None, 0);
    let status = loop {
        match client.receive()? {
            Some(ToHost::Live(_)) => live += 1,
            Some(ToHost::Step(step)) => {
                let wanted = expected();
                ensure!(
                    wanted == Some(Step { start_unix_us: None, ..step }),
                    "step {done} of the {} foot is not a replay's: {step:?}, {wanted:?}",
                    side.name()
                );
                client.send(ToDevice::Acknowledge { step: step.step })?;
                done += 1;
                if done == steps {
                    break client.status()?;
                }
                if done == LIVE_STEPS {
                    // What waits at this moment is never sent.
                    lost = Some(client.counters().frames_lost);
                    client.send(ToDevice::Stream { live: false })?;
                }
                if done % LOOK == 0 {
                    client.send(ToDevice::GetStatus)?;
                }
                if done % 1000 == 0 {
                    eprintln!("{} foot: {done} of {steps} steps", side.name());
                }
            }
            Some(ToHost::Status(status)) => drop(stack_bytes.get_or_insert(status.stack_bytes)),
            Some(ToHost::Hello(hello)) => anyhow::bail!("the insole restarted: {:?}", hello.last_panic),
            Some(_) => {}
            None => {
                silent += 1;
                ensure!(silent < SILENT_READS, "the board has fallen silent");
                continue;
            }
        }
        silent = 0;
    };
    let counters = client.counters();
    let lost = lost.unwrap_or(counters.frames_lost);
    ensure!(lost == 0 && counters.crc_errors == 0, "{lost} live frames were lost: {counters:?}");
    ensure!(status.steps_dropped == 0 && status.not_stored == 0, "steps were dropped: {status:?}");
    let accounted = status.frames + status.frames_missed + status.frames_overrun;
    ensure!(
        board.plant().scans().wrapping_sub(first) - accounted <= 10,
        "frames are missing and not counted: {status:?}"
    );
    let stack_bytes = (stack_bytes.unwrap_or(status.stack_bytes), status.stack_bytes);
    Ok(Walked { status, scans: accounted, steps: done, live, stack_bytes })
}
