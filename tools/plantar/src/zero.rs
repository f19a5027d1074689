//! `plantar zero`: what unloaded cells read, from a standing trial.

use anyhow::{Result, bail};
use clap::Args;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use recording::{FootZero, Recording, StandingTrial, VirtualInsole};
use std::ops::Range;
use std::path::{Path, PathBuf};

const GRAVITY_M_S2: f64 = 9.80665;
/// Both feet measure the body's weight to this, percent.
const GOOD_PERCENT: f64 = 10.0;

/// Measures what unloaded cells read, and checks the scale against body weight.
///
/// The person sits and lifts both feet for 5 seconds, stands still for 10, and sits and lifts both feet again for 5.
/// When exactly does not matter: the times are found in the recording, half a second at each end is left out. While
/// sitting the feet must be off the floor: a recording does not show whether they rest on it.
///
/// `plantar fit`, `plantar replay` and `plantar emulate` take the file with --zero.
#[derive(Args)]
pub struct Zero {
    /// The standing trial of one foot, or the left and the right foot's of the same trial.
    #[arg(required = true, num_args = 1..=2, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The zero to write, a TOML file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The person's mass, kg: gives shares of body weight and, with both feet, checks the sensors' scale.
    #[arg(long, value_name = "KG")]
    mass: Option<f64>,
}

impl Zero {
    pub fn run(&self) -> Result<()> {
        let weight_n = match self.mass {
            Some(kg) if !(10.0..=300.0).contains(&kg) => bail!("--mass {kg}: the person's mass in kg, 10 to 300"),
            mass => mass.map(|kg| kg * GRAVITY_M_S2),
        };
        let mut zero = recording::Zero::default();
        let mut standing_n = Vec::new();
        for path in &self.recordings {
            let (side, foot, force_n) = measure(path, weight_n)?;
            if zero.foot_mut(side).replace(foot).is_some() {
                bail!("{}: the {} foot is there twice; give one recording a foot", path.display(), side.name());
            }
            standing_n.push(force_n);
        }
        if let [one_n, other_n] = standing_n[..] {
            judge(one_n + other_n, weight_n);
        }
        zero.write(&self.out)?;
        println!("wrote {}", self.out.display());
        Ok(())
    }
}

/// One foot's zero and its mean force while standing, N; prints what was found.
fn measure(path: &Path, weight_n: Option<f64>) -> Result<(Side, FootZero, f64)> {
    let place = path.display().to_string();
    let recording = Recording::read(path)?;
    let trial = StandingTrial::find(&recording, &place)?;
    let foot = FootZero::measure(&recording, &trial, &place)?;
    // No rule matters for pressures.
    let mut insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
    foot.wear(&mut insole, &place)?;

    let lifted_n = trial.lifted.clone().map(|part| mean(part, |i| recording.force_n(i)));
    let above_zero_n = |i| recording.layout.force_n(&insole.measured_kpa(recording.frame(i)));
    let standing_n = mean(trial.standing.clone(), above_zero_n);

    let times =
        |part: &Range<usize>| format!("{:6.2} s to {:6.2} s", recording.t_s[part.start], recording.t_s[part.end - 1]);
    let share = weight_n.map_or(String::new(), |n| format!(", {:.1} % of body weight", 100.0 * standing_n / n));
    // Adding 0 spares the reader a "-0.0".
    let tenths = |value: f64| (10.0 * value).round() / 10.0 + 0.0;
    let drift_n = lifted_n[1] - lifted_n[0];
    let least_kpa = foot.offset_kpa.iter().copied().fold(f32::INFINITY, f32::min);
    let most_kpa = foot.offset_kpa.iter().copied().fold(0.0, f32::max);
    println!("{} foot, {place}", recording.side.name());
    println!("  lifted    {}  reads {:.1} N", times(&trial.lifted[0]), lifted_n[0]);
    println!("  standing  {}  {standing_n:.1} N above zero{share}", times(&trial.standing));
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

/// Prints what both feet measure, against the body's weight where that is known.
fn judge(total_n: f64, weight_n: Option<f64>) {
    let Some(weight_n) = weight_n else {
        println!("both feet: {total_n:.1} N; --mass checks this against body weight");
        return;
    };
    let percent = 100.0 * total_n / weight_n;
    let is_good = (percent - 100.0).abs() <= GOOD_PERCENT;
    let verdict = if is_good { "good" } else { "NOT good" };
    println!("both feet: {total_n:.1} N of {weight_n:.1} N, {percent:.1} % of body weight: {verdict}");
    if !is_good {
        println!(
            "  more than {GOOD_PERCENT} % off: check that both feet were lifted and that the mass is right; \
             then calibrate the sensors' scale and gains"
        );
    }
}

fn mean(frames: Range<usize>, value: impl Fn(usize) -> f64) -> f64 {
    let count = frames.len() as f64;
    frames.map(value).sum::<f64>() / count
}
