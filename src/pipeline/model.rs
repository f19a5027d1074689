//! The viscoelastic ellipsoid model: tissue deformation and force from contact area and area rate.
//!
//! DeBerardinis, Dufek, Trabia, "A viscoelastic ellipsoidal model of the mechanics of plantar tissues", J. Biomech. 92 (2019)
//! 137-145; equation numbers are those of this paper. SI units: m, m2, N, s, k in N/m3, c in N s/m3. docs/model.md has the
//! equations as implemented.

use crate::num::Real;
use core::ops::RangeInclusive;
use serde::{Deserialize, Serialize};

/// Range of radii and thicknesses, m: wide enough for any foot, and narrow enough to detect a wrong unit.
pub const LENGTH_M: RangeInclusive<f64> = 1e-4..=0.2;
/// Range of A B, the product of two radii, m2.
pub const AB_M2: RangeInclusive<f64> = 1e-8..=0.04;
/// Range of the stiffness K, Pa, and the damping G, Pa s, of [`ForceLaw`]: up to a thousand times the values of plantar tissue.
/// With all parameters at their limits, a force is below 1e11 N, and its square is within single precision.
pub const COEFFICIENT: RangeInclusive<f64> = 0.0..=1e9;
/// Largest exponent n or m; a steeper law is almost a step function. Both exponents are above -1, so that the force vanishes with
/// the deformation.
pub const MAX_EXPONENT: f64 = 10.0;

/// True if `value` is within the inclusive limits after rounding to single precision, in which parameters are sent.
pub fn is_within(value: f64, limits: &RangeInclusive<f64>) -> bool {
    (*limits.start() as f32..=*limits.end() as f32).contains(&(value as f32))
}

/// The paper's eight parameters of one region (Eq. 17).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ellipsoid<R> {
    /// A: radius along X (medial-lateral), m.
    pub a_m: R,
    /// B: radius along Y (heel-toe), m.
    pub b_m: R,
    /// C: vertical radius, m.
    pub c_m: R,
    /// Original tissue thickness, m.
    pub d0_m: R,
    /// Stiffness coefficient, N/m3.
    pub k: R,
    /// Stiffness exponent.
    pub n: R,
    /// Damping coefficient, N s/m3.
    pub c: R,
    /// Damping exponent.
    pub m: R,
}

impl<R: Real> Ellipsoid<R> {
    /// `Ae / (pi A B)`, contact area over the largest section of the ellipsoid, limited to 0..=1; see [`AreaRatio`].
    pub fn area_ratio(&self, area_m2: R) -> AreaRatio<R> {
        AreaRatio::new(area_m2, self.a_m * self.b_m)
    }

    /// Deformation at the centre from contact area, m (Eq. 14).
    pub fn deformation_m(&self, area_m2: R) -> R {
        self.c_m * self.area_ratio(area_m2).normalised_deformation()
    }

    /// Deformation rate from area and area rate, m/s (Eq. 15, with the factor 1/2 that follows from differentiation of Eq. 14 and
    /// that is missing in print). The area must be below pi A B.
    pub fn deformation_rate_m_s(&self, area_m2: R, area_rate_m2_s: R) -> R {
        let section_m2 = R::of(core::f64::consts::PI) * self.a_m * self.b_m;
        let a = area_m2 / section_m2;
        self.c_m * area_rate_m2_s / (R::of(2.0) * section_m2 * (R::ONE - a).sqrt())
    }

    /// Deformation rate from one sample to the next one, which is `dt_s` later, m/s (Eq. 16, a forward difference).
    pub fn deformation_rate_between_m_s(&self, area_m2: R, next_area_m2: R, dt_s: R) -> R {
        (self.deformation_m(next_area_m2) - self.deformation_m(area_m2)) / dt_s
    }

    /// Radii of the contact ellipse at a deformation, m (Eq. 1, 2).
    pub fn contact_radii_m(&self, deformation_m: R) -> (R, R) {
        let scale = (R::of(2.0) * self.c_m * deformation_m - deformation_m * deformation_m).sqrt() / self.c_m;
        (self.a_m * scale, self.b_m * scale)
    }

    /// Deformation at the point `q` (0 at the centre, 1 at the rim) of the contact ellipse, m (Eq. 3).
    pub fn local_deformation_m(&self, deformation_m: R, q: R) -> R {
        deformation_m - self.c_m + self.depth_m(deformation_m, q)
    }

    /// Rate of [`Ellipsoid::local_deformation_m`], m/s (Eq. 4). The paper differentiates at fixed `q`, not at a fixed point of
    /// the tissue. If all points moved at the rate of the centre, the viscous force would be twice as large at light contact, and
    /// the same at full contact.
    pub fn local_deformation_rate_m_s(&self, deformation_m: R, rate_m_s: R, q: R) -> R {
        rate_m_s * (R::ONE - q * q * (self.c_m - deformation_m) / self.depth_m(deformation_m, q))
    }

