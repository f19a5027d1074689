//! Long walks on the host loops: the firmware's loops in virtual time on this computer, with both feet, storage and the real
//! client.

use crate::Figures;
use anyhow::{Result, anyhow, ensure};
use std::time::Instant;
use testkit::scenario::LongWalk;

/// Frames per second.
const RATE_HZ: f64 = 100.0;
/// Steps of each foot for the measurement of speed.
const SPEED_STEPS: u32 = 400;
/// Steps of each foot in a day, and in a short endurance test.
const DAY_STEPS: u32 = 25_000;
const SHORT_STEPS: u32 = 1_000;

/// Measures how many times faster than real time both feet walk.
///
/// # Errors
/// Where a step is lost or a counter does not add up.
pub fn measure_speed(figures: &mut Figures) -> Result<()> {
    let start = Instant::now();
    let (outcome, walked) = LongWalk { steps: SPEED_STEPS, rate_hz: RATE_HZ }.run(|_| ());
    let speed = walked.as_secs_f64() / start.elapsed().as_secs_f64();
    let lost = outcome.verify().map_err(|error| anyhow!("{error}"))?;
    ensure!(lost == 0, "{lost} steps of the walk on the host loops were lost");
    figures.add("scenario_speed", speed.round(), "at least 200: walking on the host loops, times real time, both feet");
    Ok(())
}

/// A day of walking with both feet: every step arrives once, and all counters add up.
///
/// # Errors
/// Where a step is lost or a counter does not add up.
pub fn soak(is_short: bool, figures: &mut Figures) -> Result<()> {
    let steps = if is_short { SHORT_STEPS } else { DAY_STEPS };
    let mut minutes = 0;
    let (outcome, walked) = LongWalk { steps, rate_hz: RATE_HZ }.run(|arrived| {
        minutes += 1;
        if minutes % 60 == 0 {
            eprintln!("{arrived} of {} steps after {} h", 2 * steps, minutes / 60);
        }
    });
    let lost = outcome.verify().map_err(|error| anyhow!("{error}"))?;
    let arrived: usize = outcome.insoles.iter().map(|insole| insole.host.steps.len()).sum();
    ensure!(lost == 0 && arrived == 2 * steps as usize, "{arrived} of {} steps arrived, {lost} were lost", 2 * steps);
    figures.add("soak_steps", arrived, "steps of a day of walking on the host loops, each delivered once");
    figures.add("soak_hours", (walked.as_secs_f64() / 360.0).round() / 10.0, "their duration in virtual time");
    for (insole, key) in outcome.insoles.iter().zip(["left", "right"]) {
        let status = insole.status.ok_or_else(|| anyhow!("the {key} insole does not answer at the end of the walk"))?;
        let counters = insole.host.client.as_ref().map(|client| client.counters()).unwrap_or_default();
        let losses = [
            ("frames_missed", status.frames_missed),
            ("frames_overrun", status.frames_overrun),
            ("steps_dropped", status.steps_dropped),
            ("not_stored", status.not_stored),
            ("rejected", status.rejected.short + status.rejected.long + status.rejected.broken),
            ("live_lost", counters.frames_lost),
            ("damaged", counters.crc_errors),
        ];
        for (name, count) in losses {
            ensure!(count == 0, "{key}: {name} is {count} after a walk without disturbances");
        }
        figures.add(&format!("soak_frames.{key}"), status.frames, "processed frames; none missed, dropped or damaged");
    }
    Ok(())
}
