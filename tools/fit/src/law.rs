//! Eq. 13 in the law form over many samples at once, with its derivatives.
//!
//! A B enters by `reach`, the largest area over pi A B: `reach < 1` is the constraint pi A B >= max Ae.

use crate::Samples;
use std::f64::consts::PI;

/// The three parameters that force does not depend on linearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Largest area over pi A B, 0 to 1.
    pub reach: f64,
    /// Stiffness exponent.
    pub n: f64,
    /// Damping exponent.
    pub m: f64,
}

impl Shape {
    /// A B, m2.
    pub fn ab_m2(&self, area_max_m2: f64) -> f64 {
        area_max_m2 / (PI * self.reach)
    }
}

/// Deformation of every sample, and its derivative by `reach`.
#[derive(Default)]
pub(crate) struct Deformation {
    /// pi A B times the sample's weight.
    section_m2: Vec<f64>,
    ln_section_rate: f64,
    /// ln g; 0 where there is no contact.
    ln_g: Vec<f64>,
    g: Vec<f64>,
    g_by_reach: Vec<f64>,
    rate: Vec<f64>,
    rate_by_reach: Vec<f64>,
}

impl Deformation {
    pub fn set(&mut self, samples: &Samples, reach: f64) {
        let section_m2 = samples.area_max_m2 / reach;
        self.section_m2.clear();
        self.section_m2.extend(samples.weight.iter().map(|weight| section_m2 * weight));
        self.ln_section_rate = -1.0 / reach;
        self.g.clear();
        self.g_by_reach.clear();
        self.ln_g.clear();
        for &share in &samples.share {
            let ratio = share * reach;
            let root = (1.0 - ratio).sqrt();
            self.g.push(ratio / (1.0 + root));
            // The root is positive: reach is below 1.
            self.g_by_reach.push(share / (2.0 * root));
        }
        self.ln_g.extend(self.g.iter().map(|&g| if g > 0.0 { g.ln() } else { 0.0 }));
        self.rate.clear();
        self.rate_by_reach.clear();
        for (&(later, earlier), per_s) in samples.difference.iter().zip(&samples.per_s) {
            let (later, earlier) = (later as usize, earlier as usize);
            self.rate.push((self.g[later] - self.g[earlier]) * per_s);
            self.rate_by_reach.push((self.g_by_reach[later] - self.g_by_reach[earlier]) * per_s);
        }
    }

    /// Weighted force for K = 1 Pa: the value, its derivative by `reach`, and by `n`.
    pub fn elastic(&self, n: f64, out: &mut Column) {
        self.fill(out, |i, g, ln_g| {
            let force = self.section_m2[i] * (ln_g * (n + 2.0)).exp() * (1.0 - g / 3.0);
            let by_g = (n + 2.0) / g - 1.0 / (3.0 - g);
            (force, force * (self.ln_section_rate + by_g * self.g_by_reach[i]))
        });
    }

    /// Weighted force for G = 1 Pa s: the value, its derivative by `reach`, and by `m`.
    pub fn viscous(&self, m: f64, out: &mut Column) {
        self.fill(out, |i, g, ln_g| {
            let quadratic = 6.0 - 4.0 * g + g * g;
            let per_rate = self.section_m2[i] * (ln_g * (m + 1.0)).exp() * quadratic / (3.0 * (2.0 - g));
            let force = per_rate * self.rate[i];
            let by_g = (m + 1.0) / g + (2.0 * g - 4.0) / quadratic + 1.0 / (2.0 - g);
            let by_reach = force * (self.ln_section_rate + by_g * self.g_by_reach[i]);
            (force, by_reach + per_rate * self.rate_by_reach[i])
        });
    }

    /// Force and its derivative by `reach` of every sample in contact, from its number, g and ln g; both terms are a power of
    /// g, so the derivative by the exponent follows.
    fn fill(&self, out: &mut Column, term: impl Fn(usize, f64, f64) -> (f64, f64)) {
        out.clear();
        for i in 0..self.rate.len() {
            let (g, ln_g) = (self.g[i], self.ln_g[i]);
            let (force, by_reach) = if g > 0.0 { term(i, g, ln_g) } else { (0.0, 0.0) };
            out.push(force, by_reach, force * ln_g);
        }
    }
}

/// One of the two terms of the force over all samples.
#[derive(Default)]
pub(crate) struct Column {
    pub force: Vec<f64>,
    pub by_reach: Vec<f64>,
    pub by_exponent: Vec<f64>,
}

impl Column {
    fn clear(&mut self) {
        self.force.clear();
        self.by_reach.clear();
        self.by_exponent.clear();
    }

    fn push(&mut self, force: f64, by_reach: f64, by_exponent: f64) {
        self.force.push(force);
        self.by_reach.push(by_reach);
        self.by_exponent.push(by_exponent);
    }
}
