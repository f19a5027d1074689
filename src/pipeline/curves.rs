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

/// The largest values of one region in the frames of a long stance that are not samples, each with the number of its frame since
/// heel strike, at most 65,535. So a short peak between two samples, such as that of a barefoot heel strike at 400 Hz, is not
/// missed. A frame counts if the foot is on the ground in this frame, or in a later one that arrives before this frame is removed
/// from the samples.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Between<R> {
    /// Largest measured force, N.
    pub force_n: R,
    pub force_frame: u16,
    /// Largest cell pressure, in 0.1 kPa.
    pub pressure_dkpa: u16,
    pub pressure_frame: u16,
}

impl<R: Real> Between<R> {
    const NONE: Self = Self { force_n: R::ZERO, force_frame: 0, pressure_dkpa: 0, pressure_frame: 0 };

    fn include(&mut self, frame: u32, force_n: R, pressure_dkpa: u16) {
        let frame = frame.min(u16::MAX.into()) as u16;
        if force_n > self.force_n {
            (self.force_n, self.force_frame) = (force_n, frame);
        }
        if pressure_dkpa > self.pressure_dkpa {
            (self.pressure_dkpa, self.pressure_frame) = (pressure_dkpa, frame);
        }
    }
}

/// The curves of one stance.
#[derive(Debug)]
pub struct Curves<R> {
    /// Number of frames since heel strike, including bridged frames.
    frames: u32,
    /// Number of frames from one sample to the next one, a power of 2; 0 before the first [`Curves::clear`].
    stride: u32,
    /// Number of samples.
    len: usize,
    area_mm2: [[R; STANCE_SAMPLES]; 8],
    force_n: [[R; STANCE_SAMPLES]; 8],
    /// Largest cell pressure of each region, in 0.1 kPa.
    pressure_dkpa: [[u16; STANCE_SAMPLES]; 8],
    /// Centre of pressure of the foot, foot coordinates, in units of 1/[`PER_MM`] mm, limited to 512 mm along each axis.
    centre: [(i16, i16); STANCE_SAMPLES],
    /// The frames between the samples; not valid if every frame is a sample.
    between: [Between<R>; 8],
    /// The last frame.
    last: [Sample<R>; 8],
    last_centre_mm: (R, R),
}

impl<R: Real> Curves<R> {
    /// Curves before the first [`Curves::clear`]. All bytes are zero, so that a static insole occupies no flash.
    pub(super) const EMPTY: Self = Self {
        frames: 0,
        stride: 0,
        len: 0,
        area_mm2: [[R::ZERO; STANCE_SAMPLES]; 8],
        force_n: [[R::ZERO; STANCE_SAMPLES]; 8],
        pressure_dkpa: [[0; STANCE_SAMPLES]; 8],
        centre: [(0, 0); STANCE_SAMPLES],
        between: [Between::NONE; 8],
        last: [Sample::NONE; 8],
        last_centre_mm: (R::ZERO, R::ZERO),
    };

    /// Removes all samples. Their arrays are large, and are not overwritten.
    pub(super) fn clear(&mut self) {
        (self.frames, self.stride, self.len) = (0, 1, 0);
    }

    /// Adds linearly interpolated frames for the `missing` frames between the last one and this one. `loaded` is the number of
    /// frames up to the last one before the gap with the foot on the ground.
    #[cold]
    #[inline(never)]
    pub(super) fn bridge(&mut self, missing: u32, regions: &[&RegionFrame<R>; 8], centre_mm: (R, R), loaded: u32) {
        let (from, from_mm) = (self.last, self.last_centre_mm);
        for i in 1..=missing {
            let part = R::of_u32(i) / R::of_u32(missing + 1);
            let between = |from: R, to: R| from + (to - from) * part;
            self.store(
                |region| from[region].towards(&Sample::of(regions[region]), part),
                (between(from_mm.0, centre_mm.0), between(from_mm.1, centre_mm.1)),
                loaded,
            );
        }
    }

    /// Adds a measured frame. `loaded` is the number of frames up to the last one with the foot on the ground, including this
    /// one.
    pub(super) fn push(&mut self, regions: &[&RegionFrame<R>; 8], centre_mm: (R, R), loaded: u32) {
        self.store(|region| Sample::of(regions[region]), centre_mm, loaded);
    }

    /// Stores a frame as a sample, unless the stride skips it.
    fn store(&mut self, sample: impl Fn(usize) -> Sample<R>, centre_mm: (R, R), loaded: u32) {
        if self.len == STANCE_SAMPLES {
            self.halve(loaded);
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
                self.pressure_dkpa[region][place] = dkpa(sample.2);
            } else if self.frames < loaded {
                self.between[region].include(self.frames, sample.1, dkpa(sample.2));
            }
        }
        self.last_centre_mm = centre_mm;
        if is_stored {
            let units = |mm: R| (mm * R::of_f32(PER_MM)).round_i16();
            self.centre[place] = (units(centre_mm.0), units(centre_mm.1));
            self.len = place + 1;
        }
        self.frames += 1;
    }

    /// Removes every second sample, because there is no place for another one.
    #[cold]
    #[inline(never)]
    fn halve(&mut self, loaded: u32) {
        if self.stride == 1 {
            self.between = [Between::NONE; 8];
        }
        for i in 0..STANCE_SAMPLES / 2 {
            let (remaining, removed) = (2 * i, 2 * i + 1);
            for region in 0..8 {
                let (force_n, pressure_dkpa) = (&mut self.force_n[region], &mut self.pressure_dkpa[region]);
                let frame = removed as u32 * self.stride;
                if frame < loaded {
                    self.between[region].include(frame, force_n[removed], pressure_dkpa[removed]);
                }
                self.area_mm2[region][i] = self.area_mm2[region][remaining];
                force_n[i] = force_n[remaining];
                pressure_dkpa[i] = pressure_dkpa[remaining];
            }
            self.centre[i] = self.centre[remaining];
        }
        self.len = STANCE_SAMPLES / 2;
        self.stride *= 2;
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
    /// If `sample` is not below [`STANCE_SAMPLES`]. From the number of samples on, the result is that of an earlier stance.
    pub fn centre_mm(&self, sample: usize) -> (R, R) {
        let (x, y) = self.centre[sample];
        let mm = |units: i16| R::of_i32(units.into()) * R::of_f32(1.0 / PER_MM);
        (mm(x), mm(y))
    }

    /// The largest values of a region between the samples; `None` if every frame is a sample.
    pub(crate) fn between(&self, region: usize) -> Option<&Between<R>> {
        (self.stride > 1).then(|| &self.between[region])
    }

    /// Total force in a sample, N.
    ///
    /// # Panics
    /// If `sample` is not below [`STANCE_SAMPLES`]. From the number of samples on, the result is that of an earlier stance.
    pub fn total_n(&self, sample: usize) -> R {
        self.force_n.iter().map(|force_n| force_n[sample]).sum()
    }
}

/// A pressure in 0.1 kPa.
fn dkpa<R: Real>(kpa: R) -> u16 {
    (kpa * R::of(10.0)).round_u16()
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
