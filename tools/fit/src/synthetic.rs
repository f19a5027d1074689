//! Computed steps with known true parameters, for tests and benchmarks. The curves of the area have a plausible shape. The forces
//! follow from the filtered areas by the force law of the device. The deformation rates and the live filter are implemented here
//! a second time, in a straightforward form, as a check of the device's implementation.

use crate::{Filter, RegionCurves, Step, smooth};
use plantar::Side;
use plantar::pipeline::curves::STANCE_SAMPLES;
use plantar::pipeline::model::ForceLaw;
use std::f64::consts::PI;

/// Two arrays for each region. The first contains A B (mm2), K (kPa), G (kPa s), n and m. The second contains the start and the
/// end of the contact as fractions of stance, and the largest area divided by pi A B.
pub const TRUTH: [([f64; 5], [f64; 3]); 8] = [
    ([1150.0, 480.0, 20.0, 1.2, 0.8], [0.0, 0.6, 0.75]),
    ([600.0, 400.0, 16.0, 0.8, 1.0], [0.05, 0.7, 0.6]),
    ([560.0, 440.0, 12.0, 1.0, 0.6], [0.08, 0.75, 0.65]),
    ([850.0, 560.0, 18.0, 1.6, 1.1], [0.15, 0.95, 0.8]),
    ([1100.0, 380.0, 15.0, 1.4, 0.9], [0.12, 0.95, 0.7]),
    ([540.0, 550.0, 12.0, 1.1, 0.7], [0.3, 1.0, 0.8]),
    ([190.0, 900.0, 20.0, 0.9, 1.2], [0.35, 1.0, 0.7]),
    ([250.0, 1700.0, 60.0, 1.3, 1.0], [0.35, 0.98, 0.65]),
];

/// Time from heel strike to toe off, s.
const STANCE_S: f64 = 0.7;

/// The force law of the region with index `region` according to [`TRUTH`]. C is 10 mm.
pub fn law(region: usize) -> ForceLaw<f64> {
    let [ab_mm2, k, g, n, m] = TRUTH[region].0;
    ForceLaw { ab_m2: ab_mm2 * 1e-6, c_m: 0.01, stiffness_pa: k * 1e3, damping_pa_s: g * 1e3, n, m }
}

/// A source of normally distributed random numbers with mean 0 and variance 1.
pub struct Noise {
    random: fastrand::Rng,
    autocorrelation: f64,
    /// The last result of [`Noise::normal`]; `None` before the first one.
    last: Option<f64>,
}

impl Noise {
    /// Independent numbers. Equal seeds result in equal noise.
    pub fn new(seed: u64) -> Self {
        Self::autocorrelated(seed, 0.0)
    }

    /// Numbers with this correlation between successive numbers, which is at least 0 and below 1.
    pub fn autocorrelated(seed: u64, autocorrelation: f64) -> Self {
        Self { random: fastrand::Rng::with_seed(seed), autocorrelation, last: None }
    }

    /// A number that is independent of all others, even if the source is autocorrelated.
    pub fn independent(&mut self) -> f64 {
        // The sum of twelve uniformly distributed numbers has variance 1 and is nearly normally distributed (Irwin-Hall).
        (0..12).map(|_| self.random.f64()).sum::<f64>() - 6.0
    }

    /// The next number. Its correlation with the number before is the autocorrelation of the source.
    pub fn normal(&mut self) -> f64 {
        let fresh = self.independent();
        let correlation = self.autocorrelation;
        // The first number has variance 1, as all others have.
        let next = match self.last {
            None => fresh,
            Some(last) => correlation * last + (1.0 - correlation * correlation).sqrt() * fresh,
        };
        self.last = Some(next);
        next
    }
}

