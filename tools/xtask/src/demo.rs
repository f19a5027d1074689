//! The demonstration: the wearer's parameters are identified from steps of an emulated insole, which then evaluates further
//! steps with them; at the end the page is served.

use crate::arguments::Demo;
use crate::build::{build_firmware, firmware};
use crate::command::{built, join, run, run_command};
use crate::{EMULATED, page, setup};
use anyhow::Result;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Number of trials of the sample walk; each is one step.
const SAMPLE_TRIALS: &str = "37";
/// The wearer's parameters are identified from this number of steps. The next step begins before the insole has received the
/// parameters, so 12 steps remain.
const IDENTIFIED_STEPS: &str = "24";
/// Pressure from which a cell counts with its whole area, kPa, as in the library's contact rule with covered shares.
const CONTACT_FULL_KPA: &str = "150";

impl Demo {
    /// Runs the demonstration.
    pub fn run(&self) -> Result<()> {
        let with_page = !self.no_page && self.json.is_none() && std::io::stdout().is_terminal();
        let (plantar, jiku) = self.prepare(with_page)?;
        let walk = match (&self.recording, jiku) {
            (None, Some(jiku)) => sample_walk(&plantar, &jiku)?,
            (recording, _) => std::path::absolute(recording.as_deref().unwrap_or(Path::new("")))?,
        };
        let session = setup::cache().join("session");
        let mut command = Command::new(&plantar);
        command.arg("emulate").arg(&walk).args(["--speed", &self.speed]).arg("--firmware").arg(firmware(EMULATED));
        if self.recording.is_none() {
            command.args(["--contact-full", CONTACT_FULL_KPA, "--identify-steps", IDENTIFIED_STEPS]);
            command.arg("--identify").arg(&session);
        }
        if let Some(steps) = self.steps {
            command.args(["--steps", &steps.to_string()]);
        }
        if let Some(json) = &self.json {
            command.arg("--json").arg(std::path::absolute(json)?);
        }
        run_command(&mut command)?;
        if self.recording.is_none() {
            println!("Recording, parameters and report of the identification: {}", session.display());
        }
        if with_page {
            page::build()?;
            println!("The page for a phone now shows the same walk:");
            let mut command = Command::new(&plantar);
            command.arg("serve").arg("--emulate").arg(&walk).arg("--firmware").arg(firmware(EMULATED));
            if self.recording.is_none() {
                command.arg("--params").arg(session.join("params.toml"));
            }
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
            let sample = self.recording.is_none().then(setup::sample).transpose()?;
            if with_page {
                page::install()?;
            }
            join(firmware)?;
            Ok((join(plantar)?, sample))
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
