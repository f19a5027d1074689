//! The paper's eight parameters from the five that a force trace determines.
//!
//! Any change of A/B, C or d0 can be compensated by changes of the other parameters, so that the force remains the same: the
//! Jacobian of the force with respect to the eight parameters has rank 5. These three are fixed: they follow from other
//! measurements or assumptions.

pub use crate::scale::{Measured, Scale};

use plantar::pipeline::model::{Ellipsoid, ForceLaw};

/// Default of [`Scale::Assumed`]: 45.7 % of the thickness, as measured under metatarsal heads (Cavanagh 1999).
pub const COMPRESSION: f64 = 0.457;

/// The parameters of one region that the force does not determine: A/B, d0, and what determines C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixedParameters {
    /// A divided by B: the ratio of the radii of the ellipse that is fitted to the contact within the borders of the region; 1
    /// without such ellipses. After a search of all eight parameters, the ratio that was found.
    pub aspect: f64,
    /// d0, m.
    pub thickness_m: f64,
    /// True if d0 was measured, false if it is typical for the shoe size or was searched.
    pub is_thickness_measured: bool,
    /// What determines C.
    pub scale: Scale,
}

impl FixedParameters {
    /// C, m. `area_max_m2` is the largest contact area, at which the deformation is largest.
    pub fn c_m(&self, law: &ForceLaw<f64>, area_max_m2: f64) -> f64 {
        self.scale.c_m(law, area_max_m2, self.thickness_m)
    }

    /// Largest deformation divided by d0.
    pub fn compression(&self, law: &ForceLaw<f64>, area_max_m2: f64) -> f64 {
        let g_max = law.area_ratio(area_max_m2).normalised_deformation();
        self.c_m(law, area_max_m2) * g_max / self.thickness_m
    }

    /// The ellipsoid with the force and the C of `law`, and with the A/B and d0 of `self`. The function solves
    /// K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m for k and c.
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
