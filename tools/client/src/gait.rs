//! Measures of walking from the steps of one foot or of both feet. `docs/measures.md` has the definitions and their sources.

mod estimate;

pub use estimate::Estimate;

use estimate::Consecutive;
use plantar::protocol::Step;
use plantar::sequence::is_after;
use serde_json::{Value, json};
use std::ops::{Range, RangeInclusive};

/// A step on the clock of the walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FootStep {
    /// Number of the step on its insole, not counting other records: the next step has the next number.
    pub number: u32,
    /// Time of the heel strike, s. The times of both feet are comparable if they are on a common clock, such as that of
    /// [`crate::ClockMapping`]. Without one, [`Gait::new`] does not compare the feet.
    pub start_s: f64,
    /// Time from heel strike to toe off, s.
    pub duration_s: f64,
    /// Largest total force, N.
    pub peak_n: f64,
    /// Force-time integral, N s.
    pub integral_n_s: f64,
}

impl FootStep {
    /// A step with its heel strike at `start_us` on the clock of the walk. `others` are the numbers of the insole's load
    /// bouts and alerts, which are numbered together with the steps.
    pub fn new(step: &Step, start_us: u64, others: &[u32]) -> Self {
        let before = others.iter().filter(|other| is_after(step.step, **other)).count();
        Self {
            number: step.step.wrapping_sub(before as u32),
            start_s: start_us as f64 / 1e6,
            duration_s: step.duration_s(),
            peak_n: step.foot.foot_force_peak_n(),
            integral_n_s: step.foot.foot_force_integral_n_s(),
        }
    }

    fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }
}

/// A measure of a stride.
#[derive(Debug)]
pub struct Measure {
    /// Key in JSON, with its unit.
    pub key: &'static str,
    /// Name in tables.
    pub title: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Number of decimals in tables.
    pub digits: usize,
    /// True if the symmetry of both feet is computed.
    pub has_symmetry: bool,
}

const fn measure(
    key: &'static str,
    title: &'static str,
    unit: &'static str,
    digits: usize,
    has_symmetry: bool,
) -> Measure {
    Measure { key, title, unit, digits, has_symmetry }
}

/// Number of the measures of a stride.
pub const COUNT: usize = 14;

/// The measures of a stride, in the order of [`Stride::values`].
pub const MEASURES: [Measure; COUNT] = [
    measure("stride_time_s", "Stride time", "s", 3, false),
    measure("step_time_s", "Step time", "s", 3, true),
    measure("stance_time_s", "Stance time", "s", 3, true),
    measure("swing_time_s", "Swing time", "s", 3, true),
    measure("stance_percent", "Stance", "%", 1, false),
    measure("swing_percent", "Swing", "%", 1, false),
    measure("first_double_support_s", "Double support, first phase", "s", 3, false),
    measure("double_support_s", "Double support", "s", 3, false),
    measure("double_support_percent", "Double support", "%", 1, false),
    measure("single_support_s", "Single support", "s", 3, false),
    measure("single_support_percent", "Single support", "%", 1, false),
    measure("flight_s", "Flight", "s", 3, false),
    measure("peak_force_n", "Peak force", "N", 0, true),
    measure("force_integral_n_s", "Force-time integral", "N s", 1, true),
];

/// Places of measures in [`MEASURES`].
const STEP_TIME: usize = 1;
const SUPPORTS: Range<usize> = 6..11;
const FLIGHT: usize = 11;

/// Longest stride time, s, of a person who does not walk slowly: a longer time between two steps of a foot contains a pause. The
/// longest strides in the walks of the package `moticon-opengo` (docs/baseline.md) take 2.2 s.
pub const LONGEST_STRIDE_S: f64 = 2.5;
/// A stride takes at most this multiple of the median stride time of the walk. This limit replaces a shorter
/// [`LONGEST_STRIDE_S`], so that the strides of a slow walker are not cut off at that time, which would shorten their mean.
const LONGEST_OF_MEDIAN: f64 = 2.0;

/// The other foot steps in this part of a stride. In walking and running, it steps in about the middle. The feet of a person who
/// jumps land together, and small differences determine which one is the first.
const ALTERNATING: RangeInclusive<f64> = 0.15..=0.85;

