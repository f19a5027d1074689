//! Tracking: follows changes of the wearer's tissue and shoes since the identification, from step to step.
//!
//! The force law (Eq. 13, [`ForceLaw`]) is linear in the stiffness K and the damping G. After each step, both are the
//! least-squares solution over the recent steps, in which a step counts less the longer ago it was: recursive least squares with
//! exponential forgetting, in the form that stores the sums of the normal equations of the two unknowns. A B, n and m remain
//! those of the identification. Unlike in the identification, the forces of a step are not divided by its peak force: in a step
//! that hardly loads the region, as on stairs or in a turn, the law can be wrong by a factor, and such a step must not count as
//! much as the others.

use super::model::ForceLaw;
use super::step::{RegionStep, StepSums};
use crate::num::Real;

/// Factor by which the weight of a step decreases with each further step: the sums represent about 30 steps.
const FORGETTING: f64 = 1.0 - 1.0 / 30.0;
/// Number of steps of a region from which on its force law is adapted. With fewer steps, the law would follow the variation of
/// single steps.
const FIRST_STEPS: u8 = 10;
/// Range of the tracked K, relative to the identified K.
const STIFFNESS_RANGE: [f64; 2] = [0.5, 2.0];
/// Range of the tracked G, relative to the identified G. It is wider than that of K, because the identified G is less certain.
const DAMPING_RANGE: [f64; 2] = [0.25, 4.0];
/// Elastic and viscous force are distinguished only if the determinant of their normal equations exceeds this fraction of the
/// product of their sums of squares. Otherwise G remains as identified.
const INDEPENDENT: f64 = 0.01;

impl<R: Real> StepSums<R> {
    /// The older sums times [`FORGETTING`], plus those of a new step. The forces of the new step were computed with the
    /// identified K and G times `scale`.
    fn with(self, new: &Self, scale: [R; 2]) -> Self {
        let forgetting = R::of(FORGETTING);
        // The factors of the elastic and the viscous force of the new step.
        let [e, v] = scale.map(|scale| R::ONE / scale);
        Self {
            ee: self.ee * forgetting + new.ee * e * e,
            ev: self.ev * forgetting + new.ev * e * v,
            vv: self.vv * forgetting + new.vv * v * v,
            ef: self.ef * forgetting + new.ef * e,
            vf: self.vf * forgetting + new.vf * v,
        }
    }

    /// The factors of the identified K and G that fit best, each limited to its range. The factor of K is the best one for the
    /// limited factor of G.
    fn solve(&self) -> [R; 2] {
        let clamp = |value: R, [least, most]: [f64; 2]| value.max(R::of(least)).min(R::of(most));
        // The best factor of K for a factor of G.
        let stiffness = |damping: R| clamp((self.ef - damping * self.ev) / self.ee, STIFFNESS_RANGE);
        let determinant = self.ee * self.vv - self.ev * self.ev;
        if determinant <= R::of(INDEPENDENT) * self.ee * self.vv {
            return [stiffness(R::ONE), R::ONE];
        }
        let damping = clamp((self.vf * self.ee - self.ef * self.ev) / determinant, DAMPING_RANGE);
        [stiffness(damping), damping]
    }
}

/// The tracking of one region.
#[derive(Clone, Copy, Debug)]
struct Tracked<R> {
    /// K (Pa) and G (Pa s) of the identification; 0 if the region is not tracked.
    identified: [R; 2],
    sums: StepSums<R>,
    /// Number of steps in `sums`, up to [`FIRST_STEPS`].
    steps: u8,
}

/// The tracking of all regions.
#[derive(Clone, Debug)]
pub struct Tracker<R> {
    regions: [Tracked<R>; 8],
}

impl<R: Real> Tracker<R> {
    /// Off.
    pub const OFF: Self = Self { regions: [Tracked { identified: [R::ZERO; 2], sums: StepSums::NONE, steps: 0 }; 8] };

    /// Starts the tracking of the regions with a bit in `regions` from their identified force laws.
    pub fn start(&mut self, laws: &[ForceLaw<R>; 8], regions: u8) {
        *self = Self::OFF;
        for (i, (region, law)) in self.regions.iter_mut().zip(laws).enumerate() {
            if regions & 1 << i != 0 {
                region.identified = [law.stiffness_pa, law.damping_pa_s];
            }
        }
    }

    /// Ends the tracking.
    pub fn stop(&mut self) {
        *self = Self::OFF;
    }

    /// Adapts `law`, the present force law of a region, to a step that was evaluated with it. A step with `is_reliable` false is
    /// not used: with masked or saturated cells, or areas beyond the ellipsoid's largest section, its forces are not those of
    /// the tissue.
    ///
    /// Returns the relative change of K since the identification, 0 in a region that is not tracked.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn adapt(&mut self, region: usize, law: &mut ForceLaw<R>, step: &RegionStep<R>, is_reliable: bool) -> R {
        let sums = &step.sums;
        let tracked = &mut self.regions[region];
        let [stiffness_pa, damping_pa_s] = tracked.identified;
        if stiffness_pa <= R::ZERO {
            return R::ZERO;
        }
        if is_reliable && sums.ee > R::ZERO {
            // Without damping, the viscous force is 0 with any factor.
            let damping = if damping_pa_s > R::ZERO { law.damping_pa_s / damping_pa_s } else { R::ONE };
            tracked.sums = tracked.sums.with(sums, [law.stiffness_pa / stiffness_pa, damping]);
            tracked.steps = tracked.steps.saturating_add(1).min(FIRST_STEPS);
            if tracked.steps == FIRST_STEPS {
                let [stiffness, damping] = tracked.sums.solve();
                law.stiffness_pa = stiffness * stiffness_pa;
                law.damping_pa_s = damping * damping_pa_s;
            }
        }
        law.stiffness_pa / stiffness_pa - R::ONE
    }
}