    /// Vertical distance from the centre of the ellipsoid to its surface at the point `q`, m.
    fn depth_m(&self, deformation_m: R, q: R) -> R {
        let chord = R::of(2.0) * self.c_m * deformation_m - deformation_m * deformation_m;
        (self.c_m * self.c_m - q * q * chord).sqrt()
    }

    /// Stiffness at a deformation, N/m3 (Eq. 5).
    pub fn stiffness(&self, deformation_m: R) -> R {
        self.k * power(deformation_m / self.d0_m, self.n)
    }

    /// Damping at a deformation, N s/m3 (Eq. 6).
    pub fn damping(&self, deformation_m: R) -> R {
        self.c * power(deformation_m / self.d0_m, self.m)
    }

    /// Vertical force, N (Eq. 13), not limited: negative during unloading if the viscous term exceeds the elastic term.
    pub fn force_n(&self, deformation_m: R, rate_m_s: R) -> R {
        if deformation_m <= R::ZERO {
            return R::ZERO;
        }
        let (three, six) = (R::of(3.0), R::of(6.0));
        let (d, c) = (deformation_m, self.c_m);
        let elastic = self.stiffness(d) * d * (R::ONE - d / (three * c));
        let shape = (six * c * c - R::of(4.0) * c * d + d * d) / (three * c * (R::of(2.0) * c - d));
        let viscous = self.damping(d) * rate_m_s * shape;
        R::of(core::f64::consts::PI) * self.a_m * self.b_m * d / c * (elastic + viscous)
    }

    /// The force law in its identifiable form. It gives the same force, except that it limits tension to 0.
    pub fn force_law(&self) -> ForceLaw<R> {
        ForceLaw {
            ab_m2: self.a_m * self.b_m,
            c_m: self.c_m,
            stiffness_pa: self.k * self.c_m * power(self.c_m / self.d0_m, self.n),
            damping_pa_s: self.c * self.c_m * power(self.c_m / self.d0_m, self.m),
            n: self.n,
            m: self.m,
        }
    }

    /// True if all numbers are finite, lengths positive, coefficients not negative and exponents above -1.
    pub fn is_valid(&self) -> bool {
        let positive = [self.a_m, self.b_m, self.c_m, self.d0_m].iter().all(|&v| v > R::ZERO && v.to_f64().is_finite());
        let coefficients = [self.k, self.c].iter().all(|&v| v >= R::ZERO && v.to_f64().is_finite());
        let exponents = [self.n, self.m].iter().all(|&v| v > -R::ONE && v.to_f64().is_finite());
        positive && coefficients && exponents
    }
}

/// `base^exponent` for a base that is not negative. A base of 0 yields 1 with the exponent 0, and 0 with any other one, also with
/// a negative one, because exponents above -1 yield no force at zero deformation.
fn power<R: Real>(base: R, exponent: R) -> R {
    if base <= R::ZERO {
        return if exponent == R::ZERO { R::ONE } else { R::ZERO };
    }
    (base.log2() * exponent).exp2()
}

/// `Ae / (pi A B)`, the contact area over the largest section of the ellipsoid, limited to 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaRatio<R> {
    /// The ratio, 0 to 1.
    pub ratio: R,
    /// The area was at least pi A B: the ratio was limited to 1, because the ellipsoid is too small for this contact. False
    /// without parameters (A B = 0).
    pub clamped: bool,
}

impl<R: Real> AreaRatio<R> {
    #[inline(always)]
    fn new(area_m2: R, ab_m2: R) -> Self {
        let ratio = area_m2 / (R::of(core::f64::consts::PI) * ab_m2);
        if ratio >= R::ONE {
            Self { ratio: R::ONE, clamped: ab_m2 > R::ZERO }
        } else if ratio > R::ZERO {
            Self { ratio, clamped: false }
        } else {
            // This also treats NaN as no contact.
            Self { ratio: R::ZERO, clamped: false }
        }
    }

    /// The normalised deformation, deformation over C: `g = 1 - sqrt(1 - a)` (Eq. 14), 0 to 1, in a form without cancellation at
    /// light contact.
    #[inline(always)]
    pub fn normalised_deformation(self) -> R {
        self.ratio / (R::ONE + (R::ONE - self.ratio).sqrt())
    }
}

