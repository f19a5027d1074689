//! Long walks of both feet through the firmware's loops, which run on this computer in virtual time, with storage and the real
//! client.

use crate::Figures;
use anyhow::{Result, anyhow, ensure};
use std::time::Instant;
use testkit::scenario::LongWalk;

/// Frames per second of each foot.
const RATE_HZ: f64 = 100.0;
/// Number of steps of each foot for the measurement of speed.
const SPEED_STEPS: u32 = 400;
/// Number of steps of each foot in the endurance test: more than a person walks in a day. Without pauses they take about seven
/// and a half hours.
const DAY_STEPS: u32 = 25_000;
/// Number of steps of each foot in the short endurance test.
const SHORT_STEPS: u32 = 1_000;

/// Measures how many times faster than real time the walk of both feet is computed.
///
/// # Errors
/// If a step is lost, or a counter does not agree with the messages that arrived.
pub fn measure_speed(figures: &mut Figures) -> Result<()> {
    let start = Instant::now();
    let (outcome, duration) = LongWalk { rounds: 1, rests: &[], steps: SPEED_STEPS, rate_hz: RATE_HZ }.run(|_| ());
    let speed = duration.as_secs_f64() / start.elapsed().as_secs_f64();
    let lost: usize = outcome.verify().map_err(|error| anyhow!("{error}"))?.iter().sum();
    ensure!(lost == 0, "{lost} steps of the walk through the firmware's loops were lost");
    figures.add(
        "scenario_speed",
        speed.round(),
        "at least 200: speed of a walk of both feet through the firmware's loops on this computer, relative to real time",
    );
    Ok(())
}

/// Tests a day of walking with both feet, or a short walk: every step arrives once, and all counters agree with the messages.
///
/// # Errors
/// If a step is lost, or a counter does not agree with the messages that arrived.
pub fn soak(is_short: bool, figures: &mut Figures) -> Result<()> {
    let steps = if is_short { SHORT_STEPS } else { DAY_STEPS };
    let mut minutes = 0;
    let (outcome, duration) = LongWalk { rounds: 1, rests: &[], steps, rate_hz: RATE_HZ }.run(|arrived| {
        minutes += 1;
        if minutes % 60 == 0 {
            eprintln!("{arrived} of {} steps after {} h", 2 * steps, minutes / 60);
        }
    });
    let lost: usize = outcome.verify().map_err(|error| anyhow!("{error}"))?.iter().sum();
    let arrived: usize = outcome.insoles.iter().map(|insole| insole.host.steps().count()).sum();
    ensure!(lost == 0 && arrived == 2 * steps as usize, "{arrived} of {} steps arrived, {lost} were lost", 2 * steps);
    figures.add(
        "soak_steps",
        arrived,
        "steps of both feet in a long walk through the firmware's loops, each received once",
    );
    figures.add(
        "soak_hours",
        (duration.as_secs_f64() / 360.0).round() / 10.0,
        "duration of this walk in virtual time, hours",
    );
    for (insole, key) in outcome.insoles.iter().zip(["left", "right"]) {
        let status = insole.status.ok_or_else(|| anyhow!("the {key} insole does not answer at the end of the walk"))?;
        let counters = insole.host.client.as_ref().map(|client| client.counters()).unwrap_or_default();
        let losses = [
            ("frames_missed", status.frames_missed),
            ("frames_overrun", status.frames_overrun),
            ("records_dropped", status.records_dropped),
            ("not_stored", status.not_stored),
            ("rejected", status.rejected.short + status.rejected.long + status.rejected.broken),
            ("live_lost", counters.frames_lost),
            ("damaged", counters.crc_errors),
        ];
        for (name, count) in losses {
            ensure!(count == 0, "{key} foot: {name} is {count} after a walk without disturbances");
        }
        figures.add(
            &format!("soak_frames.{key}"),
            status.frames,
            "frames of this foot in this walk; none missed, dropped or damaged",
        );
    }
    Ok(())
}
