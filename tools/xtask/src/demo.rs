//! The demonstration: identifies a walker's parameters, plays other steps in the emulator, and serves the page.

use crate::arguments::Demo;
use crate::build::{build_firmware, firmware};
use crate::command::{built, join, run, run_command};
use crate::setup::Python;
use crate::{EMULATED, page, setup};
use anyhow::Result;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Number of trials of the sample walk; each is one step.
const SAMPLE_TRIALS: &str = "36";
/// The demonstration plays this number of steps, from the first. This takes about 15 s.
const PLAYED_STEPS: usize = 12;
/// The parameters are fitted to these steps, none of which is played.
const FITTED_STEPS: &str = "12-35";

impl Demo {
    /// Runs the demonstration.
    pub fn run(&self) -> Result<()> {
        let with_page = !self.no_page && self.json.is_none() && std::io::stdout().is_terminal();
        let (plantar, jiku) = self.prepare(with_page)?;
        let mut steps = self.steps;
        let (walk, parameters) = match (&self.recording, jiku) {
            (None, Some(jiku)) => {
                let walk = sample_walk(&plantar, &jiku)?;
                let parameters = fit_walk(&plantar, &walk)?;
                steps = Some(steps.unwrap_or(PLAYED_STEPS).min(PLAYED_STEPS));
                (walk, Some(parameters))
            }
            (recording, _) => (std::path::absolute(recording.as_deref().unwrap_or(Path::new("")))?, None),
        };
        let with_insole = |command: &mut Command| {
            command.arg("--firmware").arg(firmware(EMULATED));
            if let Some(parameters) = &parameters {
                command.arg("--params").arg(parameters);
            }
        };
        let mut command = Command::new(&plantar);
        command.arg("emulate").arg(&walk).args(["--speed", &self.speed]);
        with_insole(&mut command);
        if let Some(steps) = steps {
            command.args(["--steps", &steps.to_string()]);
        }
        if let Some(json) = &self.json {
            command.arg("--json").arg(std::path::absolute(json)?);
        }
        run_command(&mut command)?;
        if self.recording.is_none() {
            println!(
                "The insole's parameters were identified from steps {FITTED_STEPS} of this walker. The errors above \
                 are those of other steps.\nReport on the identification: {}",
                report().display()
            );
        }
        if with_page {
            page::build()?;
            println!("The page for a phone now shows the same walk:");
            let mut command = Command::new(&plantar);
            command.arg("serve").arg("--emulate").arg(&walk);
            with_insole(&mut command);
            run_command(command.arg("--page").arg(page::dist()))?;
        }
        Ok(())
    }

    /// Builds the firmware and the command line, and meanwhile installs the other programs. Returns the path of the command line
    /// and, unless the user gave a recording, the path of the data set of the sample walk.
    fn prepare(&self, with_page: bool) -> Result<(PathBuf, Option<PathBuf>)> {
        setup::rust()?;
        std::thread::scope(|scope| {
            let firmware = scope.spawn(|| build_firmware(EMULATED));
            let plantar = scope.spawn(|| build_plantar(with_page));
            setup::qemu()?;
            let python = self.recording.is_none().then(setup::python).transpose()?;
            if with_page {
                page::install()?;
            }
            join(firmware)?;
            Ok((join(plantar)?, python.map(|Python { jiku, .. }| jiku)))
        })
    }
}

/// Builds the command line with the profile `dev` and only the features that the demonstration uses, because this takes less
/// time.
fn build_plantar(with_page: bool) -> Result<PathBuf> {
    let common: &[&str] = &["build", "--locked", "--package", "plantar-cli", "--no-default-features"];
    let serve = ["--features", "serve"];
    run("cargo", &[common, if with_page { &serve[..] } else { &[][..] }].concat())?;
    Ok(built("debug/plantar"))
}

/// Imports the sample walk as a recording for the emulated board. Returns its path.
fn sample_walk(plantar: &Path, jiku: &Path) -> Result<PathBuf> {
    let walk = setup::cache().join("walk.parquet");
    let mut command = Command::new(plantar);
    command.args(["import", "jiku", "--walker", "0", "--trials", SAMPLE_TRIALS, "--rate", "100", "--cells", "240"]);
    run_command(command.arg("--data").arg(jiku).arg("--out").arg(&walk))?;
    Ok(walk)
}

/// Identifies the walker's parameters, and writes a report. Returns the path of the parameters.
fn fit_walk(plantar: &Path, walk: &Path) -> Result<PathBuf> {
    let parameters = setup::cache().join("params.toml");
    let mut command = Command::new(plantar);
    command.arg("fit").arg(walk).args(["--steps", FITTED_STEPS, "--contact-full", "150", "--participant", "walker 0"]);
    run_command(command.arg("--out").arg(&parameters).arg("--report").arg(report()))?;
    Ok(parameters)
}

/// The path of the report on the identification.
fn report() -> PathBuf {
    setup::cache().join("report.html")
}