/// The longest stride time of a walk, s. `steps` contains the steps of both feet, each in the order of time.
fn longest_stride_s(steps: &[Vec<FootStep>; 2]) -> f64 {
    let pairs = steps.iter().flat_map(|steps| steps.windows(2));
    let successive = pairs.filter(|pair| pair[1].number == pair[0].number.wrapping_add(1));
    let mut times_s: Vec<f64> = successive.map(|pair| pair[1].start_s - pair[0].start_s).collect();
    times_s.sort_by(f64::total_cmp);
    times_s.get(times_s.len() / 2).map_or(0.0, |median_s| LONGEST_OF_MEDIAN * median_s).max(LONGEST_STRIDE_S)
}

/// A stride: from a heel strike to the next heel strike of the same foot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    /// Time of the first heel strike, s.
    pub start_s: f64,
    /// Time of the heel strike of the other foot within the stride, s; `None` if [`Gait::has_both_feet`] is false.
    pub other_s: Option<f64>,
    /// True if the stride before this one in [`FootGait::strides`] ends at `start_s`.
    pub is_consecutive: bool,
    /// The measures, in the order of [`MEASURES`]; `None` without the steps of the other foot that a measure needs.
    pub values: [Option<f64>; COUNT],
}

/// The measures of one foot.
#[derive(Clone, Debug, PartialEq)]
pub struct FootGait {
    /// The strides from which the measures are computed.
    pub strides: Vec<Stride>,
    /// Number of pairs of successive steps that do not form a stride: there is a pause or a missing step between them, or they
    /// overlap.
    pub gaps: usize,
    /// Number of strides that are not used, because they do not contain exactly one heel strike of the other foot, from 15 to 85
    /// % of the stride.
    pub unpaired: usize,
    /// The measures, in the order of [`MEASURES`].
    pub measures: [Option<Estimate>; COUNT],
}

/// The measures of a walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Gait {
    /// The left and the right foot.
    pub feet: [FootGait; 2],
    /// True if the steps of both feet are known on one clock. Otherwise there are only the measures that need the steps of a
    /// single foot.
    pub has_both_feet: bool,
    /// Steps of both feet in a minute.
    pub cadence_per_min: Option<Estimate>,
    /// Symmetry index of the measures, %, in the order of [`MEASURES`]: 0 for equal feet, positive if the left value is larger.
    pub symmetry_percent: [Option<Estimate>; COUNT],
    /// Time from the first to the last heel strike of both feet, s; `None` if there is a pause or a missing step, or if the steps
    /// of both feet are not known on one clock.
    pub walking_s: Option<f64>,
}

/// A length that the user states, m, from which the walking speed follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// Mean length of a stride.
    Stride(f64),
    /// Distance from the first to the last heel strike.
    Walk(f64),
}

impl Gait {
    /// The measures of the steps of the left and of the right foot, in any order. Without `has_common_clock`, the times of the
    /// two feet are not compared.
    pub fn new(mut steps: [Vec<FootStep>; 2], has_common_clock: bool) -> Self {
        steps.iter_mut().for_each(|steps| steps.sort_by(|a, b| a.start_s.total_cmp(&b.start_s)));
        let has_both_feet = has_common_clock && steps.iter().all(|steps| !steps.is_empty());
        let longest_s = longest_stride_s(&steps);
        let [left, right] = &steps;
        let feet = [(left, right), (right, left)]
            .map(|(own, other)| FootGait::new(own, has_both_feet.then_some(other), longest_s));
        let symmetry_percent = if has_both_feet { symmetry_percent(&feet) } else { [None; COUNT] };
        let cadence_per_min = cadence_per_min(&feet, has_both_feet, longest_s);
        let walking_s = walking_s(&steps, has_both_feet, longest_s);
        Self { feet, has_both_feet, cadence_per_min, symmetry_percent, walking_s }
    }

    /// The measures of a person who walks or hops on one leg: the other foot was recorded, but took no step. There is no cadence,
    /// which counts a step of each foot in a stride.
    pub fn on_one_leg(self) -> Self {
        Self { cadence_per_min: None, ..self }
    }

    /// Walking speed, m/s. `None` without [`Gait::cadence_per_min`] for [`Length::Stride`], and without [`Gait::walking_s`] for
    /// [`Length::Walk`].
    pub fn speed_m_s(&self, length: Length) -> Option<f64> {
        match length {
            // A stride has two steps.
            Length::Stride(length_m) => Some(length_m * self.cadence_per_min?.mean / 120.0),
            Length::Walk(distance_m) => Some(distance_m / self.walking_s?),
        }
    }

