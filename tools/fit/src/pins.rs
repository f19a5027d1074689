//! The paper's eight parameters from the five that a force trace determines.
//!
//! Any change of A/B, C or d0 can be compensated by changes of the other parameters, so that the force remains the same: the
//! Jacobian of the force with respect to the eight parameters has rank 5. These three are pinned, which means that they are
//! determined by other measurements.

use plantar::pipeline::model::{Ellipsoid, ForceLaw};

/// Default value of [`Pins::compression`]: 45.7 % of the thickness, as measured under metatarsal heads (Cavanagh 1999).
pub const COMPRESSION: f64 = 0.457;

/// The values that pin A/B, C and d0 of one region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pins {
    /// A divided by B: the ratio of the radii of the measured contact ellipse.
    pub aspect: f64,
    /// d0, m.
    pub thickness_m: f64,
    /// Largest deformation divided by d0, 0 to 1. It determines C.
    pub compression: f64,
}

impl Pins {
    /// The C, m, for which the deformation is `compression` times d0 when the normalised deformation is `g_max`.
    pub fn c_m(&self, g_max: f64) -> f64 {
        self.compression * self.thickness_m / g_max
    }

    /// The ellipsoid that has these pins and the force of `law`. The function solves K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m
    /// for k and c.
    pub fn ellipsoid(&self, law: &ForceLaw<f64>) -> Ellipsoid<f64> {
        let (c_m, d0_m) = (law.c_m, self.thickness_m);
        let coefficient = |value: f64, exponent: f64| value * (d0_m / c_m).powf(exponent) / c_m;
        Ellipsoid {
            a_m: (law.ab_m2 * self.aspect).sqrt(),
            b_m: (law.ab_m2 / self.aspect).sqrt(),
            c_m,
            d0_m,
            k: coefficient(law.stiffness_pa, law.n),
            n: law.n,
            c: coefficient(law.damping_pa_s, law.m),
            m: law.m,
        }
    }
}
