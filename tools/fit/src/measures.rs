//! Mechanical quantities of a region that can be compared between recordings and people: forces, areas, stiffness and energy
//! within the measured range.
//!
//! Single parameters of the force law compensate each other, so that they vary between two recordings of the same person
//! although the law does not. These quantities, except for the two energies, are values of the law itself, so they do not have
//! this ambiguity. Those at a reference area or a share of the peak force also vary with that reference, and stiffness and moduli
//! with C. The energies are those of the measured force over the deformation of the law.

use crate::fixed::FixedParameters;
use crate::interval::{self, Noise};
use crate::prior::{self, Coordinates};
use crate::trials::Moments;
use crate::{Filter, RegionCurves, Samples, steps};
use nalgebra::{Matrix5, Vector5};
use plantar::pipeline::model::ForceLaw;
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::f64::consts::PI;

/// The reference area, as a fraction of the largest area of a step (the median over the steps).
pub const REFERENCE_AREA: f64 = 0.7;
/// The reference forces, as fractions of the peak force of a step (the median over the steps).
pub const REFERENCE_FORCES: [f64; 3] = [0.25, 0.5, 0.75];
/// The reference forces that are equal for all people, N. Only those up to the peak force are used.
pub const FIXED_FORCES_N: [f64; 4] = [10.0, 50.0, 100.0, 200.0];
/// The reference strain: deformation divided by the thickness of the tissue.
pub const REFERENCE_STRAIN: f64 = 0.2;

/// A mechanical quantity of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity {
    /// Elastic force at [`REFERENCE_AREA`].
    ForceAtArea,
    /// Area at which the elastic force is this fraction of the peak force.
    AreaAtForce(f64),
    /// Area at which the elastic force has this value, N.
    AreaAtFixedForce(f64),
    /// Elastic force divided by deformation, at [`REFERENCE_STRAIN`].
    SecantStiffness,
    /// Derivative of the elastic force with respect to deformation, at [`REFERENCE_STRAIN`].
    TangentStiffness,
    /// Mean elastic stress (force divided by area) divided by strain, at [`REFERENCE_STRAIN`].
    SecantModulus,
    /// Derivative of the mean elastic stress with respect to strain, at [`REFERENCE_STRAIN`].
    TangentModulus,
    /// Mean viscous stress divided by the strain rate, at [`REFERENCE_STRAIN`].
    ViscousModulus,
    /// Work of the measured force up to the largest deformation, mean over the steps.
    LoadingEnergy,
    /// Work of the measured force over the whole contact, which is the area within the loop of force over deformation, mean
    /// over the steps.
    DissipatedEnergy,
}

impl Quantity {
    /// All quantities, in the order of tables.
    pub fn all() -> impl Iterator<Item = Self> {
        let others = [
            Self::SecantStiffness,
            Self::TangentStiffness,
            Self::SecantModulus,
            Self::TangentModulus,
            Self::ViscousModulus,
            Self::LoadingEnergy,
            Self::DissipatedEnergy,
        ];
        std::iter::once(Self::ForceAtArea)
            .chain(REFERENCE_FORCES.map(Self::AreaAtForce))
            .chain(FIXED_FORCES_N.map(Self::AreaAtFixedForce))
            .chain(others)
    }

    /// Name with unit, as in JSON and in tables of cohorts.
    pub fn name(self) -> String {
        match self {
            Self::ForceAtArea => "force_at_70_percent_area_n".into(),
            Self::AreaAtForce(share) => format!("area_at_{:.0}_percent_force_mm2", share * 100.0),
            Self::AreaAtFixedForce(force_n) => format!("area_at_{force_n:.0}_n_mm2"),
            Self::SecantStiffness => "secant_stiffness_n_mm".into(),
            Self::TangentStiffness => "tangent_stiffness_n_mm".into(),
            Self::SecantModulus => "secant_modulus_kpa".into(),
            Self::TangentModulus => "tangent_modulus_kpa".into(),
            Self::ViscousModulus => "viscous_modulus_kpa_s".into(),
            Self::LoadingEnergy => "loading_energy_mj".into(),
            Self::DissipatedEnergy => "dissipated_energy_mj".into(),
        }
    }

