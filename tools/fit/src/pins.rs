//! The paper's eight parameters from the five that a force trace determines.
//!
//! The force is the same for all values of A/B, C and d0 if the other parameters are adapted (the Jacobian has rank 5 of 8).
//! These three are pinned, which means that other measurements determine them.

use plantar::pipeline::model::{Ellipsoid, ForceLaw};

/// Default largest compression, which pins C: 45.7 % of the thickness, measured under metatarsal heads (Cavanagh 1999).
pub const COMPRESSION: f64 = 0.457;

/// The values that pin A/B, C and d0 of one region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pins {
    /// A divided by B: the ratio of the radii of the measured contact ellipse.
    pub aspect: f64,
    /// d0, m.
    pub thickness_m: f64,
    /// Largest deformation divided by d0, 0 to 1. It pins C.
    pub compression: f64,
}

impl Pins {
    /// C, m, such that the deformation at the normalised deformation `g_max` is `compression` times d0.
    pub fn c_m(&self, g_max: f64) -> f64 {
        self.compression * self.thickness_m / g_max
    }

    /// The ellipsoid with the force of `law`. Solves K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m for k and c.
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
