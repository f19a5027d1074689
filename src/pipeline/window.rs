//! The windows of load from which bouts are composed.

use crate::num::Real;
use serde::{Deserialize, Serialize};

/// Smallest range of the total force in a window of shuffling, relative to the usual peak of the wearer's steps
/// ([`super::stance_rule::StanceLimits::usual_peak_n`]): more than the sway of a person who stands, less than the transfer of
/// half of the weight to the other foot.
const MOVING: f64 = 0.25;
/// Smallest mean force of standing, relative to the same peak: each foot of a person who stands carries about half of the weight,
/// and each foot of a person who sits less than a tenth.
pub(super) const STANDING: f64 = 0.15;
/// Smallest mean force of sitting, relative to the same peak; that of a foot in the air is smaller.
pub(super) const LIGHT: f64 = 0.01;

/// The kind of a load bout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BoutKind {
    /// None of the others: the force between the steps of a walk, short contacts, and the force of a foot in the air.
    #[default]
    Unclassified,
    /// The foot carries a nearly constant load.
    Standing,
    /// The load changes as in walking, but the foot does not leave the ground between the steps.
    Shuffling,
    /// The foot carries a small, nearly constant load.
    Sitting,
}

impl BoutKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Unclassified, Self::Standing, Self::Shuffling, Self::Sitting];

    /// Name in files and output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unclassified => "unclassified",
            Self::Standing => "standing",
            Self::Shuffling => "shuffling",
            Self::Sitting => "sitting",
        }
    }
}

/// The load of some frames.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load<R> {
    /// Number of the first frame.
    pub(super) start_seq: u32,
    /// Number of frames outside steps.
    pub(super) frames: u32,
    /// Sum of the forces of each region, N.
    pub(super) force_n: [R; 8],
    /// Sum over the frames of the largest cell pressure of each region, kPa.
    pub(super) pressure_kpa: [R; 8],
    /// Largest pressure of a cell of each region, kPa.
    pub(super) peak_kpa: [R; 8],
}

impl<R: Real> Load<R> {
    pub(super) const NONE: Self =
        Self { start_seq: 0, frames: 0, force_n: [R::ZERO; 8], pressure_kpa: [R::ZERO; 8], peak_kpa: [R::ZERO; 8] };

    /// Adds later frames.
    pub(super) fn append(&mut self, later: &Self) {
        if self.frames == 0 {
            self.start_seq = later.start_seq;
        }
        self.frames += later.frames;
        for region in 0..8 {
            self.force_n[region] += later.force_n[region];
            self.pressure_kpa[region] += later.pressure_kpa[region];
            self.peak_kpa[region] = self.peak_kpa[region].max(later.peak_kpa[region]);
        }
    }

    /// Sum of the total force over the frames, N.
    pub(super) fn total_n(&self) -> R {
        self.force_n.iter().copied().sum()
    }

    /// True if the mean of the total force is at least `share` of `peak_n`, N.
    pub(super) fn has_mean(&self, share: f64, peak_n: R) -> bool {
        self.total_n() >= peak_n * R::of(share) * R::of_u32(self.frames)
    }
}

/// The frames of a window, for which one kind is determined.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window<R> {
    pub(super) load: Load<R>,
    /// Smallest and largest total force, N.
    range_n: (R, R),
    /// The foot is on the ground.
    pub(super) is_on_ground: bool,
    /// The load is that between steps, or of a short contact.
    pub(super) is_between_steps: bool,
}

impl<R: Real> Window<R> {
    pub(super) const NEW: Self =
        Self { load: Load::NONE, range_n: (R::ZERO, R::ZERO), is_on_ground: false, is_between_steps: false };

    /// Adds `frames` equal frames. `region` returns the force, N, and the largest cell pressure, kPa, of a region by its index.
    pub(super) fn add(&mut self, seq: u32, frames: u32, region: impl Fn(usize) -> (R, R)) {
        let mut total_n = R::ZERO;
        let is_first = self.load.frames == 0;
        if is_first {
            self.load.start_seq = seq;
        }
        self.load.frames += frames;
        for i in 0..8 {
            let (force_n, peak_kpa) = region(i);
            total_n += force_n;
            self.load.force_n[i] += force_n * R::of_u32(frames);
            self.load.pressure_kpa[i] += peak_kpa * R::of_u32(frames);
            self.load.peak_kpa[i] = self.load.peak_kpa[i].max(peak_kpa);
        }
        let (least_n, most_n) = self.range_n;
        self.range_n = if is_first { (total_n, total_n) } else { (least_n.min(total_n), most_n.max(total_n)) };
    }

    /// The kind, for a wearer whose steps usually have this peak, N.
    pub(super) fn kind(&self, peak_n: R) -> BoutKind {
        let (least_n, most_n) = self.range_n;
        if self.is_between_steps {
            BoutKind::Unclassified
        } else if most_n - least_n >= peak_n * R::of(MOVING) {
            BoutKind::Shuffling
        } else if self.load.has_mean(STANDING, peak_n) {
            BoutKind::Standing
        } else if self.load.has_mean(LIGHT, peak_n) {
            BoutKind::Sitting
        } else {
            BoutKind::Unclassified
        }
    }
}
