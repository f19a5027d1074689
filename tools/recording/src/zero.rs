//! The zero of an insole: the readings of its cells without load. It is stored as a commented TOML file.

use crate::table::at_line;
use crate::{Error, Recording, Result, StandingTrial, VirtualInsole, output};
use plantar::Side;
use plantar::pipeline::calibrate::{CellCalibration, zero_offset};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use serde::Deserialize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use toml::Spanned;

/// Version of the file format.
const VERSION: u32 = 1;
/// Number of offsets on a line of the file.
const OFFSETS_PER_LINE: usize = 8;

/// The remedy for a file that cannot be used.
const REMEDY: &str = "name a file that `plantar zero` wrote, or measure the zero again with `plantar zero`";

/// The zero of one insole or of both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Zero {
    /// The zero of the left insole.
    pub left: Option<FootZero>,
    /// The zero of the right insole.
    pub right: Option<FootZero>,
}

/// The zero of one insole.
#[derive(Clone, Debug, PartialEq)]
pub struct FootZero {
    /// Identifies the cells: the checksum of their positions, areas and regions that [`VirtualInsole::new`] computes. It is not
    /// the identifier in the hello of an insole.
    pub layout_id: u32,
    /// Reading of each unloaded cell, kPa, not negative, in the order of [`VirtualInsole::cells`].
    ///
    /// It is subtracted from the pressures of other systems, on the assumption that the reading of an unloaded cell adds to its
    /// pressure. In recordings of insoles of this project, and in computed ones, this reading adds to the code, so the code of
    /// this pressure is subtracted from the codes. It is nevertheless stored as a pressure, because its code depends on the full
    /// scale, which a virtual insole chooses according to its recording.
    pub offset_kpa: Vec<f32>,
}

/// The field `version`, which is checked before all others, because a file of another version may have other fields.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// The content of the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(rename = "version")]
    _version: u32,
    left: Option<FileFoot>,
    right: Option<FileFoot>,
}

/// The table `[left]` or `[right]` of the file.
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
    /// Fails if the file cannot be read, is not TOML of this form and version, or contains an offset that is negative or not
    /// finite. The message names the file and, if one line is wrong, this line.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&std::fs::read_to_string(path).map_err(Error::io(path))?, path)
    }

    /// As [`Zero::read`], from text. Messages name `path` as the file.
    ///
    /// # Errors
    /// Fails in the same cases as [`Zero::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let place = |offset: usize| at_line(path, text[..offset].matches('\n').count() as u64 + 1);
        let malformed =
            |e: toml::de::Error| Error::content(place(e.span().map_or(0, |span| span.start)), e.message(), REMEDY);
        let Version { version } = toml::from_str(text).map_err(malformed)?;
        if version != VERSION {
            let problem = format!("version {version} of the format is unknown; this program reads version {VERSION}");
            return Err(Error::content(path.display().to_string(), problem, "update plantar"));
        }
        let file: File = toml::from_str(text).map_err(malformed)?;
        if file.left.is_none() && file.right.is_none() {
            return Err(Error::content(path.display().to_string(), "neither [left] nor [right] is present", REMEDY));
        }
        let foot = |foot: FileFoot| {
            if let Some(bad) = foot.offset_kpa.iter().find(|kpa| !(0.0..f32::INFINITY).contains(kpa.get_ref())) {
                let problem =
                    format!("an offset of {} kPa, but an offset must be finite and not negative", bad.get_ref());
                return Err(Error::content(place(bad.span().start), problem, REMEDY));
            }
            let offset_kpa = foot.offset_kpa.into_iter().map(Spanned::into_inner).collect();
            Ok(FootZero { layout_id: foot.layout_id, offset_kpa })
        };
        Ok(Self { left: file.left.map(foot).transpose()?, right: file.right.map(foot).transpose()? })
    }

    /// Writes the commented file. If this fails, an existing file with this name is unchanged.
    ///
    /// # Errors
    /// Fails if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        output::file(path, |to| to.write_all(self.to_toml().as_bytes()))
    }

    /// The text of the commented file.
    pub fn to_toml(&self) -> String {
        let mut text = format!(
            "# Plantar zero: readings of the unloaded cells of an insole, from a standing trial.\n\
             # layout_id   checksum of the positions, areas and regions of the cells\n\
             # offset_kpa  reading of each cell, kPa, ordered by region from heel to toes, then as in the recording; plantar\n\
             #             subtracts it from the pressures of other systems; for recordings of insoles and computed ones, it\n\
             #             subtracts the code of this pressure from the codes of the sensor\n\n\
             version = {VERSION}\n"
        );
        for (side, foot) in [(Side::Left, &self.left), (Side::Right, &self.right)] {
            let Some(foot) = foot else { continue };
            // Writing to a String does not fail.
            let _ = write!(text, "\n[{}]\nlayout_id = {}\noffset_kpa = [\n", side.name(), foot.layout_id);
            for line in foot.offset_kpa.chunks(OFFSETS_PER_LINE) {
                let numbers: Vec<_> = line.iter().map(|kpa| format!("{kpa:?}")).collect();
                let _ = writeln!(text, "    {},", numbers.join(", "));
            }
            text.push_str("]\n");
        }
        text
    }

    /// The zero of one foot, mutable.
    pub fn foot_mut(&mut self, side: Side) -> &mut Option<FootZero> {
        match side {
            Side::Left => &mut self.left,
            Side::Right => &mut self.right,
        }
    }

    /// Applies this zero to `insole`, which subtracts it from then on. `name` is the name of this zero in messages, such as its
    /// file.
    ///
    /// # Errors
    /// Fails if this is the zero of the other foot or of other cells, or the code of an offset is at least half of the scale.
    pub fn apply_to(&self, insole: &mut VirtualInsole, name: &str) -> Result<()> {
        let (foot, other) = match insole.setup.side {
            Side::Left => (&self.left, Side::Right),
            Side::Right => (&self.right, Side::Left),
        };
        match foot {
            Some(foot) => foot.apply_to(insole, name),
            None => {
                let (side, other) = (insole.setup.side.name(), other.name());
                let problem = format!("no zero of the {side} foot, only of the {other}");
                Err(Error::content(name, problem, format!("measure the {side} foot too with `plantar zero`")))
            }
        }
    }
}

