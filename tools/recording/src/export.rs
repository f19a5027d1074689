//! The exports of vendors' programs: their formats, and how a file's format is recognised from its content.

use crate::earlier::{EarlierRecording, refuse_fixed, refuse_plate};
use crate::footprint::capitalised;
use crate::span::Span;
use crate::table::tabs;
use crate::text::{decode, shortened, strip_name};
use crate::{Error, Recording, Result, emed, footscan, gaitpdb, loadsol, moticon, pliance, tekscan, xsensor};
use plantar::Side;
use std::fs;
use std::path::Path;

/// The sentence in [`Recording::source`] of a foot from an export of a plate or mat that contains this contact alone. Exports of
/// two such contacts are never of the same moment.
pub const ONE_CONTACT: &str =
    "The export contains one contact: its times are not on one clock with those of another export.";

/// The beginning of the sentence with the time of the measurement in [`Recording::source`].
const MEASURED_AT: &str = "Measured at `";

/// The sentence with the time of the measurement, in the words of the export and with a blank before it, for
/// [`Recording::source`]. Empty if the export states no time.
pub(crate) fn measured_at(time: &str) -> String {
    if time.is_empty() { String::new() } else { format!(" {MEASURED_AT}{}`.", shortened(time)) }
}

/// The time of the measurement in a [`Recording::source`], in the words of the export; `None` if it states none.
pub fn time_of(source: &str) -> Option<&str> {
    let (_, time) = source.split_once(MEASURED_AT)?;
    time.split('`').next()
}

/// The content of an export.
#[derive(Debug)]
pub struct Export {
    /// One recording for each foot. Their times are on a common clock, unless one of the `remarks` states otherwise.
    pub feet: Vec<Recording>,
    /// Sentences for the user: decisions of the import, and the comparison of its result with totals in the export. A remark
    /// about one of two feet must begin with the name of this foot, such as `Left foot`: it is then stored in the recording of
    /// this foot only.
    pub remarks: Vec<String>,
}

impl Export {
    /// Appends the remarks to the [`Recording::source`] of each foot that they concern.
    fn with_stored_remarks(mut self) -> Self {
        for foot in &mut self.feet {
            let other = match foot.side {
                Side::Left => Side::Right,
                Side::Right => Side::Left,
            };
            let of_other = format!("{} foot", capitalised(other));
            for remark in self.remarks.iter().filter(|remark| !remark.starts_with(&of_other)) {
                foot.source += &format!(" {remark}");
            }
        }
        self
    }
}

/// What an import selects from an export, and how it determines the layout. The default is all feet and all frames.
#[derive(Clone, Copy, Default)]
pub struct Options<'a> {
    /// The only foot to import from an export that names its feet, or the foot of an export that does not.
    pub side: Option<Side>,
    /// The frames to import.
    pub span: Span,
    /// If there are any, each foot has the layout of the recording of the same foot among these, instead of one that is fitted
    /// to the file.
    pub earlier: &'a [EarlierRecording],
}

/// A format of which the exported file suffices for an import, without a separate layout or geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    /// See [`xsensor`].
    Xsensor,
    /// See [`tekscan`].
    Tekscan,
    /// See [`emed`].
    Emed,
    /// See [`footscan`].
    Footscan,
    /// See [`moticon`].
    Moticon,
    /// See [`loadsol`].
    Loadsol,
    /// See [`gaitpdb`].
    Gaitpdb,
    /// See [`pliance`].
    Pliance,
}

impl Format {
    /// All formats, in the order in which they are tried.
    pub const ALL: [Self; 8] = [
        Self::Xsensor,
        Self::Tekscan,
        Self::Emed,
        Self::Footscan,
        Self::Moticon,
        Self::Loadsol,
        Self::Gaitpdb,
        Self::Pliance,
    ];