    /// Name and unit in words.
    pub fn title(self) -> (String, &'static str) {
        match self {
            Self::ForceAtArea => ("force at 70 % of the largest area".into(), "N"),
            Self::AreaAtForce(share) => (format!("area at {:.0} % of the peak force", share * 100.0), "mm2"),
            Self::AreaAtFixedForce(force_n) => (format!("area at {force_n:.0} N"), "mm2"),
            Self::SecantStiffness => ("secant stiffness at 20 % strain".into(), "N/mm"),
            Self::TangentStiffness => ("tangent stiffness at 20 % strain".into(), "N/mm"),
            Self::SecantModulus => ("secant modulus at 20 % strain".into(), "kPa"),
            Self::TangentModulus => ("tangent modulus at 20 % strain".into(), "kPa"),
            Self::ViscousModulus => ("viscous modulus at 20 % strain".into(), "kPa s"),
            Self::LoadingEnergy => ("energy of loading".into(), "mJ"),
            Self::DissipatedEnergy => ("energy dissipated per step".into(), "mJ"),
        }
    }
}

/// The value of a quantity with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measure {
    /// The quantity.
    pub quantity: Quantity,
    /// The value, in the unit of the quantity.
    pub value: f64,
    /// The 95 % interval. `None` for an energy of a single step, and for a force or an area that is relative to the largest area
    /// or the peak force of a single step, because the variation between steps is then unknown; `None` for another quantity
    /// than an energy if the fit had no prior, as with the paper's method, or if the interval is not finite.
    pub interval: Option<[f64; 2]>,
}

impl Measure {
    /// True if the interval is known and not wider than the value.
    pub fn is_determined(&self) -> bool {
        self.interval.is_some_and(|[low, high]| high - low <= self.value.abs())
    }

    /// True if both ends of the interval differ from the value by at most this fraction of it.
    pub fn is_within(&self, share: f64) -> bool {
        let margin = share * self.value.abs();
        self.interval.is_some_and(|[low, high]| high - self.value <= margin && self.value - low <= margin)
    }
}

/// Relative change of the value that determines C, for [`ScaleEffect`].
pub const SCALE_CHANGE: f64 = 0.2;

/// C and quantities that depend on it, for one value of the measurement or assumption that determines C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaledValues {
    /// C, m.
    pub c_m: f64,
    /// See [`Quantity::SecantStiffness`]; `None` if the steps do not reach the reference strain.
    pub secant_stiffness_n_mm: Option<f64>,
    /// See [`Quantity::SecantModulus`]; `None` if the steps do not reach the reference strain.
    pub secant_modulus_kpa: Option<f64>,
}

/// C and the quantities that depend on it, for a smaller and a larger value of the measurement or assumption that determines C.
/// Both values differ from the actual one by the fraction [`SCALE_CHANGE`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleEffect {
    /// With the smaller value.
    pub at_less: ScaledValues,
    /// With the larger value.
    pub at_more: ScaledValues,
}

/// The measure of a quantity; `None` if the region does not have it.
pub fn find(measures: &[Measure], quantity: Quantity) -> Option<&Measure> {
    measures.iter().find(|measure| measure.quantity == quantity)
}

/// Largest area and peak force of a step. The references of the quantities are the medians of both over the steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Peaks {
    /// Largest area, m2.
    pub area_m2: f64,
    /// Peak force, N.
    pub force_n: f64,
}

impl Peaks {
    /// The medians over steps.
    pub fn median(steps: impl IntoIterator<Item = Self> + Clone) -> Self {
        Self {
            area_m2: steps::median(steps.clone().into_iter().map(|step| step.area_m2)),
            force_n: steps::median(steps.into_iter().map(|step| step.force_n)),
        }
    }

    /// The standard errors of the logarithms of the medians over `steps`: the standard deviations over resamples of the steps,
    /// with the factor sqrt(n / (n - 1)), because a resample of n steps varies less than n new steps. Infinite for a single
    /// step, because its difference from other steps is unknown.
    pub fn relative_errors_of_median(steps: &[Self]) -> Self {
        let count = steps.len();
        if count < 2 {
            return Self { area_m2: f64::INFINITY, force_n: f64::INFINITY };
        }
        let resampled = |seed| Self::median(interval::drawn(seed, count).map(|i| steps[i]));
        let medians: Vec<Self> = (0..interval::RESAMPLES).map(resampled).collect();
        let error = |value: fn(&Self) -> f64| {
            let deviation = Moments::of(medians.iter().map(|median| value(median).ln())).and_then(|m| m.deviation);
            deviation.unwrap_or(f64::INFINITY) * (count as f64 / (count as f64 - 1.0)).sqrt()
        };
        Self { area_m2: error(|median| median.area_m2), force_n: error(|median| median.force_n) }
    }
}