    /// The measures as an object. `docs/measures.md` describes it.
    pub fn to_json(&self, length: Option<Length>) -> Value {
        let estimate = |estimate: Option<Estimate>| estimate.map(Estimate::to_json);
        let [left, right] = &self.feet;
        let counts = |count: fn(&FootGait) -> usize| json!({ "left": count(left), "right": count(right) });
        let measures = MEASURES.iter().enumerate().map(|(i, measure)| {
            json!({
                "key": measure.key,
                "title": measure.title,
                "unit": measure.unit,
                "digits": measure.digits,
                "left": estimate(left.measures[i]),
                "right": estimate(right.measures[i]),
                "symmetry_percent": estimate(self.symmetry_percent[i]),
            })
        });
        json!({
            "has_both_feet": self.has_both_feet,
            "strides": counts(|foot| foot.strides.len()),
            "gaps": counts(|foot| foot.gaps),
            "unpaired": counts(|foot| foot.unpaired),
            "cadence_per_min": estimate(self.cadence_per_min),
            "speed_m_s": length.and_then(|length| self.speed_m_s(length)),
            "measures": measures.collect::<Vec<_>>(),
        })
    }
}

impl FootGait {
    /// The strides of the steps `own` in the order of time; `other` has the steps of the other foot. A stride takes at most
    /// `longest_s`.
    fn new(own: &[FootStep], other: Option<&Vec<FootStep>>, longest_s: f64) -> Self {
        let mut foot = Self { strides: Vec::new(), gaps: 0, unpaired: 0, measures: [None; COUNT] };
        let mut end_s = None;
        for pair in own.windows(2) {
            let (step, next) = (&pair[0], &pair[1]);
            let stride_s = next.start_s - step.start_s;
            if !follows(next, step, longest_s) || step.duration_s >= stride_s {
                foot.gaps += 1;
                continue;
            }
            let (other_s, values) = match other {
                None => (None, values_of(step, stride_s)),
                Some(other) => {
                    let [first, after] =
                        [step.start_s, next.start_s].map(|t_s| other.partition_point(|step| step.start_s < t_s));
                    let is_alternating =
                        |other: &FootStep| ALTERNATING.contains(&((other.start_s - step.start_s) / stride_s));
                    if after != first + 1 || !is_alternating(&other[first]) {
                        foot.unpaired += 1;
                        continue;
                    }
                    let before = first.checked_sub(1).map(|before| &other[before]);
                    (
                        Some(other[first].start_s),
                        values_of_both(
                            step,
                            next,
                            &other[first],
                            before.filter(|before| follows(&other[first], before, longest_s)),
                        ),
                    )
                }
            };
            let is_consecutive = end_s == Some(step.start_s);
            end_s = Some(next.start_s);
            foot.strides.push(Stride { start_s: step.start_s, other_s, is_consecutive, values });
        }
        foot.measures = core::array::from_fn(|i| {
            let values = foot.strides.iter().enumerate().filter_map(|(at, stride)| {
                // If the stride before this one lacks the measure, the previous value belongs to an earlier stride.
                let follows_value = at.checked_sub(1).is_some_and(|before| foot.strides[before].values[i].is_some());
                Some((stride.values[i]?, stride.is_consecutive && follows_value))
            });
            Estimate::new(&values.collect::<Vec<_>>())
        });
        foot
    }
}

/// True if `next` is the step of the same foot after `step`, without a pause between them: at most `longest_s` later.
fn follows(next: &FootStep, step: &FootStep, longest_s: f64) -> bool {
    next.number == step.number.wrapping_add(1) && next.start_s - step.start_s <= longest_s
}

/// The measures of a stride that need only the steps of its own foot, in the order of [`MEASURES`].
fn values_of(step: &FootStep, stride_s: f64) -> [Option<f64>; COUNT] {
    let swing_s = stride_s - step.duration_s;
    let percent = |time_s: f64| Some(100.0 * time_s / stride_s);
    [
        Some(stride_s),
        None,
        Some(step.duration_s),
        Some(swing_s),
        percent(step.duration_s),
        percent(swing_s),
        None,
        None,
        None,
        None,
        None,
        None,
        Some(step.peak_n),
        Some(step.integral_n_s),
    ]
}

