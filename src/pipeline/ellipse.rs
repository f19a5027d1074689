//! The contact ellipse: the uniform ellipse with the area moments of a region.
//!
//! A uniform ellipse has the variance r^2 / 4 along each principal axis, so centre, radii and angle follow from the moments in
//! closed form. The moments include the extent of each cell, so that even a single cell has an ellipse with positive radii.

use super::region::{AreaMoments, SecondMoments};
use crate::num::Real;

/// An ellipse in the ground plane.
///
/// ```
/// use plantar::Region;
/// use plantar::pipeline::contact::WHOLE;
/// use plantar::pipeline::ellipse::Ellipse;
/// use plantar::pipeline::region::{AreaMoments, Cell, RegionCell};
///
/// // Cells of 1 mm2 in an ellipse with radii of 10 and 20 mm and its centre at (3, 5) mm.
/// let mut moments = AreaMoments::NONE;
/// for (x, y) in (-20..20).flat_map(|x| (-20..20).map(move |y| (x as f32 + 0.5, y as f32 + 0.5))) {
///     if (x / 10.0).powi(2) + (y / 20.0).powi(2) <= 1.0 {
///         let cell = Cell { region: Region::Heel, x_mm: x + 3.0, y_mm: y + 5.0, area_mm2: 1.0 };
///         moments.add(&RegionCell::<f64>::new(&cell, 1.0, 0.0, 0.0), WHOLE);
///     }
/// }
/// let ellipse: Ellipse<f64> = Ellipse::from_moments(&moments).unwrap();
/// assert_eq!((ellipse.x_mm, ellipse.y_mm, ellipse.angle_deg()), (3.0, 5.0, 0.0));
/// assert!((ellipse.r_a_mm - 10.0).abs() < 0.1 && (ellipse.r_b_mm - 20.0).abs() < 0.1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse<R> {
    /// x of the centre, mm. [`Ellipse::from_moments`] returns it relative to the reference point of the region.
    pub x_mm: R,
    /// y of the centre, mm, likewise.
    pub y_mm: R,
    /// Radius along the principal axis that is nearer to the medial-lateral axis (X of the paper, [`super::model`]), mm.
    pub r_a_mm: R,
    /// Radius along the principal axis that is nearer to the heel-toe axis (Y of the paper), mm.
    pub r_b_mm: R,
    /// Cosine and sine of twice the angle from the x axis to the axis of `r_a_mm`; (1, 0) for a circle.
    double_angle: (R, R),
}

impl<R: Real> Ellipse<R> {
    /// The ellipse with these moments; `None` without contact.
    // Not inlined, which saves flash.
    #[inline(never)]
    pub fn from_moments(moments: &AreaMoments) -> Option<Self> {
        let SecondMoments { x_mm, y_mm, variance_x_mm2, variance_y_mm2, covariance_mm2 } =
            moments.second_moments::<R>()?;
        // The eigenvalues of the covariance matrix are mean +- deviation.
        let half = R::of(0.5);
        let (mean, half_difference) =
            ((variance_x_mm2 + variance_y_mm2) * half, (variance_x_mm2 - variance_y_mm2) * half);
        let deviation = (half_difference * half_difference + covariance_mm2 * covariance_mm2).sqrt();
        let long_mm = R::of(2.0) * (mean + deviation).sqrt();
        // The smaller eigenvalue is computed as the determinant divided by the larger eigenvalue: for a slim ellipse, mean -
        // deviation would lose half of the digits.
        let determinant = (variance_x_mm2 * variance_y_mm2 - covariance_mm2 * covariance_mm2).max(R::ZERO);
        let short_mm = R::of(2.0) * (determinant / (mean + deviation)).sqrt();
        // `r_a_mm` belongs to the axis within 45 degrees of x. On a grid of cells, exactly 45 degrees and circles are frequent;
        // the tolerance makes them independent of rounding.
        let (r_a_mm, r_b_mm, sign) = if half_difference >= -R::of(1e-4) * mean {
            (long_mm, short_mm, R::ONE)
        } else {
            (short_mm, long_mm, -R::ONE)
        };
        let double_angle = if deviation > R::of(1e-4) * mean {
            ((sign * half_difference).max(R::ZERO) / deviation, sign * covariance_mm2 / deviation)
        } else {
            (R::ONE, R::ZERO)
        };
        Some(Self { x_mm, y_mm, r_a_mm, r_b_mm, double_angle })
    }

    /// The same ellipse with its centre moved by `dx_mm` and `dy_mm`.
    pub fn moved(self, dx_mm: R, dy_mm: R) -> Self {
        Self { x_mm: self.x_mm + dx_mm, y_mm: self.y_mm + dy_mm, ..self }
    }

    /// Angle from the x axis to the axis of `r_a_mm`, -45 to 45 degrees, positive from the x axis to the y axis.
    ///
    /// The arc tangent is computed by `micromath`. Its error of 0.0028 rad is 0.08 degrees here, below the resolution of cells of
    /// a few millimetres, and no other quantity depends on the angle.
    pub fn angle_deg(&self) -> f32 {
        let (cos, sin) = self.double_angle;
        micromath::F32(sin.to_f32()).atan2(micromath::F32(cos.to_f32())).0.to_degrees() * 0.5
    }

    /// Area, mm2.
    pub fn area_mm2(&self) -> R {
        R::of(core::f64::consts::PI) * self.r_a_mm * self.r_b_mm
    }
}
