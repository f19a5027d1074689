//! `plantar cohort` on ten walkers of sixty steps, reading included.

use anyhow::{Context, Result, bail};
use figures::Figures;
use recording::jiku;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

pub fn measure(plantar: &Path, data: &Path, figures: &mut Figures) -> Result<()> {
    let directory = tempfile::tempdir()?;
    let people = directory.path().join("people");
    for walker in 0..jiku::WALKERS {
        let folder = people.join(format!("walker {walker}"));
        std::fs::create_dir_all(&folder)?;
        jiku::import(data, walker, 0..jiku::TRIALS, &mut |_, _| ())?.write(folder.join("walk.parquet"))?;
    }
    let start = Instant::now();
    let ran = Command::new(plantar)
        .arg("cohort")
        .arg(&people)
        .arg("--out")
        .arg(directory.path().join("table"))
        .output()
        .with_context(|| format!("cannot run {}", plantar.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    if !ran.status.success() {
        bail!("the cohort failed: {}", String::from_utf8_lossy(&ran.stderr));
    }
    let said = String::from_utf8(ran.stdout)?;
    let steps = jiku::WALKERS * jiku::TRIALS;
    if !said.contains(&format!("{steps} steps")) {
        bail!("the cohort did not fit {steps} steps: {said}");
    }
    figures.add(
        "cohort_s",
        (seconds * 100.0).round() / 100.0,
        &format!("of 60: {steps} steps of ten walkers, all cores"),
    );
    Ok(())
}
