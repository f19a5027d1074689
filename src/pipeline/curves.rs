//! The curves of a stance: the quantities of each region, and the centre of pressure of the foot, from heel strike on.

use super::region::{PER_MM, RegionFrame};
use crate::num::Real;

/// Largest number of samples of a curve. In a longer stance only every second frame is stored, then every fourth, and so on.
pub const STANCE_SAMPLES: usize = 256;

/// One region in one frame: area (mm2), force (N) and largest cell pressure (kPa).
#[derive(Clone, Copy, Debug)]
struct Sample<R>(R, R, R);

impl<R: Real> Sample<R> {
    const NONE: Self = Self(R::ZERO, R::ZERO, R::ZERO);

    fn of(frame: &RegionFrame<R>) -> Self {
        Self(frame.area.area_mm2(), frame.force.force_n, frame.peak_kpa)
    }

    /// The value at `part` of the way to `other`, 0 to 1.
    fn towards(&self, other: &Self, part: R) -> Self {
        let between = |from: R, to: R| from + (to - from) * part;
        Self(between(self.0, other.0), between(self.1, other.1), between(self.2, other.2))
    }
}

/// The curves of one stance.
#[derive(Debug)]
pub struct Curves<R> {
    /// Number of frames since heel strike, including bridged frames.
    frames: u32,
    /// Number of frames from one sample to the next one, a power of 2.
    stride: u32,
    /// Number of samples.
    len: usize,
    area_mm2: [[R; STANCE_SAMPLES]; 8],
    force_n: [[R; STANCE_SAMPLES]; 8],
    /// Largest cell pressure of each region, in 0.1 kPa.
    pressure_dkpa: [[u16; STANCE_SAMPLES]; 8],
    /// Centre of pressure of the foot, foot coordinates, in units of 1/[`PER_MM`] mm, limited to 512 mm along each axis.
    centre: [(i16, i16); STANCE_SAMPLES],
    /// The last frame.
    last: [Sample<R>; 8],
    last_centre_mm: (R, R),
}

impl<R: Real> Curves<R> {
    /// Curves without samples.
    pub(super) const EMPTY: Self = Self {
        frames: 0,
        stride: 0,
        len: 0,
        area_mm2: [[R::ZERO; STANCE_SAMPLES]; 8],
        force_n: [[R::ZERO; STANCE_SAMPLES]; 8],
        pressure_dkpa: [[0; STANCE_SAMPLES]; 8],
        centre: [(0, 0); STANCE_SAMPLES],
        last: [Sample::NONE; 8],
        last_centre_mm: (R::ZERO, R::ZERO),
    };

    /// Removes all samples. Their arrays are large, and are not overwritten.
    pub(super) fn clear(&mut self) {
        (self.frames, self.stride, self.len) = (0, 1, 0);
    }

    /// Adds linearly interpolated frames for the `missing` frames between the last one and this one.
    #[cold]
    #[inline(never)]
    pub(super) fn bridge(&mut self, missing: u32, regions: &[&RegionFrame<R>; 8], centre_mm: (R, R)) {
        let (from, from_mm) = (self.last, self.last_centre_mm);
        for i in 1..=missing {
            let part = R::of_u32(i) / R::of_u32(missing + 1);
            let between = |from: R, to: R| from + (to - from) * part;
            self.store(
                |region| from[region].towards(&Sample::of(regions[region]), part),
                (between(from_mm.0, centre_mm.0), between(from_mm.1, centre_mm.1)),
            );
        }
    }

    /// Adds a measured frame. True if it is stored as a sample.
    pub(super) fn push(&mut self, regions: &[&RegionFrame<R>; 8], centre_mm: (R, R)) -> bool {
        self.store(|region| Sample::of(regions[region]), centre_mm)
    }