/// The fit to a resample of the steps.
pub(crate) struct Resample {
    /// The force law.
    pub law: ForceLaw<f64>,
    /// The references of the resample.
    pub reference: Peaks,
}

/// The data from which the quantities of a region follow.
pub(crate) struct Basis<'b> {
    /// Largest area of the fitted steps, m2.
    pub area_max_m2: f64,
    /// Largest area and peak force of each step.
    pub steps: &'b [Peaks],
    /// The medians of `steps`.
    pub reference: Peaks,
    pub fixed: &'b FixedParameters,
}

impl Basis<'_> {
    /// A quantity of a force law with the fixed C, at these references. `None` for the energies, for a force that the law does
    /// not reach, for a strain that the steps do not reach, and for a fixed force above the peak force.
    fn of_law_at(&self, law: &ForceLaw<f64>, reference: Peaks, quantity: Quantity) -> Option<f64> {
        let c_m = self.fixed.c_m(law, self.area_max_m2);
        let elastic = |g: f64| law.force_n(g, 0.0);
        let area_m2 = |g: f64| PI * law.ab_m2 * g * (2.0 - g);
        let strain = |g: f64| g * c_m / self.fixed.thickness_m;
        // A law that is extrapolated beyond the largest deformation of the steps says nothing about the tissue.
        let g = REFERENCE_STRAIN * self.fixed.thickness_m / c_m;
        let g_max = law.area_ratio(self.area_max_m2).normalised_deformation();
        let slope = |f: &dyn Fn(f64) -> f64| (f(g * (1.0 + STEP)) - f(g * (1.0 - STEP))) / (2.0 * STEP * g);
        let stress = |g: f64| elastic(g) / area_m2(g);
        match quantity {
            Quantity::ForceAtArea => {
                Some(elastic(law.area_ratio(REFERENCE_AREA * reference.area_m2).normalised_deformation()))
            }
            Quantity::AreaAtForce(share) => inverse(&elastic, share * reference.force_n).map(|g| area_m2(g) * 1e6),
            // Whether the region carries a fixed force is decided for all steps, not for each resample.
            Quantity::AreaAtFixedForce(force_n) if force_n <= self.reference.force_n => {
                inverse(&elastic, force_n).map(|g| area_m2(g) * 1e6)
            }
            Quantity::AreaAtFixedForce(_) => None,
            _ if g > g_max || g >= 1.0 => None,
            Quantity::SecantStiffness => Some(elastic(g) / (g * c_m) * 1e-3),
            Quantity::TangentStiffness => Some(slope(&elastic) / c_m * 1e-3),
            Quantity::SecantModulus => Some(stress(g) / strain(g) * 1e-3),
            Quantity::TangentModulus => Some(slope(&stress) * self.fixed.thickness_m / c_m * 1e-3),
            Quantity::ViscousModulus => {
                // The viscous force is proportional to the rate, so its derivative with respect to the rate is the force at 1/s.
                let per_rate = law.force_n(g, 1.0) - elastic(g);
                Some(per_rate / area_m2(g) * self.fixed.thickness_m / c_m * 1e-3)
            }
            Quantity::LoadingEnergy | Quantity::DissipatedEnergy => None,
        }
    }

    /// See [`Self::of_law_at`], at the references of all steps.
    fn of_law(&self, law: &ForceLaw<f64>, quantity: Quantity) -> Option<f64> {
        self.of_law_at(law, self.reference, quantity)
    }

    /// The quantities at the most probable parameters `at`. The interval is the wider of two: that from the covariance matrix
    /// of the parameters and the standard errors of the references, and that of the fits to resampled steps, each with the
    /// references of its resample.
    pub fn measures(
        &self,
        at: &Coordinates,
        covariance: &Matrix5<f64>,
        noise: &Noise,
        resampled: &[Resample],
    ) -> Vec<Measure> {
        let errors = Peaks::relative_errors_of_median(self.steps);
        // The errors of the references are estimated from the steps, and the covariance from the samples.
        let of_steps = Noise { variance: 1.0, degrees_of_freedom: (self.steps.len() as f64 - 1.0).max(1.0) };
        let law_at = |at: &Coordinates| prior::parameters(at, 0.0, 0).law(self.area_max_m2, 1.0);
        let measure = |quantity: Quantity| {
            let value = self.of_law(&law_at(at), quantity)?;
            let ln_at = |i: usize, step: f64| {
                let mut moved = *at;
                moved[i] += step;
                self.of_law(&law_at(&moved), quantity).map_or(f64::NAN, f64::ln)
            };
            // All quantities are positive, and their logarithms are nearly linear in the coordinates.
            let gradient = Vector5::from_fn(|i, _| (ln_at(i, STEP) - ln_at(i, -STEP)) / (2.0 * STEP));
            let variance = (gradient.transpose() * covariance * gradient)[0];
            // A variance of NaN, if the law reaches the quantity on one side only, must not become 0 as by `f64::max`.
            let half_of_law = noise.quantile() * if variance < 0.0 { 0.0 } else { variance.sqrt() };
            let half_of_references = of_steps.quantile() * self.relative_error(&law_at(at), errors, quantity);
            let half = half_of_law.hypot(half_of_references);
            let from_covariance = [value * (-half).exp(), value * half.exp()];
            let values = resampled.iter().filter_map(|fit| self.of_law_at(&fit.law, fit.reference, quantity));
            let interval = match interval::middle(values) {
                Some([low, high]) if high - low > from_covariance[1] - from_covariance[0] => [low, high],
                _ => from_covariance,
            };
            Some(Measure { quantity, value, interval: half.is_finite().then_some(interval) })
        };
        Quantity::all().filter_map(measure).collect()
    }

    /// The standard error of the logarithm of a quantity that is due to the relative `errors` of the references.
    fn relative_error(&self, law: &ForceLaw<f64>, errors: Peaks, quantity: Quantity) -> f64 {
        let Peaks { area_m2, force_n } = self.reference;
        let ln_at = |area_factor: f64, force_factor: f64| {
            let reference = Peaks { area_m2: area_m2 * area_factor, force_n: force_n * force_factor };
            self.of_law_at(law, reference, quantity).map_or(f64::NAN, f64::ln)
        };
        let by_area = (ln_at(1.0 + STEP, 1.0) - ln_at(1.0 - STEP, 1.0)) / (2.0 * STEP);
        let by_force = (ln_at(1.0, 1.0 + STEP) - ln_at(1.0, 1.0 - STEP)) / (2.0 * STEP);
        // The error of a reference may be infinite although the quantity does not depend on this reference.
        let term = |slope: f64, error: f64| if slope == 0.0 { 0.0 } else { slope * error };
        term(by_area, errors.area_m2).hypot(term(by_force, errors.force_n))
    }

    /// See [`ScaleEffect`].
    pub fn scale_effect(&self, law: &ForceLaw<f64>) -> ScaleEffect {
        let at = |factor: f64| {
            let fixed = FixedParameters { scale: self.fixed.scale.scaled(factor), ..*self.fixed };
            let basis = Basis { fixed: &fixed, ..*self };
            ScaledValues {
                c_m: fixed.c_m(law, self.area_max_m2),
                secant_stiffness_n_mm: basis.of_law(law, Quantity::SecantStiffness),
                secant_modulus_kpa: basis.of_law(law, Quantity::SecantModulus),
            }
        };
        ScaleEffect { at_less: at(1.0 - SCALE_CHANGE), at_more: at(1.0 + SCALE_CHANGE) }
    }

    /// The quantities of a force law, without the energies and without intervals.
    pub fn values(&self, law: &ForceLaw<f64>) -> Vec<Measure> {
        let measure = |quantity| Some(Measure { quantity, value: self.of_law(law, quantity)?, interval: None });
        Quantity::all().filter_map(measure).collect()
    }
}

