//! Counts instructions on the emulated Cortex-M4F: those for a frame (from raw codes to the encoded live message), for the
//! packing of cells, and for the tracking of force laws in each step.

use anyhow::{Context, Result, bail};
use bench::Figures;
use client::{Client, Framed, READ_TIMEOUT};
use emulation::EmulatorConfig;
use emulator::{Board, Link, Scan, Time, Walk};
use parameters::{InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::{AreaFilter, Identified, Tissue};
use plantar::protocol::{CellStream, Resolution, Status, ToDevice, ToHost};
use plantar::{Region, Side};
use recording::{Recording, VirtualInsole, synthetic};
use std::path::Path;
use std::time::{Duration, Instant};

/// Number of cells of the layout.
const CELLS: usize = 240;
/// Number of scans of the walk.
const SCANS: u32 = 200;
/// The board counts as stalled after this number of successive read timeouts without a message.
const MAX_TIMEOUTS: u32 = 2_000;
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

/// As [`Loaded`], with one bit of converter noise: each code is exact, or higher by one step of the 12-bit converter.
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

/// Counts the instructions of a frame with counted cells and with covered shares ([`ContactRule`]), of the packing of cells,
/// and of the tracking of force laws.
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
            "instructions for the frame of frame_instructions, with covered shares",
        ),
    ] {
        let mut virtual_insole = VirtualInsole::new(&recording, contact, StanceRule::ADAPTIVE);
        let mut codes = vec![0; CELLS];
        virtual_insole.codes(recording.frame(0), &mut codes);
        for region in Region::ALL {
            if !virtual_insole.cells.iter().zip(&codes).any(|(cell, &code)| cell.region == region && code > 0) {
                bail!("the computed frame of {CELLS} cells loads no cell of the region {}", region.name());
            }
        }
        let measure = |insole: &VirtualInsole, codes: &[u16]| {
            instructions(&walk_through(firmware, insole, Time::Counted, Loaded(codes.to_vec()), None)?)
        };
        figures.add(key, measure(&virtual_insole, &codes)?, meaning);
        if contact.full_kpa > 0.0 {
            figures.add(
                "tracking_instructions",
                tracking(firmware, &virtual_insole, &codes)?,
                "at most 2,000: instructions that tracking of the force laws adds to a step of 0.64 s at 100 Hz with 8 regions",
            );
        } else {
            let noisy = || Noisy(codes.clone(), fastrand::Rng::with_seed(1));
            let all = Some(CellStream { resolution: Resolution::Converter, every: 1 });
            let with = walk_through(firmware, &virtual_insole, Time::Counted, noisy(), all)?;
            let without = walk_through(firmware, &virtual_insole, Time::Counted, noisy(), None)?;
            figures.add(
                "cells_instructions",
                instructions(&with)? - instructions(&without)?,
                "at most 6,000: instructions that pack 240 loaded cells with one bit of noise, if they are streamed",
            );
            for (cell, gain) in virtual_insole.cells.iter_mut().zip([0.8, 1.25].into_iter().cycle()) {
                cell.gain = gain;
            }
            virtual_insole.codes(recording.frame(0), &mut codes);
            figures.add(
                "frame_instructions_gains",
                measure(&virtual_insole, &codes)?,
                "instructions for the frame of frame_instructions, with cells whose gains are 0.8 and 1.25 in turn",
            );
        }
    }
    Ok(())
}

/// Number of scans of a stride of [`Striding`].
const STRIDE: u32 = 100;
/// Number of scans of the stance of a stride.
const STANCE: u32 = 64;
/// Number of strides. The insole adapts the force laws from the tenth on.
const STRIDES: u32 = 80;

/// A foot that loads every cell of every region in each stance, most in the middle of the stance.
struct Striding(Vec<u16>);

impl Walk for Striding {
    fn scans(&self) -> u32 {
        STRIDE * STRIDES
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        let phase = seq % STRIDE;
        let share = phase.min(STANCE.saturating_sub(phase)) * 2;
        for (code, &most) in codes.iter_mut().zip(&self.0) {
            *code = (u32::from(most) * share / STANCE) as u16;
        }
        Scan::Whole
    }
}

