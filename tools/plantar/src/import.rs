//! `plantar import`: converts the exports of other systems to recordings, and computes example recordings.

use crate::fit::print_notes;
use crate::paths::check_written;
use crate::replay::progress;
use crate::setup::time;
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Subcommand, ValueEnum};
use plantar::Side;
use recording::synthetic::{self, SyntheticWalk};
use recording::{
    EarlierRecording, Export, Format, Options, Recording, Span, csv, export, footprint, jiku, note_unless_same_walk,
    output, pedar,
};
use std::path::{Path, PathBuf};
use std::slice;

#[derive(Subcommand)]
pub enum Import {
    /// Import exports of other systems, whose formats are recognised from their content.
    ///
    /// The files are of one measurement: one file with both feet, or a file for each foot. Both feet are written to
    /// NAME.left.parquet and NAME.right.parquet for --out NAME.parquet, with times on one clock, except for a footscan export in
    /// which the times of each foot may begin with its own contact; the import then says so. Two files are taken to begin at the
    /// same moment, except those of Tekscan, in which the frames of both feet are numbered from a common start, and those of
    /// single contacts on a plate, which are not on one clock; the import says so.
    Auto {
        /// The exported files.
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// The foot, if the export does not state it; or the only foot to import. Only with a single file.
        #[arg(long, value_enum)]
        side: Option<Foot>,
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        like: Like,
        #[command(flatten)]
        out: Out,
    },
    /// Import a CSV file that XSENSOR's program exported.
    Xsensor(Vendor),
    /// Import an ASCII file (.asf, .csv) of Tekscan's F-Scan, I-Scan or plates.
    Tekscan(Vendor),
    /// Import an ASCII file (.lst) of a plate of novel's emed system.
    Emed(Vendor),
    /// Import the export "Dynamic Roll off" (.xls, or its text) of RSscan's footscan plate.
    Footscan(Vendor),
    /// Import a text file that Moticon's OpenGo program exported.
    Moticon(Vendor),
    /// Import a text file that novel's loadsol insoles exported, with the forces of zones. Positions and areas are nominal.
    Loadsol(Vendor),
    /// Import a walk of PhysioNet's database gaitpdb, with the forces of eight sensors. Positions and areas are nominal.
    Gaitpdb(Vendor),
    /// Import an .asc file of a mat of novel's pliance system, with the corners of its sensors.
    Pliance(Vendor),
    /// Import two CSV files: the layout of the cells, and their pressures.
    ///
    /// The layout has the columns cell,x_mm,y_mm,area_mm2 and optionally region. It has one line per cell; cells are numbered
    /// from 0. x increases towards the lateral side of the foot, y from heel to toes. Without the column region, a template
    /// divides the foot into regions. The pressures are in a file with the columns t_s,c0,c1,...: time in s, and the pressure of
    /// each cell in kPa. The times must be uniform, unless --rate resamples the frames: then the times need only increase, but no
    /// interval may be longer than 0.1 s, or than 1.5 times the median interval if this is longer. Semicolons with decimal commas
    /// may separate the fields instead of commas with decimal points. Negative pressures are read as 0.
    Csv {
        /// The file with the layout of the cells.
        #[arg(long, value_name = "FILE")]
        layout: PathBuf,
        /// The file with the pressures.
        #[arg(long, value_name = "FILE")]
        frames: PathBuf,
        /// The foot that was measured.
        #[arg(long, value_enum)]
        side: Foot,
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        fixed: FixedLayout,
        #[command(flatten)]
        out: Out,
    },
    /// Import an .asc file that the in-shoe system pedar exported, with the geometry of its insole.
    ///
    /// The geometry is a CSV file with the columns side,sensor,area_mm2,x1_mm,y1_mm,...,x4_mm,y4_mm, which has the area and the
    /// four corners of each sensor, and optionally insole, the size of the insole: a geometry of another size than that of the
    /// measured insoles is then refused. Without --side, both feet are written, to NAME.left.parquet and NAME.right.parquet for
    /// --out NAME.parquet.
    Pedar {
        /// The exported .asc file.
        file: PathBuf,
        /// The file with the geometry.
        #[arg(long, value_name = "FILE")]
        geometry: PathBuf,
        /// Import only this foot. Required for an export of one foot, which does not state the foot.
        #[arg(long, value_enum)]
        side: Option<Foot>,
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        fixed: FixedLayout,
        #[command(flatten)]
        out: Out,
    },
    /// Import barefoot steps on a plate from the Python package jiku-data (data set SpeedPP2DS, GPLv3, 10 walkers).
    ///
    /// Each trial of that data set is one footprint. The trials are joined to a walk, with unloaded swing phases between them. A
    /// trial is left out if it is empty, if the foot is still on the plate at its end, or if its rows were not interpolated in
    /// the way that this import reverses; the source of the recording lists it with the reason.
    Jiku {
        /// The folder SpeedPP2DS of the installed package.
        #[arg(long, value_name = "FOLDER")]
        data: PathBuf,
        /// The number of the walker, 0 to 9.
        #[arg(long, default_value_t = 0)]
        walker: usize,
        /// Import this number of trials, from the first; at most 60.
        #[arg(long, value_name = "N", default_value_t = 60)]
        trials: usize,
        #[command(flatten)]
        out: Out,
    },
    /// Compute a walk on an insole with 240 cells, for first experiments. It is not a measurement.
    ///
    /// Each step of the left foot begins half a stride after that of the right foot, as in a walk with both feet.
    Synthetic {
        /// The foot to compute.
        #[arg(long, value_enum, default_value_t = Foot::Right)]
        side: Foot,
        /// Number of steps, 1 to 10000.
        #[arg(long, value_name = "N", default_value_t = 10)]
        steps: usize,
        #[command(flatten)]
        out: Out,
    },
}

