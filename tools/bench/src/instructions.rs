//! Counts the instructions of one frame on the emulated Cortex-M4F, from raw codes to the encoded live message.

use anyhow::{Result, bail};
use bench::Figures;
use client::{Client, Framed, READ_TIMEOUT};
use emulation::EmulatorConfig;
use emulator::{Board, Scan, Time, Walk};
use parameters::{InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{CellStream, Resolution, Status, ToDevice, ToHost};
use plantar::{Region, Side};
use recording::{Recording, VirtualInsole, synthetic};
use std::path::Path;
use std::time::Duration;

/// Number of cells of the layout.
const CELLS: usize = 240;
/// Number of scans of the walk.
const SCANS: u32 = 200;
/// The board counts as stalled after this number of successive read timeouts without a message.
const MAX_TIMEOUTS: u32 = 400;
/// Duration of a cycle of the board's cycle counter, SysTick at 168 MHz. An instruction takes 1 ns of emulated time, so this is
/// also the number of instructions for each cycle.
const NS_PER_CYCLE: f64 = 1000.0 / 168.0;

/// A foot that loads every cell of every region from the second frame on, always with the same codes.
struct Loaded(Vec<u16>);

impl Walk for Loaded {
    fn scans(&self) -> u32 {
        SCANS
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        if seq > 0 {
            codes.copy_from_slice(&self.0);
        }
        Scan::Whole
    }
}

/// The same foot with one bit of converter noise: each code is exact, or higher by one step of the 12-bit converter.
struct Noisy(Vec<u16>, fastrand::Rng);

impl Walk for Noisy {
    fn scans(&self) -> u32 {
        SCANS
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        if seq > 0 {
            for (code, &exact) in codes.iter_mut().zip(&self.0) {
                *code = exact.saturating_add(self.1.u16(..2) << 4);
            }
        }
        Scan::Whole
    }
}

/// Counts the instructions with counted cells and with covered shares.
pub fn measure(firmware: &Path, figures: &mut Figures) -> Result<()> {
    let layout = synthetic::insole(CELLS);
    let pressure_kpa = synthetic::loaded_frame(&layout);
    let recording = Recording {
        side: Side::Right,
        layout,
        rate_hz: 100.0,
        source: "every cell loaded".into(),
        t_s: vec![0.0],
        pressure_kpa,
    };
    for (key, contact, meaning) in [
        (
            "frame_instructions",
            ContactRule::COUNTED,
            "instructions for a frame with 240 loaded cells in 8 regions, from codes to encoded live message",
        ),
        (
            "frame_instructions_fractional",
            ContactRule { full_kpa: 100.0, ..ContactRule::COUNTED },
            "the same with covered shares",
        ),
    ] {
        let virtual_insole = VirtualInsole::new(&recording, contact, StanceRule::ADAPTIVE);
        let mut codes = vec![0; CELLS];
        virtual_insole.codes(recording.frame(0), &mut codes);
        for region in Region::ALL {
            if !virtual_insole.cells.iter().zip(&codes).any(|(cell, &code)| cell.cell.region == region && code > 0) {
                bail!("{} is not loaded", region.name());
            }
        }
        let measure = |walk: Loaded| instructions(&walk_through(firmware, &virtual_insole, Time::Counted, walk, None)?);
        figures.add(key, measure(Loaded(codes.clone()))?, meaning);
        if contact == ContactRule::COUNTED {
            let noisy = || Noisy(codes.clone(), fastrand::Rng::with_seed(1));
            let all = Some(CellStream { resolution: Resolution::Converter, every: 1 });
            let with = walk_through(firmware, &virtual_insole, Time::Counted, noisy(), all)?;
            let without = walk_through(firmware, &virtual_insole, Time::Counted, noisy(), None)?;
            figures.add(
                "cells_instructions",
                instructions(&with)? - instructions(&without)?,
                "at most 6,000: packing of 240 loaded cells with one bit of noise, only while cells are streamed",
            );
        }
    }
    Ok(())
}

/// Instructions of the frame with the fewest cycles, because interrupts of the scan lengthen others.
fn instructions(status: &Status) -> Result<f64> {
    let (least, _) = status.frame_cycles;
    Ok((f64::from(least) * NS_PER_CYCLE).round())
}

/// Plays a whole walk into the emulated board while the live stream is on, and the stream of cells, if one is given. Returns the
/// board's counters.
pub fn walk_through(
    firmware: &Path,
    insole: &VirtualInsole,
    time: Time,
    walk: impl Walk,
    cells: Option<CellStream>,
) -> Result<Status> {
    let scans = walk.scans();
    let config = EmulatorConfig::new(insole.setup);
    let board = Board::start(firmware, &config, &insole.cells, time, walk)?;
    let link = board.link()?;
    link.set_read_timeout(Some(READ_TIMEOUT))?;
    let mut client = Client::connect(Framed::new(link), Duration::from_secs(20))?;
    client.set_tissue(&Parameters::typical(InsoleSize::default()).tissue())?;
    client.stream()?;
    client.stream_cells(cells)?;
    board.play();
    loop {
        client.send(ToDevice::GetStatus)?;
        let mut timeouts = 0;
        let status = loop {
            match client.receive()? {
                Some(ToHost::Status(status)) => break status,
                Some(ToHost::Hello(hello)) => bail!("the board restarted: {:?}", hello.last_panic),
                Some(_) => timeouts = 0,
                None if timeouts > MAX_TIMEOUTS => bail!("the board has stopped sending"),
                None => timeouts += 1,
            }
        };
        if status.frames >= scans {
            return Ok(status);
        }
    }
}