/// The curves of a region in one step. The area rises faster than it falls. `size` scales the area. `noise` is the standard
/// deviation of the noise of the force, relative to the peak force; `source` generates this noise. Only the force curve that
/// belongs to `filter` is computed; the other one is zero.
pub fn curves(region: usize, rate_hz: f64, filter: Filter, size: f64, noise: f64, source: &mut Noise) -> RegionCurves {
    let ([ab_mm2, ..], [start, end, share]) = TRUTH[region];
    let area = |t_s: f64| {
        let phase = (t_s / STANCE_S - start) / (end - start);
        if phase <= 0.0 || phase >= 1.0 {
            return 0.0;
        }
        let warped = phase.powf(0.7);
        PI * ab_mm2 * share * size * (PI * warped).sin().powf(0.8)
    };
    let frames = (STANCE_S * rate_hz).round() as usize;
    let every_frame: Vec<f64> = (0..frames).map(|i| area(i as f64 / rate_hz)).collect();
    // A device stores every second frame of a stance that is too long for its memory.
    let stride = if frames > STANCE_SAMPLES { 2 } else { 1 };
    let stored: Vec<f64> = every_frame.iter().copied().step_by(stride).collect();
    let mut curves = RegionCurves {
        frame_force_n: vec![0.0; every_frame.len()],
        force_n: vec![0.0; stored.len()],
        frame_area_mm2: every_frame,
        area_mm2: stored,
        frame_s: 1.0 / rate_hz,
        sample_s: stride as f64 / rate_hz,
        ..RegionCurves::default()
    };
    let mut force = forces(&curves, filter, &law(region));
    let peak_n = force.iter().copied().fold(0.0, f64::max);
    for (force, area) in force.iter_mut().zip(curves.of(filter).0) {
        if *area > 0.0 {
            *force += noise * peak_n * source.normal();
        }
    }
    match filter {
        Filter::Direct | Filter::Smoothed => curves.force_n = force,
        Filter::Live => curves.frame_force_n = force,
    }
    curves
}

/// The force of the model, N, at each sample of the area that is the input of `filter`.
pub fn forces(curves: &RegionCurves, filter: Filter, law: &ForceLaw<f64>) -> Vec<f64> {
    let (area_mm2, _, sample_s) = curves.of(filter);
    let mut force_n = vec![0.0; area_mm2.len()];
    let Some(first) = area_mm2.iter().position(|a| *a > 0.0) else { return force_n };
    let last = area_mm2.iter().rposition(|a| *a > 0.0).unwrap_or(first);
    let g_of = |mm2: f64| law.area_ratio(mm2.max(0.0) * 1e-6).normalised_deformation();
    match filter {
        Filter::Direct => {
            let g: Vec<f64> = area_mm2[first..=last].iter().map(|a| g_of(*a)).collect();
            let half = ((0.01 / sample_s).round() as usize).max(1);
            for i in 0..g.len() {
                let (before, after) = (i.saturating_sub(half), (i + half).min(g.len() - 1));
                let seconds = (after - before).max(1) as f64 * sample_s;
                force_n[first + i] = law.force_n(g[i], (g[after] - g[before]) / seconds);
            }
        }
        Filter::Smoothed => {
            let mut area = area_mm2[first..=last].to_vec();
            smooth::moving_average(&mut area);
            smooth::polynomial(&mut area);
            let g: Vec<f64> = area.iter().map(|a| g_of(*a)).collect();
            let mut rate = 0.0;
            for i in 0..g.len() {
                if i + 1 < g.len() {
                    rate = (g[i + 1] - g[i]) / sample_s;
                }
                force_n[first + i] = law.force_n(g[i], rate);
            }
        }
        Filter::Live => {
            let at = |i: isize| if i < 0 { 0.0 } else { area_mm2[i as usize] };
            let mean = |i: isize| (at(i - 2) + at(i - 1) + at(i)) / 3.0;
            for (i, force_n) in force_n.iter_mut().enumerate().take(last + 1).skip(first) {
                let (g, before) = (g_of(mean(i as isize)), g_of(mean(i as isize - 1)));
                *force_n = law.force_n(g, (g - before) / sample_s);
            }
        }
    }
    force_n
}

/// Computed steps with all regions. The areas of successive steps differ slightly. `noise` is the standard deviation of the
/// noise of the force, relative to the peak force. Equal seeds result in equal steps.
pub fn walk(steps: usize, rate_hz: f64, filter: Filter, noise: f64, seed: u64) -> Vec<Step> {
    let mut source = Noise::new(seed);
    (0..steps)
        .map(|number| {
            let size = 1.0 + 0.02 * (number as f64 % 5.0 - 2.0);
            Step {
                recording: 0,
                number: number as u32,
                side: Side::Right,
                start_s: number as f64,
                duration_s: STANCE_S,
                peak_n: 800.0,
                regions: std::array::from_fn(|region| curves(region, rate_hz, filter, size, noise, &mut source)),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::Noise;

    #[test]
    fn autocorrelated_noise_has_variance_1_from_the_first_number_on() {
        const SEEDS: u64 = 4_000;
        let mut squares = [0.0; 3];
        for seed in 0..SEEDS {
            let mut noise = Noise::autocorrelated(seed, 0.8);
            squares.iter_mut().for_each(|sum| *sum += noise.normal().powi(2));
        }
        for sum in squares {
            let variance = sum / SEEDS as f64;
            assert!((variance - 1.0).abs() < 0.1, "{variance}");
        }
    }
}
