//! The steps that an insole completes, and table columns of the quantities and flags that it reports.

use crate::table::{Row, Value};
use plantar::insole::Insole;
use plantar::pipeline::bout::{BoutKind, BoutRecord};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::step::StepRecord;
use plantar::protocol::{Bout, BoutRegion, Flag, Quantity, Step, StepFoot, StepRegion};
use plantar::{Real, Region, Side};

/// The row of the region with index `i` of [`Region::ALL`] in a step. The order of the columns is part of the format of tables.
///
/// # Panics
/// Panics if there is no region `i`.
pub fn step_row(step: &Step, i: usize) -> Row {
    let r = &step.regions[i];
    // Quantities that JSON has in an object within the region are the last columns of the region.
    let (nested, quantities): (Vec<_>, Vec<_>) = StepRegion::QUANTITIES.iter().partition(|q| q.path().0.is_some());
    let (counts, quantities): (Vec<_>, Vec<_>) = quantities.into_iter().partition(|q| q.is_count());
    let (unscaled, scaled): (Vec<_>, Vec<_>) = quantities.into_iter().partition(|q| q.per_unit == 1);
    let mut row: Row = vec![("side", step.side.name().into())];
    row.extend(columns(Step::QUANTITIES, step));
    row.push(("region", Region::ALL[i].name().into()));
    row.extend(columns(unscaled, r));
    row.extend(flag_columns(Step::FLAGS, step, i));
    row.extend(columns(counts, r));
    row.extend([
        ("contact_on_kpa", f64::from(step.contact_rule.on_kpa).into()),
        ("contact_off_kpa", f64::from(step.contact_rule.off_kpa).into()),
        ("contact_full_kpa", f64::from(step.contact_rule.full_kpa).into()),
    ]);
    row.extend(columns(scaled, r));
    row.extend(columns(nested, r));
    row.extend(columns(StepFoot::QUANTITIES, &step.foot));
    row
}

/// The step that the last frame of `insole` completed, if its result `toe_off` is true: this frame confirmed toe off, which was
/// some frames earlier.
pub fn completed_step<R: Real, const CELLS: usize>(toe_off: bool, insole: &mut Insole<R, CELLS>) -> Option<Step> {
    toe_off.then(|| insole.whole_step()).flatten().map(|step| Step::new(&step))
}

/// A row with arbitrary values, for the names and types of the columns of a table of steps that may have no rows.
pub fn step_columns() -> Row {
    let step = Step::new(&StepRecord::<f32> {
        side: Side::Left,
        step: 0,
        start_us: 0,
        duration_us: 0,
        sample_us: 0,
        bridged_frames: 0,
        saturated: 0,
        contact_rule: ContactRule::COVERED,
        foot: Default::default(),
        regions: Default::default(),
    });
    step_row(&step, 0)
}

/// The row of the region with index `i` of [`Region::ALL`] in a load bout. The order of the columns is part of the format of
/// tables.
///
/// # Panics
/// Panics if there is no region `i`.
pub fn bout_row(bout: &Bout, i: usize) -> Row {
    let mut row: Row = vec![("side", bout.side.name().into())];
    row.extend(columns(Bout::QUANTITIES, bout));
    row.extend([("kind", bout.kind.name().into()), ("region", Region::ALL[i].name().into())]);
    row.extend(columns(BoutRegion::QUANTITIES, &bout.regions[i]));
    row
}

/// A row with arbitrary values, for the names and types of the columns of a table of load bouts that may have no rows.
pub fn bout_columns() -> Row {
    let record = BoutRecord::<f32> {
        side: Side::Left,
        number: 0,
        start_us: 0,
        duration_us: 0,
        kind: BoutKind::Unclassified,
        regions: Default::default(),
    };
    bout_row(&Bout::new(&record), 0)
}

/// A note on quantities that have the largest value of their range in some of these steps, so that the true values may be larger;
/// `None` if there are none. `docs/quantities.md` has the ranges.
pub fn range_note(steps: &[Step]) -> Option<String> {
    let of_feet = StepFoot::QUANTITIES.iter().filter_map(|quantity| {
        let largest = largest(quantity)?;
        let count = steps.iter().filter(|step| (quantity.value)(&step.foot) == Some(largest)).count();
        limited(quantity, largest, count)
    });
    let of_regions = StepRegion::QUANTITIES.iter().filter_map(|quantity| {
        let largest = largest(quantity)?;
        let is_limited = |step: &&Step| step.regions.iter().any(|region| (quantity.value)(region) == Some(largest));
        limited(quantity, largest, steps.iter().filter(is_limited).count())
    });
    let quantities: Vec<_> = of_feet.chain(of_regions).collect();
    (!quantities.is_empty())
        .then(|| format!("at the end of their range, so that true values may be larger: {}", quantities.join(", ")))
}

/// The largest integer of a quantity with a range that can be too short; `None` for others.
fn largest<T>(quantity: &Quantity<T>) -> Option<i64> {
    match quantity.wire_type {
        "u16" => Some(u16::MAX.into()),
        "i16" => Some(i16::MAX.into()),
        _ => None,
    }
}

/// The name of a quantity with the end of its range, and the number of steps in which it has this value, `count`; `None` for 0.
fn limited<T>(quantity: &Quantity<T>, largest: i64, count: usize) -> Option<String> {
    let largest = largest as f64 / f64::from(quantity.per_unit);
    let steps = if count == 1 { "step" } else { "steps" };
    (count > 0).then(|| format!("{} ({largest} {} in {count} {steps})", quantity.name, quantity.unit))
}

/// The columns of these quantities, with the values that they have in `of`: a live frame, a step, a load bout or a region.
pub fn columns<T: 'static>(
    quantities: impl IntoIterator<Item = &'static Quantity<T>>,
    of: &T,
) -> impl Iterator<Item = (&'static str, Value)> {
    quantities.into_iter().map(move |quantity| {
        let integer = || (quantity.value)(of).and_then(|value| i32::try_from(value).ok());
        let value = if quantity.is_count() { Value::Integer(integer()) } else { Value::Real(quantity.in_unit(of)) };
        (quantity.name, value)
    })
}

/// The columns of these flags, with the values that they have in `of` for the region with this index.
pub fn flag_columns<T: 'static>(
    flags: &'static [Flag<T>],
    of: &T,
    region: usize,
) -> impl Iterator<Item = (&'static str, Value)> {
    flags.iter().map(move |flag| (flag.name, flag.is_set(of, region).into()))
}
