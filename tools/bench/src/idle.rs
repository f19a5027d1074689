//! Measures the processor time of QEMU while the emulated board processes a walk in real time: it is small as long as the
//! emulated processor is idle between its interrupts.

use anyhow::{Context, Result};
use bench::Figures;
use client::{Client, Framed};
use emulation::EmulatorConfig;
use emulator::{Board, Looped, Recorded, Time};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{VirtualInsole, synthetic};
use std::path::Path;
use std::time::{Duration, Instant};

/// Duration of the measurement.
const MEASURED: Duration = Duration::from_secs(6);
/// Time within which the insole must answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(20);
/// Number of clock ticks per second; times in `/proc` are numbers of these ticks.
const USER_HZ: f64 = 100.0;

/// Measures the share of a core that QEMU uses at 100 Hz with a live stream, without the sensor plant, which runs in this
/// process. On a host without `/proc`, adds no figure.
pub fn measure(firmware: &Path, figures: &mut Figures) -> Result<()> {
    if !Path::new("/proc/self/stat").exists() {
        return Ok(());
    }
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: 4, ..Default::default() }).recording;
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let (config, cells) = (EmulatorConfig::new(virtual_insole.setup), virtual_insole.cells.clone());
    let walk = Looped(Recorded::new(walk, virtual_insole));
    let board = Board::start(firmware, &config, &cells, Time::Real, walk)?;
    let mut link = board.link()?;
    link.set_read_timeout(Some(client::READ_TIMEOUT))?;
    let mut client = Client::connect(Framed::new(link), ANSWER_TIMEOUT)?;
    client.stream()?;
    let (start, before_s) = (Instant::now(), processor_s(board.process_id())?);
    while start.elapsed() < MEASURED {
        client.receive()?;
    }
    let share = (processor_s(board.process_id())? - before_s) / start.elapsed().as_secs_f64();
    figures.add(
        "emulator_cpu_share",
        (share * 100.0).round() / 100.0,
        "at most 0.25: share of a core that QEMU uses for one foot at 100 Hz in real time",
    );
    Ok(())
}

/// Processor time that a process has used so far, s.
fn processor_s(process: u32) -> Result<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat"))?;
    // The name in parentheses may contain spaces. The field after it is field 3; user and system time are fields 14 and 15.
    let fields = stat.rsplit_once(')').context("the process has no name")?.1;
    let ticks = fields.split_whitespace().skip(11).take(2).map(str::parse::<f64>);
    Ok(ticks.sum::<Result<f64, _>>()? / USER_HZ)
}
