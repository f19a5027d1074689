//! The standard measures of a step, of each region and of the foot. docs/measures.md has their definitions and sources.

use super::curves::{Curves, samples_within};
use crate::num::Real;

/// The measures of one region in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegionMeasures<R> {
    /// Largest pressure of a cell in the frames of the stance, kPa.
    pub peak_pressure_kpa: R,
    /// Time from heel strike to this pressure, s.
    pub peak_pressure_s: R,
    /// Sum of the largest cell pressures of all samples, times the time between samples, kPa s.
    pub pressure_integral_kpa_s: R,
    /// Force divided by contact area in the sample with the largest force, kPa. With covered shares the area is an effective one,
    /// which is smaller than that of the loaded cells, so this value can exceed [`Self::peak_pressure_kpa`].
    pub mean_pressure_kpa: R,
    /// Slope of the force between 20 and 80 % of its first peak, N/s.
    pub loading_rate_n_s: R,
    /// Time from heel strike to the first sample in contact, s.
    pub contact_start_s: R,
    /// Force of the region under the lifted foot, which is subtracted from the measured force, N. [`RegionMeasures::new`] returns
    /// 0.
    pub residual_n: R,
}

/// A peak is the first one if no sample within this time after it exceeds it, us.
const PEAK_WINDOW_US: u32 = 50_000;
/// The first peak has at least this share of the largest force.
const LEAST_PEAK: f64 = 0.5;

impl<R: Real> RegionMeasures<R> {
    /// Evaluates the curves of a region with the time `sample_s` between samples. Without contact, all measures but the
    /// pressure-time integral are 0.
    ///
    /// # Panics
    /// If `region` is not an index of [`crate::Region::ALL`].
    pub fn new(curves: &Curves<R>, region: usize, sample_s: R) -> Self {
        let (area_mm2, force_n) = (curves.area_mm2(region), curves.force_n(region));
        let time_s = |sample: usize| R::of_u32(sample as u32) * sample_s;
        let (mut peak_dkpa, mut peak_sample, mut sum_dkpa) = (0u16, 0, 0u32);
        for (sample, &dkpa) in curves.pressure_dkpa(region).iter().enumerate() {
            sum_dkpa += u32::from(dkpa);
            if dkpa > peak_dkpa {
                (peak_dkpa, peak_sample) = (dkpa, sample);
            }
        }
        let mut peak_pressure_s = time_s(peak_sample);
        if let Some(between) = curves.between(region)
            && between.pressure_dkpa > peak_dkpa
        {
            peak_dkpa = between.pressure_dkpa;
            peak_pressure_s = R::of_u32(between.pressure_frame.into()) * (sample_s / R::of_u32(curves.stride()));
        }
        let kpa_per_dkpa = R::of(0.1);
        let pressure_integral_kpa_s = R::of_u32(sum_dkpa) * kpa_per_dkpa * sample_s;
        let Some(start) = area_mm2.iter().position(|area_mm2| *area_mm2 > R::ZERO) else {
            return Self { pressure_integral_kpa_s, ..Self::default() };
        };
        let largest = largest(force_n);
        Self {
            peak_pressure_kpa: R::of_u32(peak_dkpa.into()) * kpa_per_dkpa,
            peak_pressure_s,
            pressure_integral_kpa_s,
            mean_pressure_kpa: match area_mm2[largest] > R::ZERO {
                // 1 N on 1 mm2 is 1000 kPa.
                true => force_n[largest] / area_mm2[largest] * R::of(1e3),
                false => R::ZERO,
            },
            loading_rate_n_s: loading_rate_n_s(force_n, force_n[largest], sample_s),
            contact_start_s: time_s(start),
            residual_n: R::ZERO,
        }
    }
}

/// Index of the first of the largest values; 0 for an empty slice.
fn largest<R: Real>(values: &[R]) -> usize {
    let mut largest = 0;
    for (i, value) in values.iter().enumerate() {
        if *value > values[largest] {
            largest = i;
        }
    }
    largest
}

