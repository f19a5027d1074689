//! The zero of an insole: what its cells read while nothing loads them, as a commented TOML file.

use crate::table::at_line;
use crate::{Error, Recording, Result, StandingTrial, VirtualInsole};
use plantar::Side;
use plantar::pipeline::calibrate::zero_offset;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use serde::Deserialize;
use std::fmt::Write;
use std::path::Path;
use toml::Spanned;

/// Version of the file format.
const VERSION: u32 = 1;
/// Offsets on one line of a file.
const PER_LINE: usize = 8;

const MEASURE: &str = "measure it again with `plantar zero`";

/// The zero of one foot's insole or of both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Zero {
    /// The left insole's.
    pub left: Option<FootZero>,
    /// The right insole's.
    pub right: Option<FootZero>,
}

/// The zero of one insole.
#[derive(Clone, Debug, PartialEq)]
pub struct FootZero {
    /// Identifies the cells, as [`plantar::pipeline::setup::Setup::layout_id`].
    pub layout_id: u32,
    /// What each unloaded cell reads, kPa, in the order of [`VirtualInsole::cells`].
    ///
    /// A sensor adds its offset to the code, not to the pressure; but the code that belongs to a pressure depends on the full
    /// scale, and a virtual insole chooses that by its recording. The pressure holds for all of them.
    pub offset_kpa: Vec<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    left: Option<FileFoot>,
    right: Option<FileFoot>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileFoot {
    layout_id: u32,
    offset_kpa: Vec<Spanned<f32>>,
}

impl Zero {
    /// Reads a file.
    ///
    /// # Errors
    /// When the file cannot be read, is no TOML of this form or version, or holds what no cell reads; the message names file
    /// and line.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&std::fs::read_to_string(path).map_err(Error::io(path))?, path)
    }

    /// As [`Zero::read`], from text; `path` is for messages.
    ///
    /// # Errors
    /// As [`Zero::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let place = |offset: usize| at_line(path, text[..offset].matches('\n').count() as u64 + 1);
        let file: File = toml::from_str(text)
            .map_err(|e| Error::content(place(e.span().map_or(0, |span| span.start)), e.message(), MEASURE))?;
        if file.version != VERSION {
            let problem = format!("version {} is not known; this program reads version {VERSION}", file.version);
            return Err(Error::content(path.display().to_string(), problem, "update it"));
        }
        if file.left.is_none() && file.right.is_none() {
            return Err(Error::content(path.display().to_string(), "neither [left] nor [right] is there", MEASURE));
        }
        let foot = |foot: FileFoot| {
            if let Some(bad) = foot.offset_kpa.iter().find(|kpa| !(0.0..f32::INFINITY).contains(kpa.get_ref())) {
                let problem = format!("an offset of {} kPa", bad.get_ref());
                return Err(Error::content(place(bad.span().start), problem, MEASURE));
            }
            let offset_kpa = foot.offset_kpa.into_iter().map(Spanned::into_inner).collect();
            Ok(FootZero { layout_id: foot.layout_id, offset_kpa })
        };
        Ok(Self { left: file.left.map(foot).transpose()?, right: file.right.map(foot).transpose()? })
    }

    /// Writes a commented file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        std::fs::write(path, self.to_toml()).map_err(Error::io(path))
    }

    /// The commented file.
    pub fn to_toml(&self) -> String {
        let mut text = format!(
            "# Plantar zero: what the cells of an insole read while nothing loads them, from a standing trial.\n\
             # layout_id   the cells it was measured with\n\
             # offset_kpa  one number a cell, kPa, by region from heel to toes, within a region as in the recording;\n\
             #             subtracted as the code of the sensor at that pressure\n\n\
             version = {VERSION}\n"
        );
        for (side, foot) in [(Side::Left, &self.left), (Side::Right, &self.right)] {
            let Some(foot) = foot else { continue };
            // Writing to a String does not fail.
            let _ = write!(text, "\n[{}]\nlayout_id = {}\noffset_kpa = [\n", side.name(), foot.layout_id);
            for line in foot.offset_kpa.chunks(PER_LINE) {
                let numbers: Vec<_> = line.iter().map(|kpa| format!("{kpa:?}")).collect();
                let _ = writeln!(text, "    {},", numbers.join(", "));
            }
            text.push_str("]\n");
        }
        text
    }

    /// The place of one foot's zero.
    pub fn foot_mut(&mut self, side: Side) -> &mut Option<FootZero> {
        match side {
            Side::Left => &mut self.left,
            Side::Right => &mut self.right,
        }
    }

    /// Gives the cells of `insole` their offsets; `place` names this zero in messages.
    ///
    /// # Errors
    /// When this zero is of the other foot, of other cells, or takes more than half of a cell's scale.
    pub fn wear(&self, insole: &mut VirtualInsole, place: &str) -> Result<()> {
        let (foot, other) = match insole.setup.side {
            Side::Left => (&self.left, Side::Right),
            Side::Right => (&self.right, Side::Left),
        };
        match foot {
            Some(foot) => foot.wear(insole, place),
            None => {
                let (side, other) = (insole.setup.side.name(), other.name());
                let problem = format!("no zero of the {side} foot, only of the {other}");
                Err(Error::content(place, problem, format!("measure the {side} foot too with `plantar zero`")))
            }
        }
    }
}

impl FootZero {
    /// The zero of the insole that recorded a trial, by the device's own [`zero_offset`]; `place` names the recording in
    /// messages.
    ///
    /// # Errors
    /// When the lifted foot takes more than half of a cell's scale.
    pub fn measure(recording: &Recording, trial: &StandingTrial, place: &str) -> Result<Self> {
        // Neither rule matters for codes.
        let mut insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::WALKING);
        let cells = recording.cells();
        let mut codes = Vec::new();
        for i in trial.lifted.iter().cloned().flatten() {
            let start = codes.len();
            codes.resize(start + cells, 0);
            insole.codes(recording.frame(i), &mut codes[start..]);
        }
        let offset = |cell: usize| zero_offset(codes.iter().skip(cell).step_by(cells).copied());
        // A trial has lifted frames, so every cell has codes.
        let offsets = (0..cells).map(|cell| insole.pressure_kpa(offset(cell).unwrap_or(0)));
        let zero = Self { layout_id: insole.setup.layout_id, offset_kpa: offsets.collect() };
        zero.wear(&mut insole, place)?;
        Ok(zero)
    }

    /// As [`Zero::wear`], whichever foot it is.
    ///
    /// # Errors
    /// As [`Zero::wear`].
    pub fn wear(&self, insole: &mut VirtualInsole, place: &str) -> Result<()> {
        let (found, cells) = (self.offset_kpa.len(), insole.cells.len());
        if self.layout_id != insole.setup.layout_id || found != cells {
            return Err(Error::content(
                place,
                format!("{found} offsets for other cells than the {cells} of this recording"),
                "import the standing trial and this recording from one layout, with the same --cells",
            ));
        }
        for (i, &kpa) in self.offset_kpa.iter().enumerate() {
            // A pressure beyond the scale has no code.
            insole.cells[i].calibration.offset = insole.code(kpa.min(insole.setup.sensor.full_kpa));
            let cell = insole.cells[i];
            if !cell.calibration.is_valid() {
                return Err(Error::content(
                    place,
                    format!(
                        "the cell at x {:.0} mm, y {:.0} mm reads {kpa:.0} kPa unloaded, more than half of its scale",
                        cell.cell.x_mm, cell.cell.y_mm
                    ),
                    "look for a short circuit, or leave the cell out of the layout",
                ));
            }
        }
        Ok(())
    }
}
