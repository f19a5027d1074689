//! Cumulative load and alerts equal those of an independent implementation, and alerts follow their rules.

use crate::common;
use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::alert::{AlertRecord, AlertRules, DailyLoad};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::cumulative::{LoadLimits, Totals};
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{Recording, VirtualInsole};
use serde_json::{Value, json};
use testkit::activity::{self, Activity};

const RATE_HZ: usize = 100;

/// Rules with a window of a minute and a limit of the dose that some tens of steps reach.
const RULES: AlertRules = AlertRules {
    limits: LoadLimits { window_s: 60, ..LoadLimits::DEFAULT },
    dose_kpa_s: 500.0,
    pause_s: 60,
    ..AlertRules::RECOMMENDED
};

/// Passes a recording through an insole with these rules. `request` is called after each second, with the number of seconds so
/// far. Returns the alerts, and the load of the day.
fn run(
    recording: &Recording,
    rules: &AlertRules,
    request: impl FnMut(usize, &mut Insole<f32, DEVICE_CELLS>),
) -> (Vec<AlertRecord>, DailyLoad) {
    run_and_take(recording, rules, |_| true, request)
}

/// As [`run`]. An alert is taken only after the seconds for which `takes` returns true, as if the queue of records were full
/// in the other seconds.
fn run_and_take(
    recording: &Recording,
    rules: &AlertRules,
    takes: impl Fn(usize) -> bool,
    mut request: impl FnMut(usize, &mut Insole<f32, DEVICE_CELLS>),
) -> (Vec<AlertRecord>, DailyLoad) {
    let virtual_insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the set-up is valid");
    insole.set_alert_rules(rules);
    let mut codes = vec![0; virtual_insole.cells.len()];
    let (mut alerts, mut seconds) = (Vec::new(), 0);
    for i in 0..recording.frames() {
        virtual_insole.codes_of(recording, i, &mut codes);
        if insole.frame(i as u32, &codes) {
            insole.whole_step();
        }
        if insole.has_ended_second() {
            seconds += 1;
            if takes(seconds) {
                alerts.extend(insole.take_alert());
            }
            request(seconds, &mut insole);
        }
    }
    (alerts, insole.daily_load())
}

/// A recording of these activities, each of 50 s if it has no steps.
fn day(activities: &[Activity], seed: u64) -> Recording {
    activity::recording(activities, 700.0, RATE_HZ as f64, 50.0, seed).0
}

/// The highest recorded pressure of a cell of each region in each frame, kPa.
fn peaks_kpa(recording: &Recording) -> Vec<Vec<f32>> {
    let cells = recording.cells();
    let of_region = |region: Region| {
        let members: Vec<_> = (0..cells).filter(|&i| recording.layout.cells[i].region == region).collect();
        let frames = recording.pressure_kpa.chunks_exact(cells);
        frames.map(|frame| members.iter().map(|&i| frame[i]).fold(0.0, f32::max)).collect()
    };
    Region::ALL.map(of_region).into()
}

