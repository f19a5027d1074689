//! The settings of an insole that a host can change: they replace parts of the board's configuration.

use crate::checksum::crc32;
use crate::pipeline::contact::ContactRule;
use crate::pipeline::setup::{Setup, SetupCell};
use crate::pipeline::stance_rule::StanceRule;
use core::ops::RangeInclusive;
use serde::{Deserialize, Serialize};

/// Range of the time between frames that a host can set, us: 400 Hz to 50 Hz.
pub const SETTABLE_PERIOD_US: RangeInclusive<u32> = 2_500..=20_000;
/// Range of [`Settings::scale`]. If the board's layout is that of EU size 42, this range covers the sizes 32 to 52.
pub const SCALE: RangeInclusive<f32> = 0.75..=1.25;

/// Settings of an insole. They are in force from its next start on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The contact rule.
    pub contact: ContactRule,
    /// The stance rule.
    pub stance: StanceRule,
    /// Time between frames, us, within [`SETTABLE_PERIOD_US`].
    pub period_us: u32,
    /// Length of the insole divided by the length of the board's layout, within [`SCALE`]: coordinates of cells are multiplied by
    /// this scale, and their areas by its square.
    pub scale: f32,
}

impl Settings {
    /// The settings in `setup`, with a layout that is not scaled.
    pub fn of(setup: &Setup) -> Self {
        Self { contact: setup.contact, stance: setup.stance, period_us: setup.period_us, scale: 1.0 }
    }

    /// True if all values are in range.
    pub fn is_valid(&self) -> bool {
        self.contact.is_valid()
            && self.stance.is_valid()
            && SETTABLE_PERIOD_US.contains(&self.period_us)
            && SCALE.contains(&self.scale)
    }

    /// The board's configuration `setup` with these settings in force. The scale is not part of it: [`Settings::scaled`] applies
    /// it to each cell.
    pub fn apply_to(&self, setup: Setup) -> Setup {
        Setup { contact: self.contact, stance: self.stance, period_us: self.period_us, ..setup }
    }

    /// A cell of the board's layout, scaled by [`Settings::scale`].
    pub fn scaled(&self, mut cell: SetupCell) -> SetupCell {
        cell.x_mm *= self.scale;
        cell.y_mm *= self.scale;
        cell.area_mm2 *= self.scale * self.scale;
        cell
    }

    /// An identifier of the layout `layout_id` with these settings, for [`super::Hello::layout_id`].
    pub fn id(&self, layout_id: u32) -> u32 {
        let Self { contact, stance, period_us, scale } = *self;
        let rules = [contact.on_kpa, contact.off_kpa, contact.full_kpa, stance.strike_n, stance.release_n, scale];
        let times = [stance.min_stance_ms, stance.min_swing_ms, stance.max_stance_ms].map(u32::from);
        let mut bytes = [0; 4 * 12];
        let others = [stance.is_adaptive.into(), period_us, layout_id];
        let words = rules.map(f32::to_bits).into_iter().chain(times).chain(others);
        for (place, word) in bytes.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        crc32(&bytes)
    }
}
