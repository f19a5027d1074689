//! The force law in its identifiable form ([`plantar::pipeline::model::ForceLaw`]) for many samples at once, with its
//! derivatives.
//!
//! The parameter A B is replaced by `max_ratio`, the largest contact area divided by pi A B. The constraint of the model, that
//! pi A B exceeds every contact area, is then the bound `max_ratio < 1`.

use crate::Samples;
use std::f64::consts::PI;

/// The three parameters on which force depends nonlinearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Largest area divided by pi A B, 0 to 1.
    pub max_ratio: f64,
    /// Stiffness exponent.
    pub n: f64,
    /// Damping exponent.
    pub m: f64,
}

impl Shape {
    /// A B, m2, for samples with this largest area, m2.
    pub fn ab_m2(&self, area_max_m2: f64) -> f64 {
        area_max_m2 / (PI * self.max_ratio)
    }
}

/// The normalised deformation g of all samples, its rate, and the derivatives of both with respect to `max_ratio`.
#[derive(Default)]
pub(crate) struct Deformation {
    /// For each sample, pi A B times its weight ([`Samples::weight`]), m2/N.
    weighted_section_m2_per_n: Vec<f64>,
    /// Derivative of ln(pi A B) with respect to `max_ratio`.
    ln_section_by_max_ratio: f64,
    /// ln g; 0 without contact. As `g`, it has one value more than there are samples.
    ln_g: Vec<f64>,
    /// g of each sample and, as the last value, 0 for the unloaded tissue before contact; see [`Samples::share`].
    g: Vec<f64>,
    g_by_max_ratio: Vec<f64>,
    /// Rate of g, 1/s.
    rate: Vec<f64>,
    rate_by_max_ratio: Vec<f64>,
}

impl Deformation {
    /// Computes g and its rate in all samples for a `max_ratio` above 0 and below 1.
    pub fn set(&mut self, samples: &Samples, max_ratio: f64) {
        let section_m2 = samples.area_max_m2 / max_ratio;
        self.weighted_section_m2_per_n.clear();
        self.weighted_section_m2_per_n.extend(samples.weight.iter().map(|weight| section_m2 * weight));
        self.ln_section_by_max_ratio = -1.0 / max_ratio;
        self.g.clear();
        self.g_by_max_ratio.clear();
        self.ln_g.clear();
        for &share in &samples.share {
            let ratio = share * max_ratio;
            let root = (1.0 - ratio).sqrt();
            self.g.push(ratio / (1.0 + root));
            // The root is positive, because `max_ratio` is below 1.
            self.g_by_max_ratio.push(share / (2.0 * root));
        }
        self.ln_g.extend(self.g.iter().map(|&g| if g > 0.0 { g.ln() } else { 0.0 }));
        self.rate.clear();
        self.rate_by_max_ratio.clear();
        // The filter determines the two values of g from which the rate of a sample is computed, and the time between them.
        for (&(later, earlier), per_s) in samples.difference.iter().zip(&samples.per_s) {
            let (later, earlier) = (later as usize, earlier as usize);
            self.rate.push((self.g[later] - self.g[earlier]) * per_s);
            self.rate_by_max_ratio.push((self.g_by_max_ratio[later] - self.g_by_max_ratio[earlier]) * per_s);
        }
    }

    /// Writes the elastic term of the weighted force for K = 1 Pa, and its derivatives with respect to `max_ratio` and `n`, to
    /// `out`.
    pub fn elastic(&self, n: f64, out: &mut Column) {
        self.fill(out, |i, g, ln_g| {
            let force = self.weighted_section_m2_per_n[i] * (ln_g * (n + 2.0)).exp() * (1.0 - g / 3.0);
            let by_g = (n + 2.0) / g - 1.0 / (3.0 - g);
            (force, force * (self.ln_section_by_max_ratio + by_g * self.g_by_max_ratio[i]))
        });
    }

    /// Writes the viscous term of the weighted force for G = 1 Pa s, and its derivatives with respect to `max_ratio` and `m`, to
    /// `out`.
    pub fn viscous(&self, m: f64, out: &mut Column) {
        self.fill(out, |i, g, ln_g| {
            let quadratic = 6.0 - 4.0 * g + g * g;
            let per_rate = self.weighted_section_m2_per_n[i] * (ln_g * (m + 1.0)).exp() * quadratic / (3.0 * (2.0 - g));
            let force = per_rate * self.rate[i];
            let by_g = (m + 1.0) / g + (2.0 * g - 4.0) / quadratic + 1.0 / (2.0 - g);
            let by_max_ratio = force * (self.ln_section_by_max_ratio + by_g * self.g_by_max_ratio[i]);
            (force, by_max_ratio + per_rate * self.rate_by_max_ratio[i])
        });
    }

    /// Fills `out`. For a sample in contact, `term` computes the force and its derivative with respect to `max_ratio` from the
    /// index of the sample, g and ln g. Both terms contain a power of g, so their derivative with respect to the exponent is the
    /// force times ln g.
    fn fill(&self, out: &mut Column, term: impl Fn(usize, f64, f64) -> (f64, f64)) {
        out.clear();
        for i in 0..self.rate.len() {
            let (g, ln_g) = (self.g[i], self.ln_g[i]);
            let (force, by_max_ratio) = if g > 0.0 { term(i, g, ln_g) } else { (0.0, 0.0) };
            out.push(force, by_max_ratio, force * ln_g);
        }
    }
}

/// One of the two terms of the weighted force for all samples, with its derivatives with respect to `max_ratio` and to its
/// exponent. The weighted force is the force times [`Samples::weight`]; it has no unit.
#[derive(Default)]
pub(crate) struct Column {
    pub force: Vec<f64>,
    pub by_max_ratio: Vec<f64>,
    pub by_exponent: Vec<f64>,
}

impl Column {
    fn clear(&mut self) {
        self.force.clear();
        self.by_max_ratio.clear();
        self.by_exponent.clear();
    }

    fn push(&mut self, force: f64, by_max_ratio: f64, by_exponent: f64) {
        self.force.push(force);
        self.by_max_ratio.push(by_max_ratio);
        self.by_exponent.push(by_exponent);
    }
}