/// Slope of the force between the times at which it passes 20 and 80 % of its first peak, N/s.
fn loading_rate_n_s<R: Real>(force_n: &[R], largest_n: R, sample_s: R) -> R {
    let window = samples_within(PEAK_WINDOW_US, sample_s);
    let is_first_peak = |&i: &usize| {
        let later = &force_n[i..(i + window + 1).min(force_n.len())];
        force_n[i] >= largest_n * R::of(LEAST_PEAK) && later.iter().all(|later_n| *later_n <= force_n[i])
    };
    let Some(peak) = (0..force_n.len()).find(is_first_peak) else { return R::ZERO };
    let rise = &force_n[..=peak];
    // The time at which the force passes this level for the last time before the peak, samples after heel strike. A rise that
    // begins above the level has passed it since the sample before heel strike, in which the region counts as unloaded.
    let passes = |level_n: R| match rise.iter().rposition(|force_n| *force_n < level_n) {
        Some(below) => {
            let (from, to) = (rise[below], rise[below + 1]);
            R::of_u32(below as u32) + (level_n - from) / (to - from)
        }
        None => level_n / rise[0] - R::ONE,
    };
    let level_n = |share: f64| rise[peak] * R::of(share);
    let (low, high) = (passes(level_n(0.2)), passes(level_n(0.8)));
    match high > low {
        true => (level_n(0.8) - level_n(0.2)) / ((high - low) * sample_s),
        false => R::ZERO,
    }
}

/// A force and its time from heel strike.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extremum<R> {
    /// Force, N.
    pub force_n: R,
    /// Time from heel strike, s.
    pub t_s: R,
}

/// Number of points of a gait line.
pub const GAIT_POINTS: usize = 5;

/// The measures of the foot in a step. A foot that loads the ground in one hump has no valley and no second peak: they are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FootMeasures<R> {
    /// Largest total force, N.
    pub peak_n: R,
    /// Largest total force in the first half of stance; with one hump, the largest total force of the stance.
    pub first_peak: Extremum<R>,
    /// Smallest total force between the two peaks.
    pub valley: Extremum<R>,
    /// Largest total force in the second half of stance.
    pub second_peak: Extremum<R>,
    /// Force-time integral of the total force, N s.
    pub integral_n_s: R,
    /// Centre of pressure at 10, 30, 50, 70 and 90 % of stance, foot coordinates, mm.
    pub gait_line_mm: [(R, R); GAIT_POINTS],
    /// Length of the path of the centre of pressure from 10 to 90 % of stance, mm.
    pub gait_length_mm: R,
    /// Extent of this path along the medial-lateral axis, mm.
    pub gait_width_mm: R,
    /// Length of this path, divided by the time from 10 to 90 % of stance, mm/s.
    pub gait_velocity_mm_s: R,
    /// Centre of pressure excursion index: distance of the path, where it crosses two thirds of the length of the [`Extent`],
    /// from the line between its ends, divided by the width of the forefoot. It is positive if the path is lateral of that line.
    /// `None` if the path does not cross this length, as in a step of which the forefoot carries little load.
    pub excursion_index: Option<R>,
    /// Arch index: sum of the largest contact areas of the two midfoot regions, divided by the sum of those of all regions but
    /// the toes.
    pub arch_index: R,
}

/// The extent of the centroids of an insole's cells, foot coordinates, mm. The cells extend farther by half of their size.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extent {
    /// y of the rearmost centroid.
    pub heel_mm: f32,
    /// y of the foremost centroid.
    pub toe_mm: f32,
    /// Width of the forefoot: distance between the outermost centroids of the metatarsal regions along the medial-lateral axis.
    pub forefoot_width_mm: f32,
}

/// A valley is below both peaks by at least this share of the smaller one.
const VALLEY_DEPTH: f64 = 0.05;

