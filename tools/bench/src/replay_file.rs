//! Measures a replay from a file to steps: its speed, compared with pandas and NumPy, and its memory for a recording of a day.

use crate::python;
use crate::replay::python_arguments;
use anyhow::{Result, bail};
use bench::Figures;
use parameters::{InsoleSize, Parameters};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use rayon::prelude::*;
use recording::{MAX_CELLS, Recording, RecordingReader, VirtualInsole, synthetic};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Number of steps of the walk.
const STEPS: usize = 300;
/// Number of repetitions of the walk in a longer file, so that the start of the threads takes a negligible part of the time.
const REPETITIONS: usize = 12;
/// Number of runs. The fastest one is reported, because other processes slow the others down.
const RUNS: usize = 10;
/// Number of hours in the recording of a day, which has one file for each hour. The wearer walks in every third hour.
const HOURS: usize = 24;
const SECONDS_PER_HOUR: usize = 3600;

/// Measures the replay; `python` is an interpreter with pandas, and `plantar` the command line.
pub fn measure(python: &Path, plantar: &Path, figures: &mut Figures) -> Result<()> {
    let mut walk = synthetic::walk(&synthetic::SyntheticWalk { steps: STEPS, ..Default::default() }).recording;
    // Round to 0.25 kPa, about the resolution of a converter with 12 bits over 1,000 kPa.
    walk.pressure_kpa.iter_mut().for_each(|kpa| *kpa = (*kpa * 4.0).round() / 4.0);
    let directory = tempfile::tempdir()?;
    let frames = walk.frames() * REPETITIONS;
    let long_path = directory.path().join("long.parquet");
    repeated(&walk, 0, frames).write(&long_path)?;
    let mut best_s = f64::INFINITY;
    let mut steps = 0;
    for _ in 0..RUNS {
        let start = Instant::now();
        steps = replay(&long_path)?;
        best_s = best_s.min(start.elapsed().as_secs_f64());
    }
    std::fs::remove_file(long_path)?;
    let per_s = (frames as f64 / best_s).round();
    let cells = walk.cells();
    figures.add(
        "replay_file_frames_per_s",
        per_s,
        &format!(
            "at least 1,000,000: Parquet on disk to {steps} steps, {frames} frames of {cells} cells, f32, all cores, \
             frames/s"
        ),
    );

    let walk_path = directory.path().join("walk.parquet");
    walk.write(&walk_path)?;
    let insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let arguments = python_arguments(&walk, &insole, directory.path())?;
    let numbers = python::run(python, "replay_numpy.py", directory.path(), &arguments)?.concat();
    let pandas_steps = numbers.get(1).map_or(0, |&steps| steps as usize);
    let own_steps = replay(&walk_path)?;
    if pandas_steps != own_steps {
        bail!("NumPy found {pandas_steps} steps in the file, this library {own_steps}");
    }
    let pandas_per_s = walk.frames() as f64 / numbers[0];
    figures.add(
        "replay_file_over_pandas",
        (per_s / pandas_per_s * 10.0).round() / 10.0,
        "at least 20: ratio of this speed to that of pandas and NumPy, vectorised as for numpy_frames_per_s, on a shorter file",
    );

    let day = directory.path().join("day");
    std::fs::create_dir(&day)?;
    let frames = SECONDS_PER_HOUR * walk.rate_hz as usize;
    let mut unloaded = walk.clone();
    unloaded.pressure_kpa.fill(0.0);
    (0..HOURS).into_par_iter().try_for_each(|hour| {
        let of_hour = if hour % 3 == 0 { &walk } else { &unloaded };
        repeated(of_hour, hour * frames, frames).write(day.join(format!("{hour:02}.parquet")))
    })?;
    let command = [plantar.as_os_str(), "replay".as_ref(), day.as_os_str()];
    let command = command.map(|argument| argument.to_string_lossy().into_owned());
    let peak_mb = python::run(python, "peak_memory.py", directory.path(), &command)?.concat()[0];
    figures.add(
        "replay_file_peak_mb",
        peak_mb.round(),
        &format!("at most 300: memory of `plantar replay` for a day, {} frames of {cells} cells, MB", HOURS * frames),
    );
    Ok(())
}

/// A recording of `frames` frames from frame `first` of an endless repetition of a walk.
fn repeated(walk: &Recording, first: usize, frames: usize) -> Recording {
    let mut recording = Recording { t_s: Vec::new(), pressure_kpa: Vec::new(), ..walk.clone() };
    for i in first..first + frames {
        recording.t_s.push(i as f64 / walk.rate_hz);
        recording.pressure_kpa.extend_from_slice(walk.frame(i % walk.frames()));
    }
    recording
}

/// Replays a recording; returns its number of steps.
fn replay(path: &Path) -> Result<usize> {
    let reader = RecordingReader::open(path)?;
    let insole = VirtualInsole::up_to(reader.largest_kpa()?, &reader.head, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut device = Box::new(Insole::<f32, MAX_CELLS>::new());
    device.set_up(insole.setup, insole.cells.iter().copied())?;
    device.set_tissue(&Parameters::typical(InsoleSize::default()).tissue())?;
    let mut scans = insole.scans(reader);
    let mut steps = 0;
    while let Some(scan) = scans.next_scan()? {
        if device.frame(scan.index as u32, scan.codes) {
            black_box(device.whole_step());
            steps += 1;
        }
    }
    Ok(steps)
}
