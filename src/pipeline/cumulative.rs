//! Cumulative load of each region: what a day of steps, standing and sitting adds up to.
//!
//! All quantities are integrals of the largest cell pressure of a region:
//!
//! - the *dose*: the pressure above [`LoadLimits::dose_kpa`], integrated over time;
//! - the cumulative squared pressure, to which the heat of a load cycle in a linear viscoelastic material is proportional;
//! - the *sustained load*: a region comes under sustained load when its pressure was at or above [`LoadLimits::sustained_kpa`]
//!   for [`LoadLimits::sustained_percent`] of the last [`LoadLimits::window_s`], and remains under it until this share falls
//!   below [`LoadLimits::relieved_percent`]. The time before the first frame counts as unloaded.
//!
//! Frames are collected for a second, so that the totals are integers without accumulated rounding errors. `docs/alerts.md` has
//! the sources of the limits.

use super::region::RegionFrame;
use crate::num::Real;
use serde::{Deserialize, Serialize};

/// Number of parts of the window of sustained load. The oldest part counts in proportion to the share of it that is within the
/// window, so the share is exact for a load that was constant during that part.
pub const WINDOW_PARTS: u16 = 15;

/// The limits of pressure, and the rule of sustained load.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadLimits {
    /// Pressure above which the dose counts, kPa, 1 to 2000.
    pub dose_kpa: f32,
    /// Time with at least this pressure counts towards sustained load, kPa, 1 to 2000.
    pub sustained_kpa: f32,
    /// Length of the window, s, 60 to 3600, a multiple of [`WINDOW_PARTS`].
    pub window_s: u16,
    /// Sustained load begins at this share of the window, percent, at most 100.
    pub sustained_percent: u8,
    /// Sustained load ends below this share of the window, percent, less than `sustained_percent`, more than 0.
    pub relieved_percent: u8,
}

impl LoadLimits {
    /// The dose counts above 200 kPa. Sustained load begins when the pressure was at least 35 mmHg for 95 % of a quarter of an
    /// hour, and ends when it was lower for more than three minutes of the last quarter of an hour. docs/alerts.md has the
    /// sources.
    pub const DEFAULT: Self =
        Self { dose_kpa: 200.0, sustained_kpa: 4.7, window_s: 900, sustained_percent: 95, relieved_percent: 80 };

    /// True if all limits are in range and in order.
    pub fn is_valid(&self) -> bool {
        let is_pressure = |kpa: f32| (1.0..=2000.0).contains(&kpa);
        is_pressure(self.dose_kpa)
            && is_pressure(self.sustained_kpa)
            && (60..=3600).contains(&self.window_s)
            && self.window_s.is_multiple_of(WINDOW_PARTS)
            && self.sustained_percent <= 100
            && self.relieved_percent < self.sustained_percent
            && self.relieved_percent > 0
    }
}

/// The load of one region in a day.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegionTotal {
    /// Dose, 0.1 kPa s.
    pub dose_dkpa_s: u32,
    /// Time integral of the squared pressure, kPa2 s.
    pub squared_kpa2_s: u32,
    /// Time under sustained load, s.
    pub sustained_s: u32,
}

/// The load of all regions in a day.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Number of seconds in which a cell had at least [`LOADED_KPA`].
    pub loaded_s: u32,
    /// Number of steps.
    pub steps: u32,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [RegionTotal; 8],
}

impl Totals {
    /// No load.
    pub const NONE: Self =
        Self { loaded_s: 0, steps: 0, regions: [RegionTotal { dose_dkpa_s: 0, squared_kpa2_s: 0, sustained_s: 0 }; 8] };

    /// Adds the load of another part of the same day. Totals at the end of their range remain there.
    pub fn add(&mut self, other: &Self) {
        self.loaded_s = self.loaded_s.saturating_add(other.loaded_s);
        self.steps = self.steps.saturating_add(other.steps);
        for (region, other) in self.regions.iter_mut().zip(&other.regions) {
            region.dose_dkpa_s = region.dose_dkpa_s.saturating_add(other.dose_dkpa_s);
            region.squared_kpa2_s = region.squared_kpa2_s.saturating_add(other.squared_kpa2_s);
            region.sustained_s = region.sustained_s.saturating_add(other.sustained_s);
        }
    }
}