/// The options of an importer that needs only the exported file.
#[derive(Args)]
pub struct Vendor {
    /// The exported file.
    file: PathBuf,
    /// The foot, if the export does not state it; or the only foot to import.
    #[arg(long, value_enum)]
    side: Option<Foot>,
    #[command(flatten)]
    part: Part,
    #[command(flatten)]
    like: Like,
    #[command(flatten)]
    out: Out,
}

/// The options that select a part of a measurement.
#[derive(Args)]
pub struct Part {
    /// Import only the frames from this time on, s, on the clock of the recording that an import of all frames writes.
    #[arg(long, value_name = "S", value_parser = time, allow_negative_numbers = true)]
    from: Option<f64>,
    /// Import only the frames up to this time, s, on the same clock. With a gap in the export, only its longest part is imported:
    /// --from and --to select another part, of both feet alike.
    #[arg(long, value_name = "S", value_parser = time, allow_negative_numbers = true)]
    to: Option<f64>,
}

impl Part {
    fn span(&self) -> Result<Span> {
        Ok(Span::new(self.from, self.to)?)
    }
}

/// The option to import in the layout of an earlier recording.
#[derive(Args)]
pub struct Like {
    /// Use the cells, areas and regions of this earlier recording of the same foot on the same insole, instead of fitting them to
    /// the export. Repeated trials are then comparable, and the zero of a standing trial applies to all of them. NAME.parquet
    /// also stands for the pair NAME.left.parquet and NAME.right.parquet. Only for Moticon, XSENSOR and Tekscan insoles, and
    /// without --cells: import a recording in which the whole foot is loaded first, such as a walk.
    #[arg(long, value_name = "RECORDING")]
    like: Option<PathBuf>,
}

impl Like {
    /// Opens the earlier recordings: one, or those of both feet. `out` has the other options of the import.
    fn open(&self, out: &Out) -> Result<Vec<EarlierRecording>> {
        let Some(like) = &self.like else { return Ok(Vec::new()) };
        if let Some(cells) = out.cells {
            bail!(
                "--like with --cells {cells}: the merged cells would differ from one recording to another; leave out one of the \
                 two"
            );
        }
        let pair = [Side::Left, Side::Right].map(|side| output::of_foot(like, side));
        let mut found: Vec<_> = pair.iter().filter(|path| path.exists()).collect();
        // If there is neither a file with this name nor a pair, the error names this file.
        if like.exists() || found.is_empty() {
            found = vec![like];
        }
        Ok(found.into_iter().map(|path| EarlierRecording::open(path)).collect::<recording::Result<_>>()?)
    }
}

/// The paths of the files that an import reads: the exports and the earlier recordings.
fn read_files(exports: &[PathBuf], earlier: &[EarlierRecording]) -> Vec<PathBuf> {
    exports.iter().cloned().chain(earlier.iter().map(|earlier| earlier.path().to_owned())).collect()
}

/// Stands for the option `--like` in imports with a layout that is not fitted to the recording, so that they can refuse it.
#[derive(Args)]
pub struct FixedLayout {
    #[arg(long, value_name = "RECORDING", hide = true)]
    like: Option<PathBuf>,
}

impl FixedLayout {
    /// Fails if the option is given. `file` states the layout.
    fn check(&self, file: &Path) -> Result<()> {
        if let Some(like) = &self.like {
            bail!(
                "--like {}: the layout is not fitted to the recording, but stated by {}, and the same for all recordings that \
                 are imported with this file; leave out --like",
                like.display(),
                file.display()
            );
        }
        Ok(())
    }
}

