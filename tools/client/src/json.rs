//! Steps and load bouts as JSON objects. Keys include units, and values have the resolution of the message.

use plantar::Region;
use plantar::protocol::{Bout, BoutRegion, Quantity, Step, StepFoot, StepRegion};
use serde_json::{Map, Value, json};

/// A step as an object; the key `foot` has the measures of the foot, and `regions` an object for each region by its
/// name.
///
/// Values have the resolution of the step message, so a step that an insole sent and the same step computed on a host have the
/// same text. `docs/quantities.md` lists the names.
pub fn step_to_json(step: &Step) -> Value {
    let mut object = Map::new();
    object.insert("side".into(), step.side.name().into());
    insert(&mut object, Step::QUANTITIES, step);
    // For a step of the present boot the host's clock gives a more accurate time, so the insole's time is null.
    let start_unix_s = step.start_unix_us.filter(|_| step.boots_since > 0).map(|us| us as f64 / 1e6);
    object.insert("start_unix_s".into(), start_unix_s.into());
    object.insert("contact_rule".into(), contact_rule_to_json(step));
    let mut foot = Map::new();
    insert(&mut foot, StepFoot::QUANTITIES, &step.foot);
    object.insert("foot".into(), foot.into());
    let regions = Region::ALL.iter().enumerate().map(|(i, region)| (region.name().into(), region_to_json(step, i)));
    object.insert("regions".into(), regions.collect::<Map<_, _>>().into());
    object.into()
}

/// A load bout as an object; the key `kind` has its kind, and `regions` an object for each region by its name.
pub fn bout_to_json(bout: &Bout) -> Value {
    let mut object = Map::new();
    object.insert("kind".into(), bout.kind.name().into());
    object.insert("side".into(), bout.side.name().into());
    insert(&mut object, Bout::QUANTITIES, bout);
    let start_unix_s = bout.start_unix_us.filter(|_| bout.boots_since > 0).map(|us| us as f64 / 1e6);
    object.insert("start_unix_s".into(), start_unix_s.into());
    let regions = Region::ALL.iter().zip(&bout.regions).map(|(name, region)| {
        let mut object = Map::new();
        insert(&mut object, BoutRegion::QUANTITIES, region);
        (name.name().into(), object.into())
    });
    object.insert("regions".into(), regions.collect::<Map<_, _>>().into());
    object.into()
}

fn region_to_json(step: &Step, i: usize) -> Value {
    let region = &step.regions[i];
    let mut object = Map::new();
    let (counts, mut quantities): (Vec<_>, Vec<_>) =
        StepRegion::QUANTITIES.iter().partition(|quantity| quantity.is_count());
    // Nested objects follow the other quantities, and in both groups quantities without decimals come last.
    quantities.sort_by_key(|quantity| (quantity.path().0.is_some(), quantity.per_unit == 1));
    insert(&mut object, quantities, region);
    for flag in Step::FLAGS {
        object.insert(flag.name.into(), flag.is_set(step, i).into());
    }
    insert(&mut object, counts, region);
    object.into()
}

/// Inserts the quantities of a message, or of a part of one, under their keys. A nested object is null if its quantities have no
/// value.
pub(crate) fn insert<T: 'static>(
    object: &mut Map<String, Value>,
    quantities: impl IntoIterator<Item = &'static Quantity<T>>,
    message: &T,
) {
    for quantity in quantities {
        let value = if quantity.per_unit == 1 {
            (quantity.value)(message).map(Value::from)
        } else {
            quantity.in_unit(message).map(Value::from)
        };
        match (quantity.path(), value) {
            ((None, key), value) => {
                object.insert(key.into(), value.into());
            }
            ((Some(nested), _), None) => {
                object.insert(nested.into(), Value::Null);
            }
            ((Some(nested), key), Some(value)) => object.entry(nested).or_insert_with(|| json!({}))[key] = value,
        }
    }
}

fn contact_rule_to_json(step: &Step) -> Value {
    let rule = &step.contact_rule;
    json!({
        // The name of the quantities area_mm2 and area_peak_mm2.
        "area": if rule.full_kpa > 0.0 { "effective area" } else { "contact area" },
        "rule": if rule.full_kpa > 0.0 { "fractional" } else { "counted" },
        "on_kpa": rule.on_kpa,
        "off_kpa": rule.off_kpa,
        "full_kpa": rule.full_kpa,
    })
}