/// The sums of one region over the frames of the present second.
#[derive(Clone, Copy, Debug)]
struct Sums<R> {
    /// Excess of the pressure over the limit of the dose, kPa.
    dose_kpa: R,
    /// Squared pressures, kPa2.
    squared_kpa2: R,
    /// Number of frames with at least the pressure of sustained load.
    sustained: u32,
}

impl<R: Real> Sums<R> {
    const NONE: Self = Self { dose_kpa: R::ZERO, squared_kpa2: R::ZERO, sustained: 0 };
}

/// An insole counts as loaded if a cell has at least this pressure, kPa. It is above noise and uncalibrated offsets of cells,
/// and below the pressure of a resting foot.
pub const LOADED_KPA: f32 = 1.0;

/// Time above the limit in each part of the window, 0.01 s. [`CumulativeLoad::part`] is the index of the part in progress.
type Window = [u16; WINDOW_PARTS as usize + 1];

/// The cumulative load of an insole.
#[derive(Debug)]
pub(crate) struct CumulativeLoad<R> {
    /// Number of frames in a second, rounded.
    second_frames: u32,
    /// Time between frames, s.
    frame_s: R,
    /// Number of frames in the present second.
    frames: u32,
    sums: [Sums<R>; 8],
    windows: [Window; 8],
    /// Index of the part in progress, in each of `windows`.
    part: u8,
    /// Number of complete seconds in the part in progress.
    part_s: u16,
    /// Bit i: region i is under sustained load.
    sustained: u8,
    /// The insole was loaded in a frame of the present second.
    is_loaded: bool,
    /// Number of complete seconds since the last load.
    unloaded_s: u32,
    pub(crate) totals: Totals,
}

impl<R: Real> CumulativeLoad<R> {
    pub(crate) const fn new() -> Self {
        Self {
            second_frames: 0,
            frame_s: R::ZERO,
            frames: 0,
            sums: [Sums::NONE; 8],
            windows: [[0; WINDOW_PARTS as usize + 1]; 8],
            part: 0,
            part_s: 0,
            sustained: 0,
            is_loaded: false,
            unloaded_s: 0,
            totals: Totals::NONE,
        }
    }

    /// Discards all load. `period_us` is the time between two frames, us.
    pub(crate) fn set_up(&mut self, period_us: u32) {
        let second_frames = (1_000_000 + period_us / 2) / period_us.max(1);
        *self = Self { second_frames, frame_s: R::of_u32(period_us) * R::of(1e-6), ..Self::new() };
    }

    /// Begins a window without load, because the limits have changed.
    pub(crate) fn clear_window(&mut self) {
        self.windows = Self::new().windows;
        (self.part, self.part_s, self.sustained) = (0, 0, 0);
    }

