//! `plantar export`: writes recordings in the formats of other programs.

use crate::fit::print_notes;
use crate::paths::{check_folders, check_written};
use crate::setup::{InsoleArgs, note_unless_personal, note_unless_same_foot, time};
use crate::summary::counted;
use anyhow::{Result, ensure};
use clap::{Args, Subcommand};
use export::motion_bids::Names;
use export::{Foot, Session};
use recording::{Recording, note_unless_same_walk, output};
use std::path::{Path, PathBuf};

#[derive(Subcommand)]
pub enum Export {
    /// Write a C3D file: analog channels of force, centre of pressure, and force and area of the regions, and the events.
    ///
    /// The events are "Foot Strike" and "Foot Off" with the contexts "Left" and "Right".
    C3d(Options),
    /// Write OpenSim's external loads (.mot): force, point of application and torque of each foot.
    ///
    /// The columns are ground_force_l_vx and so on. The axes are fixed to the insole: x forwards, y upwards, z to the right.
    Mot(Options),
    /// Write OpenSim's external loads as a .sto file, with the same columns as .mot.
    Sto(Options),
    /// Write a MATLAB file (.mat, version 7): layout, frames, pressures of the cells, and all quantities of the steps.
    Mat(Options),
    /// Write a folder in the layout of Motion-BIDS.
    MotionBids {
        /// The name of the participant, in letters and digits.
        #[arg(long, value_name = "NAME", default_value = "01")]
        subject: String,
        /// The name of the task, in letters and digits.
        #[arg(long, value_name = "NAME", default_value = "walking")]
        task: String,
        #[command(flatten)]
        options: Options,
    },
    /// Write a CSV file in long form: a row for each time, quantity and region.
    Csv(Options),
    /// Write an MCAP file for Foxglove: channels of the frames, pressures of the cells as point clouds, steps, events.
    Mcap(Options),
}

#[derive(Args)]
pub struct Options {
    /// The recording of one foot, or the recordings of both feet on one clock.
    #[arg(required = true, num_args = 1..=2, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The file to write, with the extension of the format, or the folder of Motion-BIDS.
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Export from this time on, s, on the clock of the recording. The computation still begins with the recording's first
    /// frame.
    #[arg(long, value_name = "S", value_parser = time, allow_negative_numbers = true)]
    from: Option<f64>,
    /// Export up to this time, s, on the clock of the recording.
    #[arg(long, value_name = "S", value_parser = time, allow_negative_numbers = true)]
    to: Option<f64>,
    #[command(flatten)]
    insole: InsoleArgs,
}

impl Export {
    pub fn run(&self) -> Result<()> {
        let (Self::C3d(options)
        | Self::Mot(options)
        | Self::Sto(options)
        | Self::Mat(options)
        | Self::MotionBids { options, .. }
        | Self::Csv(options)
        | Self::Mcap(options)) = self;
        let out = &options.out;
        check_written(&options.insole.inputs(&options.recordings), &[Some(out)])?;
        check_folders(&[Some(out)])?;
        self.check_extension(out)?;
        // Only these formats contain results of the model.
        let session = options.session(matches!(self, Self::Mat(_) | Self::Mcap(_)))?;
        match self {
            Self::C3d(_) => export::c3d::write(&session, out)?,
            Self::Mot(_) | Self::Sto(_) => export::opensim::write(&session, out)?,
            Self::Mat(_) => export::mat::write(&session, out)?,
            Self::MotionBids { subject, task, .. } => {
                let names = Names { subject: subject.clone(), task: task.clone() };
                export::motion_bids::write(&session, &names, concat!("Plantar ", env!("PLANTAR_VERSION")), out)?;
            }
            Self::Csv(_) => export::csv::write(&session, out)?,
            Self::Mcap(_) => export::mcap::write(&session, out)?,
        }
        let steps: usize = session.feet.iter().map(|foot| foot.steps.len()).sum();
        eprintln!("{}: {}, {}", out.display(), counted(session.frames(), "frame"), counted(steps, "step"));
        Ok(())
    }

    /// Checks the extension of the file to write, so that a file in one format does not replace a result in another.
    fn check_extension(&self, out: &Path) -> Result<()> {
        let extension = match self {
            Self::C3d(_) => "c3d",
            Self::Mot(_) => "mot",
            Self::Sto(_) => "sto",
            Self::Mat(_) => "mat",
            Self::Csv(_) => "csv",
            Self::Mcap(_) => "mcap",
            // This format is a folder.
            Self::MotionBids { .. } => return Ok(()),
        };
        output::check_file_name(out)?;
        ensure!(out.extension().is_some_and(|of| of == extension), "{}: use the extension .{extension}", out.display());
        Ok(())
    }
}

impl Options {
    /// Replays the recordings with the options, and returns the data that are exported.
    fn session(&self, has_model: bool) -> Result<Session> {
        let parameters = self.insole.wearer.parameters_without_note()?;
        if has_model {
            note_unless_personal(&parameters);
        }
        let rule = self.insole.rule(&parameters)?;
        let foot = |path: &PathBuf| {
            let recording = Recording::read(path)?;
            if has_model {
                note_unless_same_foot(parameters.identified.as_ref(), recording.side);
            }
            let insole = self.insole.insole(&(&recording).into(), rule, path)?;
            anyhow::Ok(Foot::new(recording, &insole, &parameters.tissue(), &path.display().to_string())?)
        };
        let feet = self.recordings.iter().map(foot).collect::<Result<_>>()?;
        let session = Session::new(feet, self.from, self.to)?;
        if let [first, second] = &session.feet[..] {
            print_notes(note_unless_same_walk(&first.source, &second.source).as_slice());
        }
        Ok(session)
    }
}
