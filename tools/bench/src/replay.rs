//! Measures the speed of a replay on one core, from recorded pressures to codes, live values and steps, and compares it with a
//! vectorised NumPy version of the same stages, which also smooths the area of each step.

use crate::python;
use anyhow::{Result, bail};
use bench::Figures;
use parameters::{InsoleSize, Parameters};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{Cell, MAX_CELLS, Recording, VirtualInsole, synthetic};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Number of steps of the walk.
const STEPS: usize = 300;
/// Number of runs. The fastest one is reported, because other processes slow the others down.
const RUNS: usize = 50;

/// Measures both versions; `python` is an interpreter with NumPy.
pub fn measure(python: &Path, figures: &mut Figures) -> Result<()> {
    let walk = synthetic::walk(&synthetic::SyntheticWalk { steps: STEPS, ..Default::default() }).recording;
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    let cells = virtual_insole.cells.len();
    let frames = walk.frames();
    let mut best_s = f64::INFINITY;
    let (mut steps, mut peak_n) = (0, [0.0f32; 8]);
    for _ in 0..RUNS {
        let mut insole = Box::new(Insole::<f32, MAX_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
        insole.set_tissue(&tissue)?;
        let mut codes = vec![0; cells];
        steps = 0;
        let start = Instant::now();
        for i in 0..frames {
            virtual_insole.codes_of(&walk, i, &mut codes);
            if insole.frame(i as u32, &codes) {
                black_box(insole.whole_step());
                steps += 1;
            }
            for (peak, load) in peak_n.iter_mut().zip(insole.loads()) {
                *peak = peak.max(load.tissue.model_n);
            }
        }
        best_s = best_s.min(start.elapsed().as_secs_f64());
    }
    let per_s = (frames as f64 / best_s).round();
    figures.add(
        "replay_frames_per_s",
        per_s,
        &format!("replay of {frames} frames of {cells} cells with {steps} steps, f32, one core, frames/s"),
    );

    let directory = tempfile::tempdir()?;
    let bytes: Vec<u8> = walk.pressure_kpa.iter().flat_map(|kpa| kpa.to_le_bytes()).collect();
    std::fs::write(directory.path().join("pressure.f32"), bytes)?;
    let arguments = python_arguments(&walk, &virtual_insole, directory.path())?;
    let numbers = python::run(python, "replay_numpy.py", directory.path(), &arguments)?.concat();
    let [seconds, numpy_steps, numpy_peaks @ ..] = &numbers[..] else {
        bail!("replay_numpy.py printed unexpected numbers: {numbers:?}")
    };
    // The speeds can be compared only if both versions compute the same.
    if *numpy_steps as usize != steps {
        bail!("NumPy found {numpy_steps} steps, this library {steps}");
    }
    if numpy_peaks.len() != peak_n.len() {
        bail!("replay_numpy.py printed {} peak forces instead of {}", numpy_peaks.len(), peak_n.len());
    }
    for (region, (numpy, own)) in numpy_peaks.iter().zip(peak_n).enumerate() {
        let is_equal = (numpy - f64::from(own)).abs() <= 0.01 * numpy.abs();
        // NaN is not equal.
        if !is_equal {
            bail!("region {region}: NumPy's peak model force is {numpy} N, this library's {own} N");
        }
    }
    let numpy_per_s = frames as f64 / seconds;
    figures.add(
        "numpy_frames_per_s",
        numpy_per_s.round(),
        "the same stages in NumPy, vectorised over all frames except for hysteresis and steps, frames/s",
    );
    figures.add("replay_over_numpy", (per_s / numpy_per_s * 100.0).round() / 100.0, "ratio of the two speeds");
    Ok(())
}

/// Writes the cells and the typical force laws for replay_numpy.py to a folder, and returns the arguments of the script after
/// the folder.
pub fn python_arguments(walk: &Recording, insole: &VirtualInsole, folder: &Path) -> Result<Vec<String>> {
    let write = |name: &str, values: Vec<f32>| {
        let bytes: Vec<u8> = values.into_iter().flat_map(f32::to_le_bytes).collect();
        std::fs::write(folder.join(name), bytes)
    };
    let cell = |c: &Cell| [c.x_mm as f32, c.y_mm as f32, c.area_mm2 as f32, c.region as u8 as f32, 1.0];
    write("cells.f32", walk.layout.cells.iter().flat_map(cell).collect())?;
    let law = |&ForceLaw { ab_m2, c_m, stiffness_pa, damping_pa_s, n, m }: &ForceLaw<f32>| {
        [ab_m2, c_m, stiffness_pa, damping_pa_s, n, m]
    };
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    write("force_laws.f32", tissue.force_laws.iter().flat_map(law).collect())?;
    let sensor = insole.setup.sensor;
    Ok([sensor.full_kpa, sensor.exponent, walk.rate_hz as f32].map(|v| v.to_string()).into())
}