/// Step of numerical derivatives: relative to g and to the references, and absolute in the coordinates of the prior, which have
/// no unit.
const STEP: f64 = 1e-4;

/// The normalised deformation g, 0 to 1, at which an increasing function reaches `value`, by bisection; `None` if the function
/// is smaller at g = 1.
fn inverse(function: &dyn Fn(f64) -> f64, value: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, 1.0);
    if function(high) < value {
        return None;
    }
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if function(middle) < value { low = middle } else { high = middle }
    }
    Some(high)
}

/// The energies of the measured force over the deformation of a force law, with the interval of the mean over the steps. The
/// areas are not filtered: the delay of a filter between deformation and force would look like a loss of energy.
pub(crate) fn energies(curves: &[&RegionCurves], law: &ForceLaw<f64>) -> Vec<Measure> {
    let steps: Vec<[f64; 2]> = curves
        .iter()
        .map(|curves| {
            let samples = Samples::new([*curves], Filter::Direct);
            let deformation_m: Vec<f64> = samples.deformation(law).map(|(g, _)| law.c_m * g).collect();
            work_mj(&deformation_m, &samples.force_n)
        })
        .collect();
    let count = steps.len() as f64;
    let measure = |(i, quantity): (usize, Quantity)| {
        let Moments { mean, deviation, .. } = Moments::of(steps.iter().map(|step| step[i]))?;
        let interval = deviation.zip(StudentsT::new(0.0, 1.0, count - 1.0).ok()).map(|(deviation, t)| {
            let half = t.inverse_cdf(0.975) * deviation / count.sqrt();
            [mean - half, mean + half]
        });
        Some(Measure { quantity, value: mean, interval })
    };
    [Quantity::LoadingEnergy, Quantity::DissipatedEnergy].into_iter().enumerate().filter_map(measure).collect()
}

