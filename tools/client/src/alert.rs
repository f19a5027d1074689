//! Alerts and the load of a day in words and as JSON.

use plantar::Region;
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::protocol::Alert;
use serde_json::{Map, Value, json};

/// The region in plain words.
const fn title(region: Region) -> &'static str {
    match region {
        Region::Heel => "heel",
        Region::PosteriorMidfoot => "rear midfoot",
        Region::AnteriorMidfoot => "front midfoot",
        Region::Metatarsals12 => "inner ball",
        Region::Metatarsals35 => "outer ball",
        Region::Hallux => "big toe",
        Region::Toe2 => "second toe",
        Region::Toes35 => "small toes",
    }
}

/// The regions of a bit mask: bit i is the region with index i in [`Region::ALL`].
fn regions_of(bits: u8) -> impl Iterator<Item = Region> {
    Region::ALL.into_iter().enumerate().filter(move |(i, _)| bits >> i & 1 == 1).map(|(_, region)| region)
}

/// The regions of a bit mask in plain words: "heel, inner ball and big toe".
fn titles(bits: u8) -> String {
    let titles: Vec<_> = regions_of(bits).map(title).collect();
    match titles.split_last() {
        Some((last, [])) => (*last).into(),
        Some((last, before)) => format!("{} and {last}", before.join(", ")),
        None => String::new(),
    }
}

/// Whole minutes without load after which a region no longer counts as under sustained load, however long it was loaded before:
/// the share of a window of `window_s` then falls below that of the recommended rules. An alert does not contain another share
/// that a host may have set.
fn relief_min(window_s: u16) -> u32 {
    let unloaded_percent = 100 - u32::from(AlertRules::RECOMMENDED.limits.relieved_percent);
    // The share must fall below the limit, so a time that is just at the limit does not suffice.
    u32::from(window_s) * unloaded_percent / (100 * 60) + 1
}

/// The advice to the wearer in sentences: what to do, and why. Shifting the weight is no remedy: the foot still carries more than
/// the pressure of sustained load, and the other foot carries more.
pub fn alert_advice(alert: &Alert) -> String {
    let side = alert.side.name();
    let mut sentences = Vec::new();
    if alert.sustained != 0 {
        let window = match (alert.window_s / 60, alert.window_s % 60) {
            (2.., 0) => format!("{} minutes", alert.window_s / 60),
            _ => format!("{} seconds", alert.window_s),
        };
        let relief = match relief_min(alert.window_s) {
            1 => "1 minute".into(),
            minutes => format!("{minutes} minutes"),
        };
        sentences.push(format!(
            "Sit, and hold your {side} foot off the floor for {relief}. It carried load here for most of the last {window}: {}.",
            titles(alert.sustained)
        ));
    }
    if alert.dose != 0 {
        sentences.push(format!(
            "Spare your {side} foot for the rest of the day. It has reached the day's limit of high pressure here: {}.",
            titles(alert.dose)
        ));
    }
    sentences.join(" ")
}

/// An alert as an object; the key `advice` contains [`alert_advice`].
pub fn alert_to_json(alert: &Alert) -> Value {
    let mut object = Map::new();
    object.insert("side".into(), alert.side.name().into());
    crate::json::insert(&mut object, Alert::QUANTITIES, alert);
    // The time on the insole's own wall clock, null if it was not set. Unlike that of a step, it is included also for the present
    // boot: when the alert arrives, the host may not yet be able to convert `start_s` to its own clock.
    object.insert("start_unix_s".into(), alert.start_unix_us.map(|us| us as f64 / 1e6).into());
    object.insert("sustained".into(), names(alert.sustained));
    object.insert("dose".into(), names(alert.dose));
    object.insert("advice".into(), alert_advice(alert).into());
    object.into()
}

/// The load of a day as an object; the key `regions` has an object for each region by its name.
pub fn daily_load_to_json(daily: &DailyLoad) -> Value {
    let regions = Region::ALL.iter().zip(&daily.totals.regions).map(|(region, total)| {
        let object = json!({
            "dose_kpa_s": f64::from(total.dose_dkpa_s) / 10.0,
            "squared_pressure_kpa2_s": total.squared_kpa2_s,
            "sustained_s": total.sustained_s,
        });
        (region.name().into(), object)
    });
    json!({
        "day": daily.day,
        "loaded_s": daily.totals.loaded_s,
        "steps": daily.totals.steps,
        "alerts": daily.alerts,
        "snoozed_s": daily.snoozed_s,
        "sustained": names(daily.sustained),
        "regions": regions.collect::<Map<_, _>>(),
    })
}

/// The names of the regions of a bit mask.
fn names(bits: u8) -> Value {
    regions_of(bits).map(Region::name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plantar::Side;

    #[test]
    fn the_advice_names_the_foot_the_regions_and_the_time() {
        let record = plantar::pipeline::alert::AlertRecord {
            side: Side::Left,
            number: 7,
            start_us: 900_000_000,
            sustained: 0b10_1001,
            dose: 1,
            window_s: 900,
            today: 2,
        };
        let alert = Alert::new(&record);
        assert_eq!(
            alert_advice(&alert),
            "Sit, and hold your left foot off the floor for 4 minutes. It carried load here for most of the last 15 minutes: \
             heel, inner ball and big toe. Spare your left foot for the rest of the day. It has reached the day's limit of high \
             pressure here: heel."
        );
        let json = alert_to_json(&alert);
        assert_eq!((&json["start_s"], &json["dose"], &json["today"]), (&json!(900.0), &json!(["heel"]), &json!(2)));
    }

    /// The window is filled with load when the foot is lifted. The advice is the smallest number of whole minutes after which the
    /// loaded share of the window is below the limit.
    #[test]
    fn the_advised_time_is_the_shortest_that_relieves_a_region_by_the_recommended_rules() {
        let limits = AlertRules::RECOMMENDED.limits;
        assert_eq!(relief_min(limits.window_s), 4);
        for window_s in (60..=3600_u16).step_by(60) {
            let is_relieved = |minutes: &u32| {
                let loaded_s = u32::from(window_s).saturating_sub(60 * minutes);
                f64::from(loaded_s) / f64::from(window_s) < f64::from(limits.relieved_percent) / 100.0
            };
            let shortest = (1..).find(is_relieved).expect("a window without load");
            assert_eq!(relief_min(window_s), shortest, "{window_s} s");
        }
    }
}
