//! All eight of the paper's parameters from the five that force can tell.
//!
//! The force does not change when C, d0 or A/B do and the rest follows (rank 5 of 8): these three are taken from elsewhere.

use plantar::model::{Ellipsoid, Gauge};

/// Peak compression that C is pinned by where nothing better is known: 45.7 % of the thickness, measured under metatarsal
/// heads (Cavanagh 1999).
pub const COMPRESSION: f64 = 0.457;

/// What pins A/B, C and d0 of one region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pins {
    /// A over B, of the measured contact ellipse.
    pub aspect: f64,
    /// d0, m.
    pub thickness_m: f64,
    /// Largest deformation over d0, 0 to 1.
    pub compression: f64,
}

impl Pins {
    /// C, m: the deformation is `compression` of d0 where the gauge is `g_max`.
    pub fn c_m(&self, g_max: f64) -> f64 {
        self.compression * self.thickness_m / g_max
    }

    /// The ellipsoid with the force of `gauge`: K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m, solved for k and c.
    pub fn ellipsoid(&self, gauge: &Gauge<f64>) -> Ellipsoid<f64> {
        let (c_m, d0_m) = (gauge.c_m, self.thickness_m);
        let coefficient = |value: f64, exponent: f64| value * (d0_m / c_m).powf(exponent) / c_m;
        Ellipsoid {
            a_m: (gauge.ab_m2 * self.aspect).sqrt(),
            b_m: (gauge.ab_m2 / self.aspect).sqrt(),
            c_m,
            d0_m,
            k: coefficient(gauge.stiffness_pa, gauge.n),
            n: gauge.n,
            c: coefficient(gauge.damping_pa_s, gauge.m),
            m: gauge.m,
        }
    }
}
