//! Measures the time of `plantar cohort` for ten walkers with sixty steps each. It includes the reading of the recordings.

use anyhow::{Context, Result, bail};
use bench::Figures;
use recording::jiku;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Runs the command line at the path `plantar` on the data set in the folder `data`.
pub fn measure(plantar: &Path, data: &Path, figures: &mut Figures) -> Result<()> {
    let directory = tempfile::tempdir()?;
    let people = directory.path().join("people");
    for walker in 0..jiku::WALKERS {
        let folder = people.join(format!("walker {walker}"));
        std::fs::create_dir_all(&folder)?;
        jiku::import(data, walker, 0..jiku::TRIALS, &mut |_, _| ())?.write(folder.join("walk.parquet"))?;
    }
    let start = Instant::now();
    let output = Command::new(plantar)
        .arg("cohort")
        .arg(&people)
        .arg("--out")
        .arg(directory.path().join("table"))
        .output()
        .with_context(|| format!("cannot run {}", plantar.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    if !output.status.success() {
        bail!("the cohort failed: {}", String::from_utf8_lossy(&output.stderr));
    }
    let stdout = String::from_utf8(output.stdout)?;
    let steps = jiku::WALKERS * jiku::TRIALS;
    if !stdout.contains(&format!("{steps} steps")) {
        bail!("the cohort did not fit {steps} steps: {stdout}");
    }
    figures.add(
        "cohort_s",
        (seconds * 100.0).round() / 100.0,
        &format!("at most 60: time of `plantar cohort` for {steps} steps of ten walkers on all cores, s"),
    );
    Ok(())
}