/// Instructions that tracking of the force laws ([`plantar::pipeline::track`]) adds to the evaluation of a step: the difference
/// to a step with parameters that are not tracked. These have a model force of 0, so that no sample is added to the sums of the
/// tracking either. Tracking takes the same time in each region, so eight times the median over the regions is used: the median
/// does not change if a scan interrupts the same region in every step.
fn tracking(firmware: &Path, insole: &VirtualInsole, codes: &[u16]) -> Result<f64> {
    let law = |stiffness_pa, damping_pa_s| ForceLaw {
        // pi A B exceeds every area. With the coefficients of the tracked law, the model force is positive in all samples.
        ab_m2: 0.01,
        c_m: 0.01,
        stiffness_pa,
        damping_pa_s,
        n: -0.5,
        m: 1.0,
    };
    let measure = |tissue: Tissue, is_tracked: bool| -> Result<[f64; 9]> {
        let board = Board::start(
            firmware,
            &EmulatorConfig::new(insole.setup),
            &insole.cells,
            Time::Counted,
            Striding(codes.to_vec()),
        )?;
        let mut client = connect(&board)?;
        let contact = insole.setup.contact;
        match is_tracked {
            true => client.set_identified_tissue(
                &tissue,
                Identified {
                    contact,
                    filter: AreaFilter::Direct,
                    side: Some(Side::Right),
                    steps: STRIDES,
                    regions: u8::MAX,
                },
            )?,
            false => client.set_tissue(&tissue)?,
        }
        play(&board, &mut client, STRIDE * STRIDES)?;
        // The log has nine numbers of cycles for each step: for its eight regions, and for the rest. Interrupts lengthen most
        // steps, but not each part of each step.
        let mut least = [u32::MAX; 9];
        for entry in board
            .log(firmware)?
            .iter()
            .filter(|entry| entry.text.contains("cycles for each region"))
            .skip(FIRST_ADAPTED)
        {
            let (_, cycles) = entry.text.split_once('[').context("the log has no cycles")?;
            let numbers =
                cycles.split(|letter: char| !letter.is_ascii_digit()).filter_map(|number| number.parse::<u32>().ok());
            least.iter_mut().zip(numbers).for_each(|(least, cycles)| *least = cycles.min(*least));
        }
        if least.contains(&u32::MAX) {
            bail!("the board has evaluated too few steps");
        }
        Ok(least.map(|cycles| f64::from(cycles) * NS_PER_CYCLE))
    };
    let tracked = measure(Tissue::new([law(1e5, 1e2); 8]), true)?;
    let untracked = measure(Tissue::new([law(0.0, 0.0); 8]), false)?;
    let mut added: [f64; 9] = std::array::from_fn(|part| tracked[part] - untracked[part]);
    let (regions, record) = added.split_at_mut(8);
    regions.sort_by(f64::total_cmp);
    Ok((8.0 * regions[3].midpoint(regions[4]) + record[0]).round())
}

/// Number of steps before the first one by which the force laws are adapted.
const FIRST_ADAPTED: usize = 9;

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
    let mut client = connect(&board)?;
    client.set_tissue(&Parameters::typical(InsoleSize::default()).tissue())?;
    client.stream()?;
    client.stream_cells(cells)?;
    play(&board, &mut client, scans)
}

fn connect(board: &Board) -> Result<Client<Framed<Link>>> {
    let mut link = board.link()?;
    link.set_read_timeout(Some(READ_TIMEOUT))?;
    Ok(Client::connect(Framed::new(link), Duration::from_secs(20))?)
}

/// Plays the walk, which has this number of scans, and returns the board's counters after it.
fn play(board: &Board, client: &mut Client<Framed<Link>>, scans: u32) -> Result<Status> {
    board.play();
    let mut timeouts = 0;
    let mut requested = Instant::now();
    loop {
        match client.receive()? {
            Some(ToHost::Status(status)) if status.frames >= scans => return Ok(status),
            Some(ToHost::Hello(hello)) => bail!("the board restarted: {:?}", hello.fault),
            Some(_) => timeouts = 0,
            None if timeouts > MAX_TIMEOUTS => bail!("the board has stopped sending"),
            // There is no message yet, but the answer to the last request may still arrive.
            None if requested.elapsed() < READ_TIMEOUT => {}
            None => {
                timeouts += 1;
                // A request interrupts the evaluation of frames and steps, so it is sent only while the board sends nothing.
                client.send(ToDevice::GetStatus)?;
                requested = Instant::now();
            }
        }
    }
}