/// The identifiable form of the force law (Eq. 13), which a device evaluates: with the normalised deformation `g = delta / C`,
/// `K = k C^(n+1) / d0^n` and `G = c C^(m+1) / d0^m`,
///
/// `F = pi A B [K g^(n+2) (1 - g/3) + G g^(m+1) g' (6 - 4g + g^2) / (3 (2 - g))]`.
///
/// A force trace determines A B, K, G, n and m. C only scales the displayed deformation.
///
/// ```
/// use core::f64::consts::PI;
/// use plantar::pipeline::model::ForceLaw;
///
/// let law = ForceLaw { ab_m2: 1e-3, c_m: 0.01, stiffness_pa: 3e5, ..ForceLaw::NONE };
/// // Eq. 14: with 3/4 of the largest section in contact, the deformation is C / 2.
/// let g = law.area_ratio(0.75 * PI * 1e-3).normalised_deformation();
/// assert!((g - 0.5).abs() < 1e-12);
/// // Eq. 13 with n = 0 and without damping: F = pi A B K g^2 (1 - g/3).
/// assert!((law.force_n(g, 0.0) - PI * 1e-3 * 3e5 * 0.25 * (1.0 - 0.5 / 3.0)).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct ForceLaw<R> {
    /// A B, m2.
    pub ab_m2: R,
    /// C, m.
    pub c_m: R,
    /// K, Pa.
    pub stiffness_pa: R,
    /// G, Pa s.
    pub damping_pa_s: R,
    /// Stiffness exponent.
    pub n: R,
    /// Damping exponent.
    pub m: R,
}

impl<R: Real> ForceLaw<R> {
    /// No parameters: deformation and model force are 0.
    pub const NONE: Self =
        Self { ab_m2: R::ZERO, c_m: R::ZERO, stiffness_pa: R::ZERO, damping_pa_s: R::ZERO, n: R::ZERO, m: R::ZERO };

    /// Converts a force law in single precision; exact.
    pub fn of(law: &ForceLaw<f32>) -> Self {
        Self {
            ab_m2: R::of_f32(law.ab_m2),
            c_m: R::of_f32(law.c_m),
            stiffness_pa: R::of_f32(law.stiffness_pa),
            damping_pa_s: R::of_f32(law.damping_pa_s),
            n: R::of_f32(law.n),
            m: R::of_f32(law.m),
        }
    }

    /// The force law rounded to single precision, as a device stores it.
    pub fn single(&self) -> ForceLaw<f32> {
        ForceLaw {
            ab_m2: self.ab_m2.to_f32(),
            c_m: self.c_m.to_f32(),
            stiffness_pa: self.stiffness_pa.to_f32(),
            damping_pa_s: self.damping_pa_s.to_f32(),
            n: self.n.to_f32(),
            m: self.m.to_f32(),
        }
    }

    /// `Ae / (pi A B)` of a contact area, m2, limited to 0..=1.
    #[inline(always)]
    pub fn area_ratio(&self, area_m2: R) -> AreaRatio<R> {
        AreaRatio::new(area_m2, self.ab_m2)
    }

    /// Vertical force, N, at a normalised deformation `g`, 0 to 1, and its rate, 1/s (Eq. 13). A tensile force is replaced by 0,
    /// because the contact cannot transmit it.
    pub fn force_n(&self, g: R, g_rate_per_s: R) -> R {
        let (elastic_pa, viscous_pa) = self.terms_pa(g, g_rate_per_s);
        (self.section_m2() * (elastic_pa + viscous_pa)).max(R::ZERO)
    }

    /// The largest section of the ellipsoid, pi A B, m2.
    #[inline(always)]
    pub fn section_m2(&self) -> R {
        R::of(core::f64::consts::PI) * self.ab_m2
    }

    /// The elastic and the viscous term of the force, which are proportional to K and to G, divided by [`ForceLaw::section_m2`].
    #[inline(always)]
    pub fn terms_pa(&self, g: R, g_rate_per_s: R) -> (R, R) {
        if g <= R::ZERO {
            return (R::ZERO, R::ZERO);
        }
        let log2_g = g.log2();
        let three = R::of(3.0);
        let elastic = self.stiffness_pa * (log2_g * (self.n + R::of(2.0))).exp2() * (R::ONE - g / three);
        let shape = (R::of(6.0) - R::of(4.0) * g + g * g) / (three * (R::of(2.0) - g));
        let viscous = self.damping_pa_s * (log2_g * (self.m + R::ONE)).exp2() * g_rate_per_s * shape;
        (elastic, viscous)
    }

    /// True if all numbers are within their limits: [`AB_M2`], [`LENGTH_M`] for C, [`COEFFICIENT`], [`MAX_EXPONENT`].
    pub fn is_valid(&self) -> bool {
        is_within(self.ab_m2.to_f64(), &AB_M2)
            && is_within(self.c_m.to_f64(), &LENGTH_M)
            && [self.stiffness_pa, self.damping_pa_s].iter().all(|v| is_within(v.to_f64(), &COEFFICIENT))
            && [self.n, self.m].iter().all(|&v| v > -R::ONE && v <= R::of(MAX_EXPONENT))
    }
}
