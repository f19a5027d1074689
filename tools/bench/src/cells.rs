//! Measures the lengths of packed frames of all cells in stance and in swing, with one bit of noise.

use anyhow::Result;
use bench::Figures;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{CellCoder, MAX_MESSAGE, Resolution, ToHost, encode};
use recording::{Cell, Recording, VirtualInsole, jiku, pedar, synthetic};
use std::path::Path;

/// The device's usual number of cells.
const CELLS: usize = 240;
/// Frames per second.
const RATE_HZ: f64 = 100.0;
/// A frame with at least this force belongs to a stance, N: the threshold of heel strike of `StanceRule::ABSOLUTE`.
const STANCE_N: f64 = 30.0;
/// One step of the 12-bit converter, in codes of 16 bits.
const NOISE: u16 = 1 << 4;
/// Number of walkers.
const WALKERS: usize = 10;
/// Number of steps of each walker.
const TRIALS: usize = 12;

/// Measures walkers on a plate and, if there is a folder `recordings` with recordings of people, the in-shoe recording in it,
/// both with the device's usual number of cells. `data` is the folder of the walkers' data set, SpeedPP2DS.
pub fn measure(data: &Path, recordings: Option<&Path>, figures: &mut Figures) -> Result<()> {
    let import = |walker| jiku::import(data, walker, 0..TRIALS, &mut |_, _| ());
    let on_plate = (0..WALKERS).map(|walker| Ok(import(walker)?.at_rate(RATE_HZ)?.binned(CELLS)?));
    add("", &on_plate.collect::<Result<Vec<_>>>()?, figures)?;
    let Some(folder) = recordings.map(|folder| folder.join("pedar")) else { return Ok(()) };
    let (file, geometry) = (folder.join("pedar_example.asc"), folder.join("geometry.csv"));
    let in_shoe = [Side::Left, Side::Right]
        .map(|side| Ok(on_device_cells(&pedar::import(&file, &geometry, side, &mut |_, _| ())?)));
    add(".pedar", &in_shoe.into_iter().collect::<Result<Vec<_>>>()?, figures)
}

/// The same walk on an insole of the same size with the device's number of cells, each of which reads the pressure of the nearest
/// cell of the recording.
fn on_device_cells(walk: &Recording) -> Recording {
    let mut layout = synthetic::insole(CELLS);
    let axes: [fn(&mut Cell) -> &mut f64; 2] = [|cell| &mut cell.x_mm, |cell| &mut cell.y_mm];
    for axis in axes {
        let extent = |cells: &[Cell]| {
            let positions_mm = || cells.iter().map(|&(mut cell)| *axis(&mut cell));
            (positions_mm().fold(f64::INFINITY, f64::min), positions_mm().fold(f64::NEG_INFINITY, f64::max))
        };
        let (from_mm, to_mm) = extent(&walk.layout.cells);
        let (device_from_mm, device_to_mm) = extent(&layout.cells);
        for cell in &mut layout.cells {
            let position_mm = axis(cell);
            *position_mm =
                from_mm + (*position_mm - device_from_mm) * (to_mm - from_mm) / (device_to_mm - device_from_mm);
        }
    }
    let nearest: Vec<usize> = layout
        .cells
        .iter()
        .map(|to| {
            let distance2 = |from: &Cell| (from.x_mm - to.x_mm).powi(2) + (from.y_mm - to.y_mm).powi(2);
            let cells = walk.layout.cells.iter().enumerate();
            let nearest = cells.min_by(|(_, a), (_, b)| distance2(a).total_cmp(&distance2(b)));
            nearest.map_or(0, |(index, _)| index)
        })
        .collect();
    // The cells share the area of the recording's cells, so that forces are about the same.
    let area_mm2 = walk.layout.cells.iter().map(|cell| cell.area_mm2).sum::<f64>() / CELLS as f64;
    layout.cells.iter_mut().for_each(|cell| cell.area_mm2 = area_mm2);
    let frames = walk.pressure_kpa.chunks_exact(walk.cells());
    let pressure_kpa = frames.flat_map(|frame| nearest.iter().map(|&index| frame[index])).collect();
    Recording { layout, pressure_kpa, ..walk.clone() }
}

/// Packs all frames of these walks, and adds their mean lengths to the figures. `suffix` is the end of the keys.
fn add(suffix: &str, walks: &[Recording], figures: &mut Figures) -> Result<()> {
    let mut random = fastrand::Rng::with_seed(1);
    let mut bytes = [0; 2];
    let mut frames = [0; 2];
    // Length of a frame in plain codes, mean of the walks.
    let mut plain_bytes = 0.0;
    for walk in walks {
        let insole = VirtualInsole::new(walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let mut coder = CellCoder::new(Resolution::Converter);
        let mut codes = [0; DEVICE_CELLS];
        let codes = &mut codes[..walk.cells()];
        for i in 0..walk.frames() {
            insole.codes_of(walk, i, codes);
            // The code of an unloaded cell remains 0: its noise is that of the amplifiers and the converter, about 4 codes of 16
            // bits (docs/hardware.md), which is less than one step of the converter.
            codes
                .iter_mut()
                .filter(|code| **code > 0)
                .for_each(|code| *code = code.saturating_add(random.u16(..2) * NOISE));
            let mut message = [0; MAX_MESSAGE];
            let len = encode(&ToHost::Cells(coder.pack(i as u32, 0, codes)), &mut message)?.len();
            let phase = usize::from(walk.force_n(i) < STANCE_N);
            bytes[phase] += len;
            frames[phase] += 1;
        }
        plain_bytes += walk.cells() as f64 * f64::from(Resolution::Converter.bits()) / 8.0 / walks.len() as f64;
    }
    for (phase, name, limit) in [(0, "stance", 60), (1, "swing", 10)] {
        let mean = bytes[phase] as f64 / frames[phase] as f64;
        figures.add(
            &format!("cells_bytes_per_frame.{name}{suffix}"),
            (mean * 10.0).round() / 10.0,
            &format!("bytes, mean of {} frames of {} recordings with one bit of noise", frames[phase], walks.len()),
        );
        figures.add(
            &format!("cells_percent.{name}{suffix}"),
            (mean / plain_bytes * 1000.0).round() / 10.0,
            &format!("at most {limit}: mean length of such a frame in % of its plain codes of 12 bits"),
        );
    }
    Ok(())
}