/// The totals and alerts that `alerts.py` computes.
fn numpy(recording: &Recording, rules: &AlertRules) -> Value {
    let input = json!({
        "rate_hz": RATE_HZ,
        "peaks_kpa": peaks_kpa(recording),
        "dose_kpa": rules.limits.dose_kpa,
        "sustained_kpa": rules.limits.sustained_kpa,
        "window_s": rules.limits.window_s,
        "sustained_percent": rules.limits.sustained_percent,
        "relieved_percent": rules.limits.relieved_percent,
        "dose_kpa_s": rules.dose_kpa_s,
        "pause_s": rules.pause_s,
        "per_day": rules.per_day,
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/alerts.py");
    serde_json::from_str(&common::run_python(&[script], &input.to_string())).expect("JSON")
}

#[test]
#[ignore = "needs Python with NumPy: cargo xtask test"]
fn totals_and_alerts_equal_those_of_numpy() {
    use Activity::{Lift, Run, Sit, Stand, StandOnOne, Walk};
    let mut raised = 0;
    for (seed, activities) in [
        &[Walk, Walk, Stand, Stand, StandOnOne, Lift, Lift, Walk][..],
        &[Lift, Run, Run, Run, Run, Run, Run, Sit, Sit, Walk],
        &[Stand, Stand, Lift, Stand, Stand, Stand, Stand, Stand, Lift, Lift],
    ]
    .into_iter()
    .enumerate()
    {
        let recording = day(activities, seed as u64);
        let (alerts, daily) = run(&recording, &RULES, |_, _| ());
        let expected = numpy(&recording, &RULES);
        // An alert has the time of the last frame of its second, one frame period of 10 ms before the end of the second.
        let seconds: Vec<_> = alerts
            .iter()
            .map(|alert| json!([(alert.start_us + 10_000) / 1_000_000, alert.sustained, alert.dose]))
            .collect();
        assert_eq!(json!(seconds), expected["alerts"], "sequence {seed}");
        raised += seconds.len();
        for (i, region) in daily.totals.regions.iter().enumerate() {
            let value = |key: &str| expected[key][i].as_f64().expect("a number");
            // The virtual sensor has 16 bits, and the insole rounds the sums of each second to whole units.
            let near =
                |found: f64, expected: f64, unit: f64| (found - expected).abs() <= 0.005 * expected + 100.0 * unit;
            assert!(near(f64::from(region.dose_dkpa_s) / 10.0, value("dose_kpa_s"), 0.1), "{i}: {region:?}");
            assert!(near(region.squared_kpa2_s.into(), value("squared_kpa2_s"), 1.0), "{i}: {region:?}");
            // The insole divides the window into parts of 4 s. The oldest part counts in proportion to the share of it that is
            // within the window.
            assert!((f64::from(region.sustained_s) - value("sustained_s")).abs() <= 8.0, "{i}: {region:?} {expected}");
        }
    }
    assert!(raised >= 6, "{raised} alerts");
}

#[test]
fn an_alert_repeats_after_the_pause_until_the_budget_of_the_day_is_used() {
    let recording = day(&[Activity::Stand; 8], 1);
    let rules = AlertRules { per_day: 3, dose_kpa_s: 0.0, ..RULES };
    let (alerts, daily) = run(&recording, &rules, |_, _| ());
    let times_s: Vec<_> = alerts.iter().map(|alert| alert.start_us / 1_000_000).collect();
    // The first alert comes after 95 % of a minute of standing, and the next ones every minute.
    assert_eq!(times_s.len(), 3, "{times_s:?}");
    assert!((56..=58).contains(&times_s[0]), "{times_s:?}");
    assert_eq!([times_s[1] - times_s[0], times_s[2] - times_s[1]], [60, 60]);
    assert_eq!((daily.alerts, alerts[2].today), (3, 3));
    assert_eq!(run(&recording, &AlertRules { per_day: 0, ..rules }, |_, _| ()).0, []);
}

#[test]
fn walking_raises_no_alert_of_sustained_load() {
    let recording = day(&[Activity::Walk; 20], 2);
    let (alerts, daily) = run(&recording, &AlertRules { dose_kpa_s: 0.0, ..RULES }, |_, _| ());
    assert_eq!(alerts, []);
    assert_eq!(daily.totals.steps, 200);
    assert!(daily.totals.regions.iter().all(|region| region.sustained_s == 0), "{daily:?}");
}

#[test]
fn only_the_chosen_regions_raise_alerts() {
    let recording = day(&[Activity::Stand; 3], 3);
    let hallux = 1 << Region::Hallux as u8;
    let (alerts, daily) = run(&recording, &AlertRules { regions: hallux, ..RULES }, |_, _| ());
    assert!(!alerts.is_empty() && alerts.iter().all(|alert| alert.sustained | alert.dose == hallux), "{alerts:?}");
    assert_ne!(daily.sustained & !hallux, 0, "the load of the other regions must be counted");
}

#[test]
fn a_snooze_delays_the_alert() {
    let recording = day(&[Activity::Stand; 8], 4);
    let (alerts, _) = run(&recording, &RULES, |seconds, insole| {
        if seconds == 30 {
            insole.snooze_alerts(120);
        }
    });
    assert_eq!(alerts.first().map(|alert| alert.start_us), Some(149_990_000));
}

#[test]
fn a_snooze_does_not_shorten_the_pause_after_an_alert() {
    let recording = day(&[Activity::Stand; 8], 4);
    let rules = AlertRules { dose_kpa_s: 0.0, pause_s: 120, ..RULES };
    let (alerts, _) = run(&recording, &rules, |_, _| ());
    let raised_s = |alert: &AlertRecord| alert.start_us.div_ceil(1_000_000);
    let snoozed_at = raised_s(&alerts[0]) as usize + 1;
    let snoozed = |snoozed_s| {
        let (alerts, _) = run(&recording, &rules, |seconds, insole| {
            if seconds == snoozed_at {
                insole.snooze_alerts(snoozed_s);
            }
        });
        raised_s(&alerts[1]) - raised_s(&alerts[0])
    };
    assert_eq!(raised_s(&alerts[1]) - raised_s(&alerts[0]), 120);
    assert_eq!(snoozed(30), 120);
    assert!(snoozed(150) > 120);
}

#[test]
fn an_alert_that_waits_for_room_in_the_queue_is_not_replaced() {
    let recording = day(&[Activity::Walk, Activity::Walk, Activity::Stand, Activity::Stand, Activity::Stand], 5);
    let rules = AlertRules { dose_kpa_s: 20.0, per_day: u8::MAX, ..RULES };
    let doses = |alerts: &[AlertRecord]| alerts.iter().fold(0, |doses, alert| doses | alert.dose);
    let (at_once, _) = run(&recording, &rules, |_, _| ());
    assert_ne!(doses(&at_once), 0);
    let takes = |seconds| seconds >= 100;
    // The request ends the pause after an alert, so only an alert that was not taken can delay the next one.
    let (late, daily) = run_and_take(&recording, &rules, takes, |_, insole| insole.snooze_alerts(0));
    assert_eq!((doses(&late), usize::from(daily.alerts)), (doses(&at_once), late.len()));
}

#[test]
fn an_alert_states_the_window_by_which_it_was_raised() {
    let recording = day(&[Activity::Stand; 8], 4);
    let (alerts, _) = run_and_take(
        &recording,
        &RULES,
        |seconds| seconds >= 100,
        |seconds, insole| {
            if seconds == 90 {
                let limits = LoadLimits { window_s: 120, ..RULES.limits };
                insole.set_alert_rules(&AlertRules { limits, ..RULES });
            }
        },
    );
    assert!(alerts[0].start_us < 90_000_000, "{alerts:?}");
    assert_eq!(alerts[0].window_s, 60);
}

/// Noon of the day with this number, us since 1970, if days begin before noon.
fn noon_us(day: u32) -> u64 {
    u64::from(day - 1) * 86_400_000_000 + 43_200_000_000
}

/// At ten past eight, the clock is set: by the former rules on day 7, and by the new ones, whose days begin at nine, on day 6.
/// The stored load has the number of its day by the former rules: a load of day 7 is of the present day, one of day 6 of the day
/// before.
#[test]
fn the_stored_load_of_the_day_remains_if_the_beginning_of_the_day_changes_before_the_clock_is_set() {
    let recording = day(&[Activity::Walk, Activity::Stand, Activity::Stand], 5);
    let (_, whole) = run(&recording, &RULES, |_, _| ());
    for (stored_on, is_added) in [(7, true), (6, false)] {
        let totals = Totals { steps: 1000, ..Totals::NONE };
        let earlier = DailyLoad { day: stored_on, totals, alerts: 2, ..DailyLoad::NONE };
        let (_, continued) = run(&recording, &RULES, |seconds, insole| {
            if seconds == 20 {
                insole.restore_day(&earlier);
                insole.set_alert_rules(&AlertRules { day_start_min: 540, ..RULES });
                insole.enter_day(noon_us(7) - 230 * 60_000_000);
            }
        });
        let added = if is_added { (1000, 2) } else { (0, 0) };
        assert_eq!(continued.day, 6);
        assert_eq!((continued.totals.steps, continued.alerts), (whole.totals.steps + added.0, whole.alerts + added.1));
    }
}

#[test]
fn a_day_begins_without_load_and_continues_after_a_restart() {
    let recording = day(&[Activity::Walk, Activity::Stand, Activity::Stand], 5);
    let (_, whole) = run(&recording, &RULES, |_, _| ());
    let (_, renewed) = run(&recording, &RULES, |seconds, insole| match seconds {
        60 => insole.enter_day(noon_us(7)),
        70 => insole.enter_day(noon_us(8)),
        _ => {}
    });
    assert_eq!(renewed.day, 8);
    assert!(renewed.totals.steps == 0 && renewed.totals.loaded_s < whole.totals.loaded_s, "{renewed:?}");

    let earlier = DailyLoad { day: 7, totals: Totals { steps: 1000, ..Totals::NONE }, alerts: 2, ..DailyLoad::NONE };
    // A date that goes back by one day is a correction of the clock. A change of the time at which the day begins does not reset
    // the load, either: the load so far is part of the day of the next call of `enter_day`.
    let (_, same) = run(&recording, &RULES, |seconds, insole| match seconds {
        20 => insole.enter_day(noon_us(7)),
        40 => insole.enter_day(noon_us(6)),
        60 => {
            insole.set_alert_rules(&AlertRules { day_start_min: 600, ..RULES });
            insole.enter_day(noon_us(8));
        }
        _ => {}
    });
    assert_eq!((same.day, same.totals), (8, whole.totals));

    for (day, steps, alerts) in
        [(7, whole.totals.steps + 1000, whole.alerts + 2), (9, whole.totals.steps, whole.alerts)]
    {
        let (_, continued) = run(&recording, &RULES, |seconds, insole| {
            if seconds == 20 {
                insole.restore_day(&earlier);
                insole.enter_day(noon_us(day));
            }
        });
        assert_eq!((continued.totals.steps, continued.alerts), (steps, alerts), "day {day}");
    }
}

/// The first host states a wrong date. Once it is corrected, the load that was stored on the correct day is added, but not twice.
#[test]
fn the_stored_load_of_the_day_is_added_although_the_first_date_was_wrong() {
    let recording = day(&[Activity::Walk, Activity::Stand, Activity::Stand], 5);
    let earlier = DailyLoad { day: 7, totals: Totals { steps: 1000, ..Totals::NONE }, alerts: 2, ..DailyLoad::NONE };
    let run_with = |dates: &'static [(usize, u32)]| {
        let (_, load) = run(&recording, &RULES, |seconds, insole| {
            if seconds == 20 {
                insole.restore_day(&earlier);
            }
            if let Some((_, day)) = dates.iter().find(|(at_s, _)| *at_s == seconds) {
                insole.enter_day(noon_us(*day));
            }
        });
        (load.day, load.totals.steps >= 1000, load.totals.steps < 2000, load.alerts >= 2)
    };
    assert_eq!(run_with(&[(20, 300), (40, 7), (41, 7), (60, 7)]), (7, true, true, true));
    // The clock goes back to the day of the stored load, but the load so far is of the next day.
    assert_eq!(run_with(&[(20, 8), (40, 7)]), (8, false, true, false));
}

#[test]
fn the_day_begins_at_the_set_minute() {
    let rules = AlertRules { day_start_min: 330, ..AlertRules::OFF };
    let minute_us = 60_000_000;
    let midnight_us = 20_000 * 1440 * minute_us;
    assert_eq!(rules.day(midnight_us), rules.day(midnight_us + 329 * minute_us));
    assert_eq!(rules.day(midnight_us) + 1, rules.day(midnight_us + 330 * minute_us));
}

/// At 31.25 Hz, 31 frames are counted as a second, but last 0.992 s. The recording ends within a second.
#[test]
fn the_load_of_a_recording_has_its_time_at_a_rate_that_is_no_integer() {
    let walk = common::synthetic_walk(20, 100.0).at_rate(31.25).expect("a walk");
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("the set-up is valid");
    let mut codes = vec![0; virtual_insole.cells.len()];
    for i in 0..walk.frames() {
        virtual_insole.codes_of(&walk, i, &mut codes);
        insole.frame(i as u32, &codes);
    }
    insole.end_load();
    let cells = &walk.layout.cells;
    for region in [Region::Heel, Region::Metatarsals12, Region::Hallux] {
        let squared_kpa2_s: f64 = walk
            .pressure_kpa
            .chunks(cells.len())
            .map(|frame| {
                let of_region = frame.iter().zip(cells).filter(|(_, cell)| cell.region == region);
                of_region.map(|(kpa, _)| f64::from(*kpa).powi(2)).fold(0.0, f64::max) / 31.25
            })
            .sum();
        let total = f64::from(insole.daily_load().totals.regions[region as usize].squared_kpa2_s);
        assert!((total - squared_kpa2_s).abs() < 0.003 * squared_kpa2_s, "{region:?}: {total}, {squared_kpa2_s}");
    }
}
