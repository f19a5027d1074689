//! The live model: causal, frame by frame, for display.
//!
//! The area is the mean of the last three frames, which delays the result by one frame. The deformation rate is the backward
//! difference, to the previous frame, because the forward difference of Eq. 16 needs the next frame. Equation numbers are those
//! of the paper that [`super::model`] implements. The values of a step record are computed by [`super::step`] from the whole
//! stance.

use super::model::ForceLaw;
use super::region::RegionFrame;
use crate::num::Real;

/// The state of one region between frames.
///
/// ```
/// use plantar::pipeline::live::LiveModel;
/// use plantar::pipeline::model::ForceLaw;
///
/// let law = ForceLaw { ab_m2: 1e-3, c_m: 0.01, stiffness_pa: 1e5, ..ForceLaw::NONE };
/// let mut live = LiveModel::NEW;
/// // At a contact area of 3/4 pi A B the deformation is C / 2 (Eq. 14), once the area was constant for three frames.
/// let area_mm2 = 0.75 * core::f64::consts::PI * 1e3;
/// let tissue = [0; 3].map(|_| live.update(&law, area_mm2, 100.0))[2];
/// assert!((tissue.deformation_m - 0.005).abs() < 1e-12 && !tissue.clamped);
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct LiveModel<R> {
    /// Areas of the last two frames, the older one first.
    previous_area_mm2: [R; 2],
    /// Mean area of the last three frames.
    previous_smoothed_m2: R,
    /// Normalised deformation in the last frame.
    previous_g: R,
}

/// Tissue deformation and model force of one region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LiveTissue<R> {
    /// Tissue deformation, m, not negative.
    pub deformation_m: R,
    /// Model force, N, not negative.
    pub model_n: R,
    /// The contact area was at least pi A B, so the deformation was limited to C: it is a lower bound, and the model force is
    /// that at this limit.
    pub clamped: bool,
}

impl<R: Real> LiveTissue<R> {
    /// The unloaded region.
    pub const NONE: Self = Self { deformation_m: R::ZERO, model_n: R::ZERO, clamped: false };
}

impl<R: Real> LiveModel<R> {
    /// The state before the first frame.
    pub const NEW: Self = Self { previous_area_mm2: [R::ZERO; 2], previous_smoothed_m2: R::ZERO, previous_g: R::ZERO };

    /// Adapts the state to a new force law, so that the deformation rate has no jump.
    pub fn rebase(&mut self, law: &ForceLaw<R>) {
        self.previous_g = law.area_ratio(self.previous_smoothed_m2).normalised_deformation();
    }

    /// Processes the contact area of a frame, mm2. `per_s` is the reciprocal of the time since the previous frame, 1/s.
    #[inline(always)]
    pub fn update(&mut self, law: &ForceLaw<R>, area_mm2: R, per_s: R) -> LiveTissue<R> {
        let [before, last] = self.previous_area_mm2;
        self.previous_area_mm2 = [last, area_mm2];
        // One factor combines the mean of three with the conversion from mm2 to m2.
        let smoothed_m2 = (before + last + area_mm2) * R::of(1e-6 / 3.0);
        self.previous_smoothed_m2 = smoothed_m2;
        let ratio = law.area_ratio(smoothed_m2);
        let g = ratio.normalised_deformation();
        let g_rate_per_s = (g - self.previous_g) * per_s;
        self.previous_g = g;
        LiveTissue { deformation_m: law.c_m * g, model_n: law.force_n(g, g_rate_per_s), clamped: ratio.clamped }
    }
}

/// Measured and modelled quantities of one region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionLoad<R> {
    /// The measured quantities.
    pub frame: RegionFrame<R>,
    /// The modelled quantities.
    pub tissue: LiveTissue<R>,
}

impl<R: Real> RegionLoad<R> {
    /// The unloaded region.
    pub const NONE: Self = Self { frame: RegionFrame::NONE, tissue: LiveTissue::NONE };
}