/// The work of a force, mJ: up to the largest deformation, and over the whole contact, which begins and ends without deformation.
fn work_mj(deformation_m: &[f64], force_n: &[f64]) -> [f64; 2] {
    let largest = (0..deformation_m.len()).max_by(|&a, &b| deformation_m[a].total_cmp(&deformation_m[b])).unwrap_or(0);
    let work = |samples: std::ops::Range<usize>| {
        samples.map(|i| (force_n[i] + force_n[i + 1]) / 2.0 * (deformation_m[i + 1] - deformation_m[i])).sum::<f64>()
    };
    let ends = |i: usize| deformation_m.get(i).map_or(0.0, |d| d * force_n[i] / 2.0);
    let last = deformation_m.len().saturating_sub(1);
    let loading = ends(0) + work(0..largest);
    [loading * 1e3, (loading + work(largest..last) - ends(last)) * 1e3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_that_of_a_spring_and_of_a_loop() {
        // A spring of 1 N/mm, loaded to 4 mm and unloaded: 8 mJ, of which nothing is dissipated.
        let deformation_m = [1e-3, 2e-3, 3e-3, 4e-3, 3e-3, 2e-3, 1e-3];
        let spring_n = deformation_m.map(|d| d * 1e3);
        let [loading, dissipated] = work_mj(&deformation_m, &spring_n);
        assert!((loading - 8.0).abs() < 1e-12 && dissipated.abs() < 1e-12, "{loading} {dissipated}");
        // The force is half as large during unloading.
        let half_n = [1.0, 2.0, 3.0, 4.0, 1.5, 1.0, 0.5];
        let [_, dissipated] = work_mj(&deformation_m, &half_n);
        // Loading 8 mJ; unloading (4 + 1.5)/2 + (1.5 + 1)/2 + (1 + 0.5)/2 + 0.25 = 5 mJ.
        assert!((dissipated - 3.0).abs() < 1e-12, "{dissipated}");
    }

    /// With a slightly smaller K, the law does not reach 100 N, so the gradient of the area at this force is unknown.
    #[test]
    fn a_quantity_at_the_limit_of_the_law_has_no_interval() {
        let fixed = FixedParameters {
            aspect: 1.0,
            thickness_m: 0.012,
            is_thickness_measured: false,
            scale: crate::fixed::Scale::Assumed(0.457),
        };
        let area_max_m2 = 2e-3;
        let mut at = Coordinates::new(0.5, -0.5, 0.0, 13.0, 9.0);
        // The elastic force is proportional to K, and this coordinate is the logarithm of K.
        let largest_n = prior::parameters(&at, 0.0, 0).law(area_max_m2, 1.0).force_n(1.0, 0.0);
        at[3] += (100.0 * (1.0 + 1e-6) / largest_n).ln();
        let peaks = Peaks { area_m2: area_max_m2, force_n: 100.0 };
        let basis = Basis { area_max_m2, steps: &[peaks; 2], reference: peaks, fixed: &fixed };
        let noise = Noise { variance: 1.0, degrees_of_freedom: 100.0 };
        let measures = basis.measures(&at, &(Matrix5::identity() * 1e-4), &noise, &[]);
        let interval = |force_n| find(&measures, Quantity::AreaAtFixedForce(force_n)).expect("reached").interval;
        assert_eq!(interval(100.0), None);
        assert!(interval(50.0).is_some_and(|[low, high]| low < high));
    }
}