    /// Adds a frame; `frames` is the number of frames that it stands for, more than 1 after missing ones. True if it completes a
    /// second.
    #[inline(never)]
    pub(crate) fn frame<'f>(
        &mut self,
        limits: &LoadLimits,
        frames: u32,
        regions: impl Iterator<Item = &'f RegionFrame<R>>,
    ) -> bool {
        let (dose_kpa, sustained_kpa) = (R::of_f32(limits.dose_kpa), R::of_f32(limits.sustained_kpa));
        let loaded_kpa = R::of_f32(LOADED_KPA);
        let mut is_loaded = self.is_loaded;
        for (sums, region) in self.sums.iter_mut().zip(regions) {
            let kpa = region.peak_kpa;
            is_loaded |= kpa >= loaded_kpa;
            // Few frames stand for others, so repetition costs less than a product in every frame.
            for _ in 0..frames {
                sums.squared_kpa2 += kpa * kpa;
                sums.sustained += u32::from(kpa >= sustained_kpa);
                sums.dose_kpa += (kpa - dose_kpa).max(R::ZERO);
            }
        }
        self.is_loaded = is_loaded;
        self.frames += frames;
        let is_second = self.frames >= self.second_frames;
        if is_second {
            self.end_second(limits);
        }
        is_second
    }

    /// Ends the present second now, if it has begun: no further frames follow. True if it had begun.
    pub(crate) fn finish(&mut self, limits: &LoadLimits) -> bool {
        let has_begun = self.frames > 0;
        if has_begun {
            // The second counts as complete.
            self.frames = self.second_frames;
            self.end_second(limits);
        }
        has_begun
    }

    /// Adds the present second to the totals and the windows.
    #[cold]
    fn end_second(&mut self, limits: &LoadLimits) {
        // At a rate that is no integer, the frames of a second last up to 2.5 % longer or shorter than a second (at 20.5 Hz; at
        // the rates of devices, from 50 Hz on, up to 1 %).
        let frame_s = self.frame_s;
        let part_length_s = limits.window_s / WINDOW_PARTS;
        self.part_s += 1;
        let oldest = (usize::from(self.part) + 1) % (WINDOW_PARTS as usize + 1);
        let sums = core::mem::replace(&mut self.sums, [Sums::NONE; 8]);
        for (i, (sums, window)) in sums.iter().zip(&mut self.windows).enumerate() {
            let total = &mut self.totals.regions[i];
            let rounded = |sum: R| (sum * frame_s + R::of(0.5)).to_u32();
            total.dose_dkpa_s = total.dose_dkpa_s.saturating_add(rounded(sums.dose_kpa * R::of(10.0)));
            total.squared_kpa2_s = total.squared_kpa2_s.saturating_add(rounded(sums.squared_kpa2));
            // The sum fits 16 bits: a part has at most 240 s. A frame that stands for missing ones can exceed the last second, at
            // 20 Hz by up to 0.25 s.
            window[usize::from(self.part)] += (sums.sustained * 100 / self.second_frames) as u16;
            let loaded_cs = time_above_limit_cs(window, oldest, self.part_s, part_length_s);
            // One percent of a second is 0.01 s.
            let share_cs = |percent: u8| u32::from(percent) * u32::from(limits.window_s);
            let bit = 1 << i;
            if loaded_cs >= share_cs(limits.sustained_percent) {
                self.sustained |= bit;
            } else if loaded_cs < share_cs(limits.relieved_percent) {
                self.sustained &= !bit;
            }
            total.sustained_s += u32::from(self.sustained & bit != 0);
        }
        let is_loaded = core::mem::take(&mut self.is_loaded);
        self.totals.loaded_s += u32::from(is_loaded);
        self.unloaded_s = if is_loaded { 0 } else { self.unloaded_s.saturating_add(1) };
        self.frames -= self.second_frames;
        if self.part_s >= part_length_s {
            self.part = oldest as u8;
            self.part_s = 0;
            self.windows.iter_mut().for_each(|window| window[oldest] = 0);
        }
    }

    /// Number of frames in a second.
    pub(crate) fn second_frames(&self) -> u32 {
        self.second_frames
    }

    /// Number of complete seconds since the last load.
    pub(crate) fn unloaded_s(&self) -> u32 {
        self.unloaded_s
    }

    /// Bit i: region i is under sustained load.
    pub(crate) fn sustained(&self) -> u8 {
        self.sustained
    }
}

/// Time above the limit within the window, 0.01 s. `oldest` is the index of the oldest part, `part_length_s` the duration of a
/// part, and `elapsed_s` the number of seconds that have elapsed of the part in progress.
fn time_above_limit_cs(window: &Window, oldest: usize, elapsed_s: u16, part_length_s: u16) -> u32 {
    let sum: u32 = window.iter().map(|part| u32::from(*part)).sum();
    sum - u32::from(window[oldest]) * u32::from(elapsed_s) / u32::from(part_length_s.max(1))
}
