//! `plantar zero`: the zero of each cell, its reading without load, from a standing trial.

use crate::paths::check_written;
use anyhow::{Result, bail};
use clap::Args;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{FootZero, Recording, StandingTrial, VirtualInsole};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Standard acceleration of gravity, m/s2, for the weight of a person.
pub const GRAVITY_M_S2: f64 = 9.80665;
/// Largest acceptable difference between the force of both feet and the body weight, % of body weight.
const GOOD_PERCENT: f64 = 10.0;

/// Determines the zero of each cell, its reading without load, from a standing trial, and compares the measured force with the
/// body weight.
///
/// In this trial, the person sits with both feet lifted for 5 s, stands still for 10 s, and sits with both feet lifted again for
/// 5 s. The command finds the exact times of these phases in the recording, and excludes half a second at each end of a phase.
/// Make sure that the feet are off the floor while the person sits: the command cannot detect this in a recording.
///
/// The zero applies to recordings with the same layout. The import of Moticon, and of insoles with a matrix sensor, such as
/// F-Scan and XSENSOR, fits the layout to each recording: import a walk first, then the standing trial with --like and the name
/// of the walk, and likewise all other walks.
///
/// The option --zero of `plantar fit`, `plantar replay`, `plantar gait`, `plantar export`, `plantar repeat`, `plantar emulate`
/// and `plantar serve` accepts the file.
#[derive(Args)]
pub struct Zero {
    /// The standing trial: the recording of one foot, or the recordings of both feet in the same trial.
    #[arg(required = true, num_args = 1..=2, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The zero file to write, TOML.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The person's mass, kg. Forces are then also printed in % of body weight and, if both feet are given, their sum is compared
    /// with the body weight.
    #[arg(long, value_name = "KG")]
    mass: Option<f64>,
}

impl Zero {
    pub fn run(&self) -> Result<()> {
        let weight_n = match self.mass {
            Some(kg) if !(10.0..=300.0).contains(&kg) => {
                bail!("--mass {kg}: expected the person's mass in kg, 10 to 300")
            }
            mass => mass.map(|kg| kg * GRAVITY_M_S2),
        };
        check_written(&self.recordings, &[Some(&self.out)])?;
        let mut zero = recording::Zero::default();
        let mut standing_n = Vec::new();
        for path in &self.recordings {
            let (side, foot, force_n) = measure(path, weight_n)?;
            if zero.foot_mut(side).replace(foot).is_some() {
                bail!("{}: two recordings of the {} foot; give one recording per foot", path.display(), side.name());
            }
            standing_n.push(force_n);
        }
        if let [one_n, other_n] = standing_n[..] {
            print_weight_check(one_n + other_n, weight_n);
        }
        zero.write(&self.out)?;
        println!("wrote {}", self.out.display());
        Ok(())
    }
}

/// Measures one foot and prints the result. Returns the foot's side, its zero, and its mean force while standing, N.
fn measure(path: &Path, weight_n: Option<f64>) -> Result<(Side, FootZero, f64)> {
    let place = path.display().to_string();
    let recording = Recording::read(path)?;
    let trial = StandingTrial::find(&recording, &place)?;
    let foot = FootZero::measure(&recording, &trial, &place)?;
    // The contact rule and the stance rule have no influence on the measured pressures.
    let mut insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    foot.apply_to(&mut insole, &place)?;

    let lifted_n = trial.lifted.clone().map(|phase| mean(phase, |i| recording.force_n(i)));
    let above_zero_n = |i| recording.layout.force_n(&insole.measured_kpa(recording.frame(i)));
    let standing_n = mean(trial.standing.clone(), above_zero_n);

    let times = |phase: &Range<usize>| {
        format!("{:6.2} s to {:6.2} s", recording.t_s[phase.start], recording.t_s[phase.end - 1])
    };
    let percent = weight_n.map_or(String::new(), |n| format!(", {:.1} % of body weight", 100.0 * standing_n / n));
    // Rounds to one decimal place. The addition of 0 avoids "-0.0".
    let tenths = |value: f64| (10.0 * value).round() / 10.0 + 0.0;
    let drift_n = lifted_n[1] - lifted_n[0];
    let least_kpa = foot.offset_kpa.iter().copied().fold(f32::INFINITY, f32::min);
    let most_kpa = foot.offset_kpa.iter().copied().fold(0.0, f32::max);
    println!("{} foot, {place}", recording.side.name());
    println!("  lifted    {}  reads {:.1} N", times(&trial.lifted[0]), lifted_n[0]);
    println!("  standing  {}  {standing_n:.1} N above zero{percent}", times(&trial.standing));
    println!(
        "  lifted    {}  reads {:.1} N: a drift of {:+.1} N, {:+.1} % of standing",
        times(&trial.lifted[1]),
        lifted_n[1],
        tenths(drift_n),
        tenths(100.0 * drift_n / standing_n)
    );
    println!("  zero      {} cells, {least_kpa:.1} to {most_kpa:.1} kPa", recording.cells());
    Ok((recording.side, foot, standing_n))
}

/// Prints the force of both feet and, if the body weight is known, their comparison.
fn print_weight_check(total_n: f64, weight_n: Option<f64>) {
    let Some(weight_n) = weight_n else {
        println!("both feet: {total_n:.1} N; give --mass to compare this with the body weight");
        return;
    };
    let percent = 100.0 * total_n / weight_n;
    let is_good = (percent - 100.0).abs() <= GOOD_PERCENT;
    let verdict = if is_good { "good" } else { "NOT good" };
    println!("both feet: {total_n:.1} N of {weight_n:.1} N, {percent:.1} % of body weight: {verdict}");
    if !is_good {
        println!(
            "  The difference is more than {GOOD_PERCENT} %: check that both feet were lifted and that the mass is \
             correct, then calibrate the gains of the sensors."
        );
    }
}

/// The mean of a value over frames.
fn mean(frames: Range<usize>, value: impl Fn(usize) -> f64) -> f64 {
    let count = frames.len() as f64;
    frames.map(value).sum::<f64>() / count
}