/// The measures of a stride from `step` to `next`, during which the other foot takes the step `other`; `before` is the step of
/// the other foot directly before that one.
fn values_of_both(
    step: &FootStep,
    next: &FootStep,
    other: &FootStep,
    before: Option<&FootStep>,
) -> [Option<f64>; COUNT] {
    let stride_s = next.start_s - step.start_s;
    let mut values = values_of(step, stride_s);
    values[STEP_TIME] = Some(next.start_s - other.start_s);
    // From the last toe off to the next heel strike, twice in a stride.
    let lifted_s = before.map_or(step.end_s(), |before| step.end_s().max(before.end_s()));
    let both_lifted_s = step.end_s().max(other.end_s());
    values[FLIGHT] = Some((other.start_s - lifted_s).max(0.0) + (next.start_s - both_lifted_s).max(0.0));
    if let Some(before) = before {
        let first_s = (before.end_s().min(step.end_s()) - step.start_s).max(0.0);
        let second_s = (step.end_s().min(other.end_s()) - other.start_s).max(0.0);
        let (double_s, single_s) = (first_s + second_s, step.duration_s - first_s - second_s);
        let supports = [first_s, double_s, 100.0 * double_s / stride_s, single_s, 100.0 * single_s / stride_s];
        // The phases of double and of single support.
        values[SUPPORTS].copy_from_slice(&supports.map(Some));
    }
    values
}

/// The symmetry indices of the pairs of a left stride and the right stride that begins within it.
fn symmetry_percent([left, right]: &[FootGait; 2]) -> [Option<Estimate>; COUNT] {
    let starts_at = |t_s: f64| {
        let at = right.strides.binary_search_by(|stride| stride.start_s.total_cmp(&t_s)).ok()?;
        right.strides.get(at)
    };
    let pairs: Vec<_> = left.strides.iter().filter_map(|stride| Some((stride, starts_at(stride.other_s?)?))).collect();
    core::array::from_fn(|i| {
        let index = |(left, right): &(&Stride, &Stride)| -> Option<Consecutive> {
            let (left_value, right_value) = (left.values[i]?, right.values[i]?);
            let sum = left_value + right_value;
            (sum > 0.0).then(|| (200.0 * (left_value - right_value) / sum, left.is_consecutive && right.is_consecutive))
        };
        let indices: Vec<_> = pairs.iter().filter_map(index).collect();
        if MEASURES[i].has_symmetry { Estimate::new(&indices) } else { None }
    })
}

/// The cadence from the strides of both feet; without a common clock, from the strides of the foot that has more of them.
/// Strides of the two feet overlap, which makes successive values similar; the interval of [`Estimate`] takes this into account.
fn cadence_per_min([left, right]: &[FootGait; 2], has_both_feet: bool, longest_s: f64) -> Option<Estimate> {
    let mut strides: Vec<&Stride> = match (has_both_feet, left.strides.len() >= right.strides.len()) {
        (true, _) => left.strides.iter().chain(&right.strides).collect(),
        (false, true) => left.strides.iter().collect(),
        (false, false) => right.strides.iter().collect(),
    };
    strides.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    let values = strides.iter().enumerate().filter_map(|(i, stride)| {
        let is_consecutive = i > 0 && stride.start_s - strides[i - 1].start_s <= longest_s;
        Some((120.0 / stride.values[0]?, is_consecutive))
    });
    Estimate::new(&values.collect::<Vec<_>>())
}

/// See [`Gait::walking_s`].
fn walking_s(steps: &[Vec<FootStep>; 2], has_both_feet: bool, longest_s: f64) -> Option<f64> {
    let is_walk = |steps: &&Vec<FootStep>| steps.windows(2).all(|pair| follows(&pair[1], &pair[0], longest_s));
    if !has_both_feet || !steps.iter().all(|steps| is_walk(&steps)) {
        return None;
    }
    // Both feet have steps, which are in the order of time.
    let [first_s, last_s] = [<[FootStep]>::first, <[FootStep]>::last]
        .map(|end| steps.each_ref().map(|steps| end(steps).map_or(0.0, |step| step.start_s)));
    // The feet may have walked one after the other.
    if first_s[0].max(first_s[1]) - last_s[0].min(last_s[1]) > longest_s {
        return None;
    }
    let time_s = last_s[0].max(last_s[1]) - first_s[0].min(first_s[1]);
    (time_s > 0.0).then_some(time_s)
}