    /// The name of the format, and of the subcommand of `plantar import` for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Xsensor => "xsensor",
            Self::Tekscan => "tekscan",
            Self::Emed => "emed",
            Self::Footscan => "footscan",
            Self::Moticon => "moticon",
            Self::Loadsol => "loadsol",
            Self::Gaitpdb => "gaitpdb",
            Self::Pliance => "pliance",
        }
    }

    /// Recognises the format of a file from its content. Messages name `path`.
    ///
    /// # Errors
    /// Fails if the file has none of these formats. For a recording, and for the formats of pedar, CSV and jiku-data, which need
    /// further arguments, the message names the command that reads the file. For CSV with tabs between the fields, it names the
    /// accepted separators.
    pub fn recognise(bytes: &[u8], path: &Path) -> Result<Self> {
        let file = || path.display().to_string();
        let refuse = |problem: &str, remedy: &str| Err(Error::content(file(), problem, remedy));
        if bytes.starts_with(b"PAR1") {
            return refuse("already a recording", "use it directly, for example with plantar info");
        }
        if bytes.starts_with(b"\x89HDF\r\n") {
            return refuse("an HDF5 file", "import a walker of jiku-data with plantar import jiku");
        }
        if footscan::is_xls(bytes) {
            return Ok(Self::Footscan);
        }
        let text = decode(bytes, path)?;
        let recognised = |format: &Self| match format {
            Self::Xsensor => xsensor::recognise(&text),
            Self::Tekscan => tekscan::recognise(&text),
            Self::Emed => emed::recognise(&text),
            Self::Footscan => footscan::recognise(&text),
            Self::Moticon => moticon::recognise(&text),
            Self::Loadsol => loadsol::recognise(&text),
            Self::Gaitpdb => gaitpdb::recognise(&text),
            Self::Pliance => pliance::recognise(&text),
        };
        if let Some(format) = Self::ALL.into_iter().find(recognised) {
            return Ok(format);
        }
        let first_line = text.lines().next().unwrap_or_default();
        if text.lines().take(40).any(|line| strip_name(line, "time[secs]").is_some()) {
            return refuse("a pedar export", "use plantar import pedar with --geometry, the geometry of its insole");
        }
        let first_field = first_line.split([',', ';', '\t']).next().unwrap_or_default();
        if ["t_s", "cell", "side"].contains(&first_field) && first_line[first_field.len()..].starts_with('\t') {
            return Err(tabs(path));
        }
        if ["t_s", "cell"].contains(&first_field) {
            return refuse("frames or a layout in CSV", "use plantar import csv with --layout, --frames and --side");
        }
        let names: Vec<_> = Self::ALL.iter().map(|format| format.name()).collect();
        refuse(
            "the format is not recognised",
            &format!("export the measurement as text in a format of plantar import: {}, pedar, csv", names.join(", ")),
        )
    }

    /// Imports a file of this format.
    ///
    /// # Errors
    /// Fails if the file cannot be read or violates its format, if it has no frame within the span, or if there are earlier
    /// recordings, but none of the same foot on the same sensor, or the format has no layout that is fitted to an insole. The
    /// message names file, line and remedy.
    pub fn import(self, path: impl AsRef<Path>, options: Options) -> Result<Export> {
        let path = path.as_ref();
        self.parse(&fs::read(path).map_err(Error::io(path))?, path, options)
    }

    /// As [`Format::import`], from the content of a file. Messages name `path`.
    ///
    /// # Errors
    /// Fails in the same cases as [`Format::import`], except that no file is read.
    pub fn parse(self, bytes: &[u8], path: &Path, options: Options) -> Result<Export> {
        let Options { side, span, earlier } = options;
        let parsed = match self {
            Self::Xsensor => xsensor::parse(bytes, path, side, earlier),
            Self::Tekscan => tekscan::parse(bytes, path, side, earlier),
            Self::Moticon => moticon::parse(bytes, path, side, earlier),
            Self::Emed | Self::Footscan | Self::Pliance if !earlier.is_empty() => Err(refuse_plate(path)),
            Self::Loadsol | Self::Gaitpdb if !earlier.is_empty() => Err(refuse_fixed(path)),
            Self::Emed => emed::parse(bytes, path, side),
            Self::Footscan => footscan::parse(bytes, path, side),
            Self::Loadsol => loadsol::parse(bytes, path, side),
            Self::Gaitpdb => gaitpdb::parse(bytes, path, side),
            Self::Pliance => pliance::parse(bytes, path, side),
        }?;
        Ok(parsed.completed(path, span)?.with_stored_remarks())
    }
}

/// Imports a file in any of the formats, recognised from its content.
///
/// # Errors
/// Fails in the same cases as [`Format::recognise`] and [`Format::import`].
pub fn import(path: impl AsRef<Path>, options: Options) -> Result<Export> {
    let path = path.as_ref();
    let bytes = fs::read(path).map_err(Error::io(path))?;
    Format::recognise(&bytes, path)?.parse(&bytes, path, options)
}