#[derive(Args)]
pub struct Out {
    /// The recording to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Merge the cells into a virtual insole with at most this number of cells. A real insole has at most 256.
    #[arg(long, value_name = "N")]
    cells: Option<usize>,
    /// Resample to this number of frames per second, 20 to 500. A real insole scans at 50 to 333 Hz (nRF52840: up to 105).
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub enum Foot {
    Left,
    Right,
}

impl From<Foot> for Side {
    fn from(foot: Foot) -> Self {
        match foot {
            Foot::Left => Side::Left,
            Foot::Right => Side::Right,
        }
    }
}

impl Import {
    fn out(&self) -> &Out {
        match self {
            Self::Auto { out, .. }
            | Self::Csv { out, .. }
            | Self::Pedar { out, .. }
            | Self::Jiku { out, .. }
            | Self::Synthetic { out, .. } => out,
            Self::Xsensor(vendor)
            | Self::Tekscan(vendor)
            | Self::Emed(vendor)
            | Self::Footscan(vendor)
            | Self::Moticon(vendor)
            | Self::Loadsol(vendor)
            | Self::Gaitpdb(vendor)
            | Self::Pliance(vendor) => &vendor.out,
        }
    }

    pub fn run(&self) -> Result<()> {
        let import = |format: Format, vendor: &Vendor| {
            let earlier = vendor.like.open(&vendor.out)?;
            check_no_folder(&vendor.file)?;
            let options = Options { side: vendor.side.map(Side::from), span: vendor.part.span()?, earlier: &earlier };
            let export = format.import(&vendor.file, options)?;
            vendor.out.write_feet(export, &read_files(slice::from_ref(&vendor.file), &earlier))
        };
        let bar = progress(0, "bytes");
        let mut report = |done, total| {
            bar.set_length(total);
            bar.set_position(done);
        };
        self.out().check_name()?;
        match self {
            Self::Auto { files, side, part, like, out } => {
                if let (Some(side), [_, _, ..]) = (side, &files[..]) {
                    bail!(
                        "--side {} with {} files: leave it out if the exports state their feet; otherwise import each file \
                         with its own --side and --out",
                        Side::from(*side).name(),
                        files.len()
                    );
                }
                let earlier = like.open(out)?;
                let options = Options { side: side.map(Side::from), span: part.span()?, earlier: &earlier };
                let mut all = Export { feet: Vec::new(), remarks: Vec::new() };
                for file in files {
                    check_no_folder(file)?;
                    let Export { feet, remarks } = export::import(file, options)?;
                    all.feet.extend(feet);
                    all.remarks.extend(remarks.into_iter().map(|remark| match files.len() {
                        1 => remark,
                        _ => format!("{}: {remark}", file.display()),
                    }));
                }
                out.write_feet(all, &read_files(files, &earlier))
            }
            Self::Xsensor(vendor) => import(Format::Xsensor, vendor),
            Self::Tekscan(vendor) => import(Format::Tekscan, vendor),
            Self::Emed(vendor) => import(Format::Emed, vendor),
            Self::Footscan(vendor) => import(Format::Footscan, vendor),
            Self::Moticon(vendor) => import(Format::Moticon, vendor),
            Self::Loadsol(vendor) => import(Format::Loadsol, vendor),
            Self::Gaitpdb(vendor) => import(Format::Gaitpdb, vendor),
            Self::Pliance(vendor) => import(Format::Pliance, vendor),
            Self::Csv { layout, frames, side, part, fixed, out } => {
                fixed.check(layout)?;
                check_written(&[layout.clone(), frames.clone()], &[Some(&out.out)])?;
                let rate_hz = out.rate_hz()?;
                let recording = csv::import(layout, frames, (*side).into(), part.span()?, rate_hz, &mut report)?;
                bar.finish_and_clear();
                out.write_resampled(recording, &out.out)
            }
            Self::Pedar { file, geometry, side, part, fixed, out } => {
                fixed.check(geometry)?;
                check_no_folder(file)?;
                if side.is_none() && pedar::feet(file)? == 1 {
                    bail!("{}: the export contains one foot; state it with --side", file.display());
                }
                let sides = side.map_or(vec![Side::Left, Side::Right], |side| vec![side.into()]);
                let export = pedar::import_feet(file, geometry, &sides, part.span()?, &mut report)?;
                bar.finish_and_clear();
                out.write_feet(export, &[file.clone(), geometry.clone()])
            }
            Self::Jiku { data, walker, trials, out } => {
                if *trials == 0 || *trials > jiku::TRIALS {
                    bail!("--trials {trials}: expected 1 to {}, the number of trials of each walker", jiku::TRIALS);
                }
                let recording = jiku::import(data, *walker, 0..*trials, &mut report)?;
                bar.finish_and_clear();
                out.write(recording, &out.out)
            }
            Self::Synthetic { side, steps, out } => {
                // A step occupies some 0.1 MB of memory.
                if !(1..=10_000).contains(steps) {
                    bail!("--steps {steps}: expected 1 to 10000");
                }
                out.write(synthetic::walk(&synthetic_walk((*side).into(), *steps)).recording, &out.out)
            }
        }
    }
}

/// Refuses a folder in the place of an exported file.
fn check_no_folder(file: &Path) -> Result<()> {
    ensure!(!file.is_dir(), "{} is a folder: name the exported files in it", file.display());
    Ok(())
}

/// The parameters of the computed walk of a foot. The steps of the left foot begin half a stride after those of the right one,
/// and their peak forces vary by another seed, so that the recordings of both feet together are those of a walk.
fn synthetic_walk(side: Side, steps: usize) -> SyntheticWalk {
    let right = SyntheticWalk { side, steps, ..SyntheticWalk::default() };
    match side {
        Side::Left => SyntheticWalk {
            delay_s: (right.stance_s + right.swing_s) / 2.0,
            seed: right.seed + 1,
            timing_seed: Some(right.seed),
            ..right
        },
        Side::Right => right,
    }
}

impl Out {
    /// Checks that the output file has no other ending than `.parquet`, because a recording is always Parquet. An ending begins
    /// with a letter: a name such as `trial-1.1` has none.
    fn check_name(&self) -> Result<()> {
        let ending = self.out.extension().unwrap_or_default();
        if ending != "parquet" && ending.to_string_lossy().starts_with(char::is_alphabetic) {
            bail!(
                "--out {}: use the extension .parquet; other commands convert a recording to other formats, for example plantar \
                 export csv",
                self.out.display()
            );
        }
        Ok(())
    }