impl FootZero {
    /// The zero of the insole that recorded a standing trial, computed by the [`zero_offset`] of the device. `name` is the
    /// name of the recording in messages.
    ///
    /// # Errors
    /// Fails if the code of a cell of the lifted foot is at least half of the scale.
    pub fn measure(recording: &Recording, trial: &StandingTrial, name: &str) -> Result<Self> {
        // The codes depend on neither of these two rules.
        let mut insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
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
        // The offsets are applied only to check them.
        zero.apply_to(&mut insole, name)?;
        Ok(zero)
    }

    /// As [`Zero::apply_to`], for an insole of either foot.
    ///
    /// # Errors
    /// Fails if this is the zero of other cells, or the code of an offset is at least half of the scale.
    pub fn apply_to(&self, insole: &mut VirtualInsole, name: &str) -> Result<()> {
        let (found, cells) = (self.offset_kpa.len(), insole.cells.len());
        if self.layout_id != insole.setup.layout_id || found != cells {
            return Err(Error::content(
                name,
                format!("the {found} offsets are of other cells than the {cells} cells of this recording"),
                "import the standing trial and this recording with the same layout and without --cells, which leaves out cells \
                 that are never loaded; for Moticon and for insoles with a matrix sensor, such as F-Scan and XSENSOR, the import \
                 fits the layout to each recording: import the standing trial with --like and the name of this recording, and \
                 measure the zero again",
            ));
        }
        for (cell, &kpa) in insole.cells.iter().zip(&self.offset_kpa) {
            // A pressure above the full scale has no code. The code of the full scale is rejected.
            let offset = insole.code(kpa.min(insole.setup.sensor.full_kpa));
            if !(CellCalibration { offset, ..CellCalibration::IDEAL }).is_valid() {
                return Err(Error::content(
                    name,
                    format!(
                        "the cell at x {:.0} mm, y {:.0} mm reads {kpa:.0} kPa unloaded, a code of at least half of \
                         its scale",
                        cell.x_mm, cell.y_mm
                    ),
                    "check the cell for a short circuit, or remove it from the layout",
                ));
            }
        }
        insole.subtract(&self.offset_kpa);
        Ok(())
    }
}
