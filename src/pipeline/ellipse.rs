//! The uniform ellipse with a region's area moments.
//!
//! A uniform ellipse has the variance r^2 / 4 along each principal axis, so equal moments give centre, radii and angle in
//! closed form. A cell brings its own extent with it, so even one cell has a finite ellipse.

use super::region::{AreaMoments, SecondMoments};
use crate::num::Real;

/// An ellipse in the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse<R> {
    /// Centre, mm, in the coordinates of the moments it came from.
    pub x_mm: R,
    /// See `x_mm`.
    pub y_mm: R,
    /// Radius along the paper's X (nearer to the medial-lateral axis), mm.
    pub r_a_mm: R,
    /// Radius along the paper's Y (nearer to the heel-toe axis), mm.
    pub r_b_mm: R,
    /// cos and sin of twice the angle from the x axis to the first radius; (1, 0) for a circle.
    double_angle: (R, R),
}

impl<R: Real> Ellipse<R> {
    /// From area moments; `None` where nothing is in contact.
    pub fn from_moments(moments: &AreaMoments) -> Option<Self> {
        let SecondMoments { x_mm, y_mm, variance_x_mm2, variance_y_mm2, covariance_mm2 } =
            moments.second_moments::<R>()?;
        // Eigenvalues of the covariance: mean plus and minus spread.
        let half = R::of(0.5);
        let (mean, half_difference) =
            ((variance_x_mm2 + variance_y_mm2) * half, (variance_x_mm2 - variance_y_mm2) * half);
        let spread = (half_difference * half_difference + covariance_mm2 * covariance_mm2).sqrt();
        let long = R::of(2.0) * (mean + spread).sqrt();
        // det / (mean + spread): the difference of near equals would lose half of the digits for a slim ellipse.
        let determinant = (variance_x_mm2 * variance_y_mm2 - covariance_mm2 * covariance_mm2).max(R::ZERO);
        let short = R::of(2.0) * (determinant / (mean + spread)).sqrt();
        // r_a belongs to the axis within 45 degrees of x. Cells on a grid often give exactly 45, or a circle: rounding must not
        // decide there.
        let (r_a_mm, r_b_mm, sign) =
            if half_difference >= -R::of(1e-4) * mean { (long, short, R::ONE) } else { (short, long, -R::ONE) };
        let double_angle = if spread > R::of(1e-4) * mean {
            ((sign * half_difference).max(R::ZERO) / spread, sign * covariance_mm2 / spread)
        } else {
            (R::ONE, R::ZERO)
        };
        Some(Self { x_mm, y_mm, r_a_mm, r_b_mm, double_angle })
    }

    /// The same ellipse with its centre moved, mm.
    pub fn moved(self, dx_mm: R, dy_mm: R) -> Self {
        Self { x_mm: self.x_mm + dx_mm, y_mm: self.y_mm + dy_mm, ..self }
    }

    /// Angle from the x axis to the first radius, -45 to 45 degrees, counter-clockwise seen from above with x to the right
    /// and y forwards.
    ///
    /// `micromath`'s arc tangent: its error of 0.0028 rad is 0.08 degrees here, below what cells of some millimetres resolve,
    /// and nothing is computed from the angle.
    pub fn angle_deg(&self) -> f32 {
        let (cos, sin) = self.double_angle;
        micromath::F32(sin.to_f32()).atan2(micromath::F32(cos.to_f32())).0.to_degrees() * 0.5
    }

    /// Area, mm2.
    pub fn area_mm2(&self) -> R {
        R::of(core::f64::consts::PI) * self.r_a_mm * self.r_b_mm
    }
}