    /// Writes one foot to the output file, or both feet to a file each. Fails if an output file is one of the files in `read`.
    fn write_feet(&self, export: Export, read: &[PathBuf]) -> Result<()> {
        for remark in &export.remarks {
            println!("{remark}");
        }
        let [left, right] =
            [Side::Left, Side::Right].map(|side| export.feet.iter().filter(|foot| foot.side == side).count());
        if left.max(right) > 1 {
            bail!(
                "the files contain the same foot more than once: import them one by one, each with its own --out, and \
                 with --side if its foot was not recognised correctly"
            );
        }
        let is_pair = left + right == 2;
        if let [first, second] = &export.feet[..] {
            print_notes(note_unless_same_walk(&first.source, &second.source).as_slice());
        }
        // For a folder, the names would be appended to its own name: `walks/` would result in the hidden file
        // `walks/.left.parquet`.
        if is_pair && (self.out.is_dir() || output::ends_with_separator(&self.out)) {
            bail!("{}: not a file, but a folder: name a file", self.out.display());
        }
        let paths: Vec<_> = export.feet.iter().map(|foot| self.path(is_pair.then_some(foot.side))).collect();
        check_written(read, &paths.iter().map(|path| Some(path.as_path())).collect::<Vec<_>>())?;
        export.feet.into_iter().zip(&paths).try_for_each(|(foot, path)| self.write(foot, path))
    }

    /// The output file of the only foot if `side` is `None`, or of this foot of a pair.
    fn path(&self, side: Option<Side>) -> PathBuf {
        side.map_or_else(|| self.out.clone(), |side| output::of_foot(&self.out, side))
    }

    /// The rate of the recording to write, Hz, if the option is given.
    fn rate_hz(&self) -> Result<Option<f64>> {
        match self.rate {
            Some(rate_hz) if !(20.0..=500.0).contains(&rate_hz) => {
                bail!("--rate {rate_hz}: expected 20 to 500 frames per second")
            }
            rate_hz => Ok(rate_hz),
        }
    }

    /// Resamples the recording according to the options, and continues with [`Out::write_resampled`].
    fn write(&self, recording: Recording, path: &Path) -> Result<()> {
        let recording = match self.rate_hz()? {
            None => recording,
            Some(rate_hz) => recording.at_rate(rate_hz)?,
        };
        self.write_resampled(recording, path)
    }

    /// Merges the cells of the recording according to the options, writes it with the warnings about it, and prints these and
    /// its summary.
    fn write_resampled(&self, mut recording: Recording, path: &Path) -> Result<()> {
        if let Some(cells) = self.cells {
            recording = recording.binned(cells).with_context(|| format!("--cells {cells}"))?;
        }
        let warnings = footprint::warnings(&recording);
        for warning in &warnings {
            recording.source += &format!(" {warning}");
        }
        recording.write(path)?;
        println!("wrote {}", path.display());
        for warning in &warnings {
            eprintln!("warning: {warning}");
        }
        crate::info::print(&recording);
        Ok(())
    }
}