impl<R: Real> FootMeasures<R> {
    /// Evaluates the curves of a stance with the time `sample_s` between samples.
    pub fn new(curves: &Curves<R>, sample_s: R, extent: &Extent) -> Self {
        let samples = curves.samples();
        if samples == 0 {
            return Self::default();
        }
        let extremum = |i: usize| Extremum { force_n: curves.total_n(i), t_s: R::of_u32(i as u32) * sample_s };
        let (mut sum_n, mut first, mut second) = (R::ZERO, extremum(0), extremum(samples / 2));
        let (mut first_at, mut second_at) = (0, samples / 2);
        for i in 0..samples {
            let here = extremum(i);
            sum_n += here.force_n;
            if i < samples / 2 {
                if here.force_n > first.force_n {
                    (first, first_at) = (here, i);
                }
            } else if here.force_n > second.force_n {
                (second, second_at) = (here, i);
            }
        }
        let mut valley = first;
        for i in first_at..=second_at {
            let here = extremum(i);
            if here.force_n < valley.force_n {
                valley = here;
            }
        }
        let peak_n = first.force_n.max(second.force_n);
        if valley.force_n > first.force_n.min(second.force_n) * R::of(1.0 - VALLEY_DEPTH) {
            // There is one hump.
            first = if first.force_n >= second.force_n { first } else { second };
            (valley, second) = (Extremum::default(), Extremum::default());
        }
        let mut measures = Self {
            peak_n,
            first_peak: first,
            valley,
            second_peak: second,
            integral_n_s: sum_n * sample_s,
            ..Self::default()
        };
        measures.follow_centre(curves, sample_s, extent);
        let areas = |regions: core::ops::Range<usize>| -> R {
            let largest_mm2 =
                |region: usize| curves.area_mm2(region).iter().fold(R::ZERO, |largest, area| largest.max(*area));
            regions.map(largest_mm2).sum()
        };
        // Regions 0 to 4, from the heel to the metatarsals, are the foot without toes; regions 1 and 2 are the midfoot.
        let foot_mm2 = areas(0..5);
        if foot_mm2 > R::ZERO {
            measures.arch_index = areas(1..3) / foot_mm2;
        }
        measures
    }

    /// Evaluates the path of the centre of pressure.
    fn follow_centre(&mut self, curves: &Curves<R>, sample_s: R, extent: &Extent) {
        let centre_mm = |sample: usize| curves.centre_mm(sample);
        let last = curves.samples() - 1;
        for (point, tenths) in self.gait_line_mm.iter_mut().zip([1u32, 3, 5, 7, 9]) {
            // The position of the point is between two samples.
            let position = tenths * last as u32;
            let (before, part) = ((position / 10) as usize, R::of_u32(position % 10) * R::of(0.1));
            let (from, to) = (centre_mm(before), centre_mm((before + 1).min(last)));
            *point = (from.0 + (to.0 - from.0) * part, from.1 + (to.1 - from.1) * part);
        }
        let (first, end) = (last.div_ceil(10), last * 9 / 10);
        let (start_mm, end_mm) = (self.gait_line_mm[0], self.gait_line_mm[GAIT_POINTS - 1]);
        let (mut low, mut high) = (start_mm.0.min(end_mm.0), start_mm.0.max(end_mm.0));
        let forefoot_mm = R::of_f32(extent.heel_mm + (extent.toe_mm - extent.heel_mm) * (2.0 / 3.0));
        let mut from = start_mm;
        let mut crossing = None;
        // A stance of two samples has none between these ends.
        let points = (first..=end).map(centre_mm).chain([end_mm]);
        for to in points {
            let (dx, dy) = (to.0 - from.0, to.1 - from.1);
            self.gait_length_mm += (dx * dx + dy * dy).sqrt();
            (low, high) = (low.min(to.0), high.max(to.0));
            if from.1 < forefoot_mm && to.1 >= forefoot_mm {
                crossing = Some(from.0 + dx * (forefoot_mm - from.1) / dy);
            }
            from = to;
        }
        self.gait_width_mm = high - low;
        let duration_s = R::of_u32(last as u32) * sample_s * R::of(0.8);
        if duration_s > R::ZERO {
            self.gait_velocity_mm_s = self.gait_length_mm / duration_s;
        }
        let (dx, dy) = (end_mm.0 - start_mm.0, end_mm.1 - start_mm.1);
        if let Some(x_mm) = crossing
            && dy > R::ZERO
            && extent.forefoot_width_mm > 0.0
        {
            let line_mm = start_mm.0 + dx * (forefoot_mm - start_mm.1) / dy;
            // The distance is perpendicular to the line.
            let distance_mm = (x_mm - line_mm) * dy / (dx * dx + dy * dy).sqrt();
            self.excursion_index = Some(distance_mm / R::of_f32(extent.forefoot_width_mm));
        }
    }
}