    /// Stores a frame, unless the stride skips it. True if it is stored.
    fn store(&mut self, sample: impl Fn(usize) -> Sample<R>, centre_mm: (R, R)) -> bool {
        if self.len == STANCE_SAMPLES {
            for i in 0..STANCE_SAMPLES / 2 {
                for region in 0..8 {
                    self.area_mm2[region][i] = self.area_mm2[region][2 * i];
                    self.force_n[region][i] = self.force_n[region][2 * i];
                    self.pressure_dkpa[region][i] = self.pressure_dkpa[region][2 * i];
                }
                self.centre[i] = self.centre[2 * i];
            }
            self.len = STANCE_SAMPLES / 2;
            self.stride *= 2;
        }
        // The comparison with the length is always true. It is made here once, so that the accesses below need no bounds
        // checks.
        let place = self.len;
        let is_stored = self.frames.is_multiple_of(self.stride) && place < STANCE_SAMPLES;
        for region in 0..8 {
            let sample = sample(region);
            self.last[region] = sample;
            if is_stored {
                self.area_mm2[region][place] = sample.0;
                self.force_n[region][place] = sample.1;
                self.pressure_dkpa[region][place] = (sample.2 * R::of(10.0)).round_u16();
            }
        }
        self.last_centre_mm = centre_mm;
        if is_stored {
            let units = |mm: R| (mm * R::of_f32(PER_MM)).round_i16();
            self.centre[place] = (units(centre_mm.0), units(centre_mm.1));
            self.len = place + 1;
        }
        self.frames += 1;
        is_stored
    }

    /// Number of samples in the first `frames` frames.
    pub(super) fn samples_in(&self, frames: u32) -> usize {
        frames.div_ceil(self.stride) as usize
    }

    /// Removes all samples after the first `samples` samples.
    pub(super) fn end_after(&mut self, samples: usize) {
        self.len = samples;
    }

    /// Number of frames since heel strike, including bridged frames.
    pub(super) fn frames(&self) -> u32 {
        self.frames
    }

    /// Number of frames before the sample that follows the last one with at least this total force, N; 0 without such a sample.
    pub(super) fn frames_above(&self, least_n: R) -> u32 {
        let last = (0..self.len).rev().find(|&sample| self.total_n(sample) >= least_n);
        last.map_or(0, |last| (last as u32 + 1) * self.stride).min(self.frames)
    }

    /// Number of frames from one sample to the next one, a power of 2.
    pub fn stride(&self) -> u32 {
        self.stride
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.len
    }

    /// Contact area of a region, mm2.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn area_mm2(&self, region: usize) -> &[R] {
        &self.area_mm2[region][..self.len]
    }

    /// Measured force of a region, N.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn force_n(&self, region: usize) -> &[R] {
        &self.force_n[region][..self.len]
    }

    /// Largest cell pressure of a region, in 0.1 kPa.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn pressure_dkpa(&self, region: usize) -> &[u16] {
        &self.pressure_dkpa[region][..self.len]
    }

    /// Centre of pressure of the foot in a sample, foot coordinates, mm, limited to 512 mm along each axis: no foot is longer.
    ///
    /// # Panics
    /// If there is no such sample.
    pub fn centre_mm(&self, sample: usize) -> (R, R) {
        let (x, y) = self.centre[sample];
        let mm = |units: i16| R::of_i32(units.into()) * R::of_f32(1.0 / PER_MM);
        (mm(x), mm(y))
    }

    /// Total force in a sample, N.
    ///
    /// # Panics
    /// If there is no such sample.
    pub fn total_n(&self, sample: usize) -> R {
        self.force_n.iter().map(|force_n| force_n[sample]).sum()
    }
}

/// Number of samples that is nearest to the time `us`, if `sample_s` is the time between samples, s.
pub(super) fn whole_samples<R: Real>(us: u32, sample_s: R) -> usize {
    let sample_us = whole_us(sample_s);
    ((us + sample_us / 2) / sample_us) as usize
}

/// Number of samples within the time `us` after a sample, if `sample_s` is the time between samples, s.
pub(super) fn samples_within<R: Real>(us: u32, sample_s: R) -> usize {
    (us / whole_us(sample_s)) as usize
}

/// The time between samples in whole microseconds, so that single and double precision have the same number. It is positive.
fn whole_us<R: Real>(sample_s: R) -> u32 {
    (sample_s * R::of(1e6) + R::of(0.5)).to_u32().max(1)
}
