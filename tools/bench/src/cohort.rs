//! Measures the time of `plantar cohort`, and that of the Python package with Dask, for ten walkers with sixty steps each. Both
//! times include the reading of the recordings.

use anyhow::{Context, Result, bail};
use bench::Figures;
use recording::jiku;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Number of steps of all walkers.
const STEPS: usize = jiku::WALKERS * jiku::TRIALS;

/// Runs the command line at the path `plantar` on the data set in the folder `data`, and the Python package with Dask if `python`
/// is an interpreter that has it.
pub fn measure(plantar: &Path, python: Option<&Path>, data: &Path, figures: &mut Figures) -> Result<()> {
    let directory = tempfile::tempdir()?;
    let people = directory.path().join("people");
    for walker in 0..jiku::WALKERS {
        let folder = people.join(format!("walker {walker}"));
        std::fs::create_dir_all(&folder)?;
        jiku::import(data, walker, 0..jiku::TRIALS, &mut |_, _| ())?.write(folder.join("walk.parquet"))?;
    }
    let table = |name: &str| directory.path().join(name);
    let seconds = time(Command::new(plantar).arg("cohort").arg(&people).arg("--out").arg(table("table")))?;
    figures.add(
        "cohort_s",
        (seconds * 100.0).round() / 100.0,
        &format!("at most 60: time of `plantar cohort` for {STEPS} steps of ten walkers on all cores, s"),
    );
    if let Some(python) = python {
        let mut command = Command::new(python);
        let dask_s = time(command.args(["-m", "plantar.cohort"]).arg(&people).arg("--out").arg(table("dask")))?;
        figures.add(
            "cohort_dask_overhead",
            (dask_s / seconds * 100.0).round() / 100.0,
            "at most 3: time of `python -m plantar.cohort` in threads, with the start of Python and Dask, over cohort_s",
        );
    }
    Ok(())
}

/// The time of a command that fits all steps, s.
fn time(command: &mut Command) -> Result<f64> {
    let program = command.get_program().to_string_lossy().into_owned();
    let start = Instant::now();
    let output = command.output().with_context(|| format!("cannot run {program}"))?;
    let seconds = start.elapsed().as_secs_f64();
    if !output.status.success() {
        bail!("{program} failed to fit the cohort: {}", String::from_utf8_lossy(&output.stderr));
    }
    let stdout = String::from_utf8(output.stdout)?;
    if !stdout.contains(&format!("{STEPS} steps")) {
        bail!("{program} did not fit {STEPS} steps: {stdout}");
    }
    Ok(seconds)
}
