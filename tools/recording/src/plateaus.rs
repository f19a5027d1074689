//! The readings of an insole under known pressures that are the same on all cells, such as those of the bladder of a calibration
//! device.

use crate::{Error, Result, output};
use plantar::Side;
use plantar::pipeline::calibrate::{FULL_CODE, SensorLaw};
use plantar::pipeline::setup::{DEVICE_CELLS, Setup, SetupCell};
use plantar::protocol::Serial;
use serde::{Deserialize, Serialize};
use std::io::Write as _;
use std::path::Path;

/// Version of the file format.
const VERSION: u32 = 1;
/// Smallest pressure of a plateau with load, kPa. Smaller ones are stated in another unit, such as bar, more often.
pub const MIN_PLATEAU_KPA: f64 = 1.0;
/// Largest pressure of a plateau, kPa.
pub const MAX_PLATEAU_KPA: f64 = 3000.0;
/// Largest number of plateaus.
pub const MAX_PLATEAUS: usize = 100;
/// Largest size of a file, bytes: more than that of [`MAX_PLATEAUS`] plateaus.
const MAX_BYTES: usize = 2_000_000;
/// Largest coordinate of a cell, mm.
const MAX_MM: f32 = 1000.0;
/// Largest area of a cell, mm2.
const MAX_MM2: f32 = 10_000.0;
/// The remedy for a file that cannot be used.
const REMEDY: &str = "measure the plateaus again with `plantar calibrate measure`";

/// The readings of one insole at all measured pressures. It is stored as a JSON file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plateaus {
    version: u32,
    /// The foot.
    pub side: Side,
    /// Serial number of the insole.
    pub serial_number: String,
    /// Version of the insole's firmware.
    pub firmware: String,
    /// Remark of the person who measured, such as gauge and temperature.
    pub note: String,
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
    /// Row times 16 plus column of the matrix.
    pub row_column: u8,
}

/// The readings during a constant pressure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plateau {
    /// The pressure that was asked for, kPa: 0 for the insole without load, or [`MIN_PLATEAU_KPA`] to [`MAX_PLATEAU_KPA`].
    pub nominal_kpa: f64,
    /// The pressure on all cells by the gauge, kPa, in the same range.
    pub pressure_kpa: f64,
    /// Time of the measurement, s since 1970.
    pub unix_s: u64,
    /// Number of frames that were measured, at least 3.
    pub frames: u32,
    /// Mean code of each cell.
    pub codes: Vec<f32>,
    /// Change of the code of each cell: the mean of the last third of the frames minus that of the first third.
    pub changes: Vec<f32>,
}

impl Plateau {
    /// The mean codes of `frames`, each of which has the codes of all cells; `None` for fewer than three frames.
    pub fn of(nominal_kpa: f64, pressure_kpa: f64, unix_s: u64, frames: &[Vec<u16>]) -> Option<Self> {
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
            nominal_kpa,
            pressure_kpa,
            unix_s,
            frames: frames.len() as u32,
            codes: (0..cells).map(|cell| mean(frames, cell) as f32).collect(),
            changes: (0..cells).map(|cell| change(cell) as f32).collect(),
        })
    }

    /// What is wrong with a plateau of an insole with this number of cells.
    fn problem(&self, cells: usize) -> Option<String> {
        let Self { nominal_kpa, pressure_kpa, unix_s: _, frames, codes, changes } = self;
        let full = f32::from(FULL_CODE);
        if let Some(kpa) = [nominal_kpa, pressure_kpa].into_iter().find(|kpa| !is_plateau_kpa(**kpa)) {
            Some(format!("{kpa} kPa, but a pressure is 0, or {MIN_PLATEAU_KPA} to {MAX_PLATEAU_KPA} kPa"))
        } else if (*nominal_kpa == 0.0) != (*pressure_kpa == 0.0) {
            Some("one pressure is 0, and the other one is not".into())
        } else if *frames < 3 {
            Some(format!("{frames} frames, but a plateau has at least 3"))
        } else if codes.len() != cells || changes.len() != cells {
            Some(format!("not a code and a change for each of {cells} cells"))
        } else {
            let are_codes =
                codes.iter().chain(changes).all(|code| code.abs() <= full) && codes.iter().all(|code| *code >= 0.0);
            (!are_codes).then(|| format!("a code is not 0 to {full}"))
        }
    }
}

/// True for the pressure of a plateau, kPa: 0, or [`MIN_PLATEAU_KPA`] to [`MAX_PLATEAU_KPA`].
pub fn is_plateau_kpa(kpa: f64) -> bool {
    kpa == 0.0 || (MIN_PLATEAU_KPA..=MAX_PLATEAU_KPA).contains(&kpa)
}

impl Plateaus {
    /// No plateaus yet, of an insole with this configuration.
    pub fn new(setup: &Setup, cells: &[SetupCell], serial_number: &str, firmware: &str) -> Self {
        let place = |cell: &SetupCell| PlateauCell {
            x_mm: cell.x_mm,
            y_mm: cell.y_mm,
            area_mm2: cell.area_mm2,
            row_column: cell.row_column,
        };
        Self {
            version: VERSION,
            side: setup.side,
            serial_number: serial_number.into(),
            firmware: firmware.into(),
            note: String::new(),
            law: setup.sensor,
            cells: cells.iter().map(place).collect(),
            plateaus: Vec::new(),
        }
    }

    /// True if both are of the same insole, with the same cells.
    pub fn is_of_same_insole(&self, other: &Self) -> bool {
        (self.side, &self.serial_number, &self.cells) == (other.side, &other.serial_number, &other.cells)
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
        if text.len() > MAX_BYTES {
            return refuse(format!("{} bytes, more than those of {MAX_PLATEAUS} plateaus", text.len()));
        }
        let read: Self = match serde_json::from_slice(text) {
            Ok(read) => read,
            Err(error) => return refuse(error.to_string()),
        };
        if read.version != VERSION {
            let problem =
                format!("version {} of the format is unknown; this program reads version {VERSION}", read.version);
            return Err(Error::content(place, problem, "update plantar"));
        }
        let is_place = |cell: &PlateauCell| {
            [cell.x_mm, cell.y_mm].iter().all(|mm| mm.abs() <= MAX_MM)
                && cell.area_mm2 > 0.0
                && cell.area_mm2 <= MAX_MM2
        };
        // The texts are printed.
        if Serial::new(&read.serial_number).is_none() || read.firmware.contains(char::is_control) {
            return refuse("the serial number or the version of the firmware is not printable text".into());
        }
        let cells = read.cells.len();
        if !(1..=DEVICE_CELLS).contains(&cells) {
            return refuse(format!("{cells} cells, but an insole has 1 to {DEVICE_CELLS}"));
        }
        if !read.cells.iter().all(is_place) {
            return refuse(format!("a cell is more than {MAX_MM} mm away, or its area is not 0 to {MAX_MM2} mm2"));
        }
        if !read.law.is_valid() {
            return refuse("the sensor law is out of range".into());
        }
        if read.plateaus.len() > MAX_PLATEAUS {
            return refuse(format!("{} plateaus, more than {MAX_PLATEAUS}", read.plateaus.len()));
        }
        let problems = read.plateaus.iter().enumerate().filter_map(|(i, plateau)| Some((i, plateau.problem(cells)?)));
        if let Some((i, problem)) = problems.take(1).next() {
            return refuse(format!("plateau {}: {problem}", i + 1));
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
