//! Instructions of one frame on the emulated Cortex-M4F, raw codes to encoded live message.

use anyhow::{Result, bail};
use client::{Client, Framed};
use emulation::EmulatorConfig;
use emulator::{Board, Scan, Time, Walk};
use figures::Figures;
use parameters::{InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::protocol::{Status, ToDevice, ToHost};
use plantar::{Region, Side};
use recording::{Recording, VirtualInsole, synthetic};
use std::path::Path;
use std::time::Duration;

const CELLS: usize = 240;
const SCANS: u32 = 200;
/// Reads of 50 ms without a message after which the board has stopped.
const SILENT_READS: u32 = 400;
/// One instruction takes a nanosecond of the emulator's time, a SysTick cycle 1/168 MHz.
const NS_PER_CYCLE: f64 = 1000.0 / 168.0;

/// A foot that comes down in the second frame and stays: the same frame over and over, every cell of every region loaded.
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
        ("frame_instructions", ContactRule::COUNTED, "240 loaded cells, 8 regions, codes to encoded live message"),
        (
            "frame_instructions_fractional",
            ContactRule { full_kpa: 100.0, ..ContactRule::COUNTED },
            "the same with fractional contact",
        ),
    ] {
        let worn = VirtualInsole::new(&recording, contact, StanceRule::WALKING);
        let mut codes = vec![0; CELLS];
        worn.codes(recording.frame(0), &mut codes);
        for region in Region::ALL {
            if !worn.cells.iter().zip(&codes).any(|(cell, &code)| cell.cell.region == region && code > 0) {
                bail!("{} is not loaded", region.name());
            }
        }
        let status = walk_through(firmware, &worn, Time::Counted, Loaded(codes))?;
        // The least: others were interrupted by scanning.
        let (least, _) = status.frame_cycles;
        figures.add(key, (f64::from(least) * NS_PER_CYCLE).round(), meaning);
    }
    Ok(())
}

/// Lets the emulated board feel a whole walk, with a live stream, and returns its counters.
pub fn walk_through(firmware: &Path, worn: &VirtualInsole, time: Time, walk: impl Walk) -> Result<Status> {
    let scans = walk.scans();
    let head = EmulatorConfig::new(worn.setup);
    let board = Board::start(firmware, &head, &worn.cells, time, walk)?;
    let link = board.link()?;
    link.set_read_timeout(Some(Duration::from_millis(50)))?;
    let mut client = Client::connect(Framed::new(link), Duration::from_secs(20))?;
    client.set_tissue(&Parameters::typical(InsoleSize::default()).tissue())?;
    client.stream()?;
    board.play();
    loop {
        client.send(ToDevice::GetStatus)?;
        let mut silent = 0;
        let status = loop {
            match client.receive()? {
                Some(ToHost::Status(status)) => break status,
                Some(ToHost::Hello(hello)) => bail!("the board restarted: {:?}", hello.last_panic),
                Some(_) => silent = 0,
                None if silent > SILENT_READS => bail!("the board has fallen silent"),
                None => silent += 1,
            }
        };
        if status.frames >= scans {
            return Ok(status);
        }
    }
}
