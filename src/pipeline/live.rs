//! The model while walking: causal, one frame after the other, for the screen.
//!
//! Area is the mean of the last three frames, deformation rate the backward difference of Eq. 16. That costs one frame of
//! delay; the step's own numbers come from [`super::step`], which smooths over the whole stance.

use super::model::ForceLaw;
use super::region::RegionFrame;
use crate::num::Real;

/// One region's state between frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct LiveModel<R> {
    previous_area_mm2: [R; 2],
    previous_smoothed_m2: R,
    previous_g: R,
}

/// What the model says of one region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LiveTissue<R> {
    /// Tissue deformation, m.
    pub deformation_m: R,
    /// Model force, N, not negative.
    pub model_n: R,
    /// Contact area exceeded pi A B: deformation and force are lower bounds.
    pub clamped: bool,
}

impl<R: Real> LiveTissue<R> {
    /// Unloaded.
    pub const NONE: Self = Self { deformation_m: R::ZERO, model_n: R::ZERO, clamped: false };
}

impl<R: Real> LiveModel<R> {
    /// Before the first frame.
    pub const NEW: Self = Self { previous_area_mm2: [R::ZERO; 2], previous_smoothed_m2: R::ZERO, previous_g: R::ZERO };

    /// Changes to other parameters, without a jump in the deformation rate.
    pub fn rebase(&mut self, law: &ForceLaw<R>) {
        self.previous_g = law.area_ratio(self.previous_smoothed_m2).normalised_deformation();
    }

    /// Takes this frame's contact area; `per_s` is one over the time since the last frame.
    #[inline(always)]
    pub fn update(&mut self, law: &ForceLaw<R>, area_mm2: R, per_s: R) -> LiveTissue<R> {
        let [before, last] = self.previous_area_mm2;
        self.previous_area_mm2 = [last, area_mm2];
        // A third for the mean and mm2 to m2 in one factor.
        let smoothed_m2 = (before + last + area_mm2) * R::of(1e-6 / 3.0);
        self.previous_smoothed_m2 = smoothed_m2;
        let ratio = law.area_ratio(smoothed_m2);
        let g = ratio.normalised_deformation();
        let g_rate_per_s = (g - self.previous_g) * per_s;
        self.previous_g = g;
        LiveTissue { deformation_m: law.c_m * g, model_n: law.force_n(g, g_rate_per_s), clamped: ratio.clamped }
    }
}

/// One region in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionLoad<R> {
    /// What the cells say.
    pub frame: RegionFrame<R>,
    /// What the model says.
    pub tissue: LiveTissue<R>,
}

impl<R: Real> RegionLoad<R> {
    /// Unloaded.
    pub const NONE: Self = Self { frame: RegionFrame::NONE, tissue: LiveTissue::NONE };
}
