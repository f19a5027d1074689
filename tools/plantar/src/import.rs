//! `plantar import`: converts the exports of other systems to recordings, and computes example recordings.

use crate::replay::progress;
use anyhow::{Result, bail};
use clap::{Args, Subcommand, ValueEnum};
use plantar::Side;
use recording::synthetic::{self, SyntheticWalk};
use recording::{Recording, csv, jiku, pedar};
use std::path::{Path, PathBuf};

#[derive(Subcommand)]
pub enum Import {
    /// Import two CSV files: the layout of the cells, and their pressures.
    ///
    /// The layout has the columns cell,x_mm,y_mm,area_mm2 and optionally region. It has one line per cell; cells are numbered
    /// from 0. x increases towards the lateral side of the foot, y from heel to toes. Without the column region, a template
    /// divides the foot into regions. The pressures are in a file with the columns t_s,c0,c1,...: time in s, and the pressure of
    /// each cell in kPa.
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
        out: Out,
    },
    /// Import an .asc file that the in-shoe system pedar exported, with the geometry of its insole.
    ///
    /// The geometry is a CSV file with the columns side,sensor,area_mm2,x1_mm,y1_mm,...,x4_mm,y4_mm, which has the area and the
    /// four corners of each sensor. Without --side, both feet are written, to NAME.left.parquet and NAME.right.parquet for
    /// --out NAME.parquet.
    Pedar {
        /// The exported .asc file.
        file: PathBuf,
        /// The file with the geometry.
        #[arg(long, value_name = "FILE")]
        geometry: PathBuf,
        /// Import only this foot.
        #[arg(long, value_enum)]
        side: Option<Foot>,
        #[command(flatten)]
        out: Out,
    },
    /// Import barefoot steps on a plate from the Python package jiku-data (data set SpeedPP2DS, GPLv3, 10 walkers).
    ///
    /// Each trial of that data set is one footprint. The trials are joined to a walk, with unloaded swing phases between them.
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
    Synthetic {
        /// The foot to compute.
        #[arg(long, value_enum, default_value_t = Foot::Right)]
        side: Foot,
        /// Number of steps.
        #[arg(long, value_name = "N", default_value_t = 10)]
        steps: usize,
        #[command(flatten)]
        out: Out,
    },
}

#[derive(Args)]
pub struct Out {
    /// The recording to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Merge the cells into a virtual insole with at most this number of cells. A real insole has at most 256.
    #[arg(long, value_name = "N")]
    cells: Option<usize>,
    /// Resample to this number of frames per second, 20 to 500. A real insole scans at 50 to 400 Hz.
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
    pub fn run(&self) -> Result<()> {
        let bar = progress(0, "bytes");
        let mut report = |done, total| {
            bar.set_length(total);
            bar.set_position(done);
        };
        match self {
            Self::Csv { layout, frames, side, out } => {
                let recording = csv::import(layout, frames, (*side).into(), &mut report)?;
                bar.finish_and_clear();
                out.write(recording, &out.out)
            }
            Self::Pedar { file, geometry, side: Some(side), out } => {
                let recording = pedar::import(file, geometry, (*side).into(), &mut report)?;
                bar.finish_and_clear();
                out.write(recording, &out.out)
            }
            Self::Pedar { file, geometry, side: None, out } => {
                for foot in [Side::Left, Side::Right] {
                    let recording = pedar::import(file, geometry, foot, &mut report)?;
                    bar.finish_and_clear();
                    out.write(recording, &out.out.with_extension(format!("{}.parquet", foot.name())))?;
                }
                Ok(())
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
                let walk = SyntheticWalk { side: (*side).into(), steps: *steps, ..SyntheticWalk::default() };
                out.write(synthetic::walk(&walk).recording, &out.out)
            }
        }
    }
}

impl Out {
    fn write(&self, mut recording: Recording, path: &Path) -> Result<()> {
        if let Some(rate_hz) = self.rate {
            if !(20.0..=500.0).contains(&rate_hz) {
                bail!("--rate {rate_hz}: expected 20 to 500 frames per second");
            }
            recording = recording.at_rate(rate_hz)?;
        }
        if let Some(cells) = self.cells {
            recording = recording.binned(cells)?;
        }
        recording.write(path)?;
        println!("wrote {}", path.display());
        crate::info::print(&recording);
        Ok(())
    }
}
