//! The readings of an insole under known pressures that are the same on all cells, such as those of the bladder of a calibration
//! device.

use crate::{Error, Result, output};
use plantar::Side;
use plantar::pipeline::calibrate::SensorLaw;
use plantar::pipeline::setup::{DEVICE_CELLS, Setup, SetupCell};
use serde::{Deserialize, Serialize};
use std::io::Write as _;
use std::path::Path;

/// Version of the file format.
const VERSION: u32 = 1;
/// Largest pressure of a plateau, kPa.
pub const MAX_PLATEAU_KPA: f64 = 3000.0;
/// The remedy for a file that cannot be used.
const REMEDY: &str = "measure the plateaus again with `plantar calibrate measure`";

/// The readings of one insole at all measured pressures. It is stored as a JSON file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plateaus {
    version: u32,
    /// The foot.
    pub side: Side,
    /// Serial number of the insole; empty if it has none.
    pub serial_number: String,
    /// Identifies the layout of the insole.
    pub layout_id: u32,
    /// The sensor law of the insole's firmware. The codes do not depend on it.
    pub law: SensorLaw,
    /// The cells in the order of their codes.
    pub cells: Vec<PlateauCell>,
    /// The plateaus in the order of measurement.
    pub plateaus: Vec<Plateau>,
}

/// The place of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlateauCell {
    /// Position in foot coordinates, mm: x from medial to lateral, y from heel to toes.
    pub x_mm: f32,
    /// See [`PlateauCell::x_mm`].
    pub y_mm: f32,
    /// Area, mm2.
    pub area_mm2: f32,
}

/// The readings during a constant pressure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plateau {
    /// The pressure on all cells, kPa, 0 to [`MAX_PLATEAU_KPA`]; 0 is the insole without load.
    pub pressure_kpa: f64,
    /// Number of frames that were measured.
    pub frames: u32,
    /// Mean code of each cell.
    pub codes: Vec<f32>,
    /// Change of the code of each cell: the mean of the last third of the frames minus that of the first third.
    pub changes: Vec<f32>,
}

impl Plateau {
    /// The mean codes of `frames`, each of which has the codes of all cells; `None` for fewer than three frames.
    pub fn of(pressure_kpa: f64, frames: &[Vec<u16>]) -> Option<Self> {
        let third = frames.len() / 3;
        if third == 0 {
            return None;
        }
        let cells = frames[0].len();
        let mean = |part: &[Vec<u16>], cell: usize| {
            part.iter().map(|codes| f64::from(codes[cell])).sum::<f64>() / part.len() as f64
        };
        let change = |cell| mean(&frames[frames.len() - third..], cell) - mean(&frames[..third], cell);
        Some(Self {
            pressure_kpa,
            frames: frames.len() as u32,
            codes: (0..cells).map(|cell| mean(frames, cell) as f32).collect(),
            changes: (0..cells).map(|cell| change(cell) as f32).collect(),
        })
    }
}

impl Plateaus {
    /// No plateaus yet, of an insole with this configuration.
    pub fn new(setup: &Setup, cells: &[SetupCell], serial_number: String) -> Self {
        let place = |SetupCell { cell, .. }: &SetupCell| PlateauCell {
            x_mm: cell.x_mm,
            y_mm: cell.y_mm,
            area_mm2: cell.area_mm2,
        };
        let cells = cells.iter().map(place).collect();
        let (side, layout_id, law) = (setup.side, setup.layout_id, setup.sensor);
        Self { version: VERSION, side, serial_number, layout_id, law, cells, plateaus: Vec::new() }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// Fails if the file cannot be read, is not JSON of this form and version, or has a number that is not finite or out of
    /// range. The message names the file and the place in it.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&std::fs::read(path).map_err(Error::io(path))?, path)
    }

    /// As [`Plateaus::read`], from text. Messages name `path` as the file.
    ///
    /// # Errors
    /// Fails in the same cases as [`Plateaus::read`].
    pub fn parse(text: &[u8], path: &Path) -> Result<Self> {
        let place = path.display().to_string();
        let refuse = |problem: String| Err(Error::content(&place, problem, REMEDY));
        let read: Self = match serde_json::from_slice(text) {
            Ok(read) => read,
            Err(error) => return refuse(error.to_string()),
        };
        let cells = read.cells.len();
        if read.version != VERSION {
            let problem =
                format!("version {} of the format is unknown; this program reads version {VERSION}", read.version);
            return Err(Error::content(place, problem, "update plantar"));
        }
        if !(1..=DEVICE_CELLS).contains(&cells) {
            return refuse(format!("{cells} cells, but an insole has 1 to {DEVICE_CELLS}"));
        }
        if !read.law.is_valid() {
            return refuse("the sensor law is out of range".into());
        }
        for (number, plateau) in read.plateaus.iter().enumerate() {
            let Plateau { pressure_kpa, codes, changes, .. } = plateau;
            if codes.len() != cells || changes.len() != cells {
                return refuse(format!("plateau {number} does not have a code and a change for each of {cells} cells"));
            }
            if !(0.0..=MAX_PLATEAU_KPA).contains(pressure_kpa) {
                return refuse(format!(
                    "plateau {number}: {pressure_kpa} kPa, but a pressure is 0 to {MAX_PLATEAU_KPA} kPa"
                ));
            }
            let range = 0.0..=f32::from(u16::MAX);
            if !codes.iter().all(|code| range.contains(code))
                || !changes.iter().all(|change| range.contains(&change.abs()))
            {
                return refuse(format!("plateau {number}: a code is 0 to {}", u16::MAX));
            }
        }
        Ok(read)
    }

    /// Writes the file. If this fails, an existing file with this name is unchanged.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        output::file(path, |to| {
            serde_json::to_writer(&mut *to, self)?;
            writeln!(to)
        })
    }
}
