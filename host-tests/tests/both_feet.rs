//! Two insoles over Bluetooth in real time: every step arrives, and every lost live frame is counted. The age of the messages and
//! the error of the clocks are printed and not checked, because they depend on the host machine as much as on the insoles.
//!
//! `cargo xtask test` runs at most one other test beside this one, because more of them would disturb the walk.

use crate::common::{firmware, tissue};
use crate::phones::{Phone, RadioSimulation, boot};
use client::ClockMapping;
use emulator::{Recorded, Scan, Time, Walk};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Live, LoadRecord, Status, Step, ToDevice, ToHost};
use recording::{VirtualInsole, synthetic};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Number of steps of each foot: a minute of walking.
const STEPS: usize = 58;
/// Number of messages between two requests for the insole's time: a prime number, so that the requests have no fixed relation to
/// the frames.
const REQUEST_INTERVAL: u32 = 17;
/// Number of messages after the status within which all steps that it counts must arrive: as many as the live frames of 30 s. On
/// a busy computer, steps arrive seconds after the frames.
const LAST_STEPS_WITHIN: usize = 3_000;

/// A walk that begins on command, and records the time of each scan.
struct DelayedWalk {
    walk: Recorded,
    is_started: Arc<AtomicBool>,
    /// Number of the first scan of the walk.
    first: Option<u32>,
    /// The time of each scan.
    scanned: Arc<Mutex<Vec<Instant>>>,
}

impl Walk for DelayedWalk {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        let mut scanned = self.scanned.lock().unwrap_or_else(PoisonError::into_inner);
        // A scan that the emulator skipped has the time of the next one.
        scanned.resize(seq as usize + 1, Instant::now());
        if self.first.is_none() && self.is_started.load(Ordering::Relaxed) {
            self.first = Some(seq);
        }
        // The walk begins and ends without load.
        let walk_scan = self.first.map_or(0, |first| (seq - first).min(self.walk.scans() - 1));
        self.walk.scan(walk_scan, codes)
    }
}

/// A foot, and the messages that its phone received.
struct Foot {
    phone: Phone,
    /// The time of each scan.
    scanned: Arc<Mutex<Vec<Instant>>>,
    period_us: u32,
    /// The live frames, and the times at which they arrived.
    live: Vec<(Instant, Live)>,
    /// Numbers of the records.
    numbers: Vec<u32>,
    /// The steps, and the times at which they arrived.
    steps: Vec<(Instant, Step)>,
    /// Converts the insole's time to the time since the start of the test.
    mapping: ClockMapping,
}

fn us_since(start: Instant, at: Instant) -> i64 {
    at.duration_since(start).as_micros() as i64
}

impl Foot {
    /// Receives a message; returns it if it is a status.
    fn receive(&mut self, radio: &mut RadioSimulation) -> Option<Status> {
        let (arrival, message) = self.phone.next_with_arrival(radio);
        match message {
            ToHost::Live(live) => self.live.push((arrival, live)),
            ToHost::Time { host_us, device_us } => self.mapping.answer(host_us, device_us),
            ToHost::Status(status) => return Some(status),
            other => {
                let record = LoadRecord::of(&other).unwrap_or_else(|| panic!("{other:?}"));
                self.phone.send(radio, ToDevice::Acknowledge { number: record.number() });
                self.numbers.push(record.number());
                self.steps.extend(record.step().map(|step| (arrival, *step)));
            }
        }
        None
    }

    /// Age of a message at its `arrival`, ms. The message belongs to the scan at the insole's time `t_us`.
    fn age_ms(&self, arrival: Instant, t_us: u64) -> f64 {
        let scanned = self.scanned.lock().unwrap_or_else(PoisonError::into_inner);
        let scan = t_us / u64::from(self.period_us);
        arrival.duration_since(scanned[scan as usize]).as_secs_f64() * 1e3
    }

    /// True offset of the insole's time from the time since `start`, us. Each scan takes place at its nominal time or later, so
    /// that the offset is the largest difference.
    fn true_offset_us(&self, start: Instant) -> i64 {
        let scanned = self.scanned.lock().unwrap_or_else(PoisonError::into_inner);
        let offset_us = |(scan, &at): (usize, &Instant)| {
            let (early, late) = (start.saturating_duration_since(at), at.saturating_duration_since(start));
            scan as i64 * i64::from(self.period_us) + early.as_micros() as i64 - late.as_micros() as i64
        };
        scanned.iter().enumerate().map(offset_us).max().expect("the insole scans")
    }
}

/// The median and the largest value.
fn median_and_maximum(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    (values[values.len() / 2], values[values.len() - 1])
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn both_feet_stream_a_minute_in_real_time() {
    let firmware = firmware();
    let mut radio = RadioSimulation::start();
    let start = Instant::now();
    let is_started = Arc::<AtomicBool>::default();
    let mut boards = Vec::new();
    let mut scans = 0;
    let mut feet = [(Side::Left, "Plantar L"), (Side::Right, "Plantar R")].map(|(side, name)| {
        let walk = synthetic::SyntheticWalk { steps: STEPS, side, rate_hz: 100.0, ..Default::default() };
        let recording = synthetic::walk(&walk).recording;
        let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let scanned = Arc::<Mutex<Vec<Instant>>>::default();
        let walk = Recorded::new(recording, virtual_insole.clone());
        scans = walk.scans();
        let walk = DelayedWalk { walk, is_started: is_started.clone(), first: None, scanned: scanned.clone() };
        boards.push(boot(&mut radio, &firmware, &virtual_insole, Time::Real, walk, |_| {}, None));
        let mut phone = radio.bonded_phone(boards.len() as u8, name, 247);
        phone.set_tissue(&mut radio, tissue());
        let period_us = virtual_insole.setup.period_us;
        let mapping = ClockMapping::new();
        Foot { phone, scanned, period_us, live: Vec::new(), numbers: Vec::new(), steps: Vec::new(), mapping }
    });
    for foot in &mut feet {
        foot.phone.send(&mut radio, ToDevice::Stream { live: true });
    }
    is_started.store(true, Ordering::Relaxed);
    let mut turn = 0;
    while feet.iter().any(|foot| foot.live.last().is_none_or(|(_, live)| live.sequence < scans)) {
        for foot in &mut feet {
            if turn % REQUEST_INTERVAL == 0 {
                let host_us = us_since(start, Instant::now()) as u64;
                foot.phone.send(&mut radio, ToDevice::GetTime { host_us });
            }
            foot.receive(&mut radio);
        }
        turn += 1;
    }
    for (foot, side) in feet.iter_mut().zip(["left", "right"]) {
        foot.phone.send(&mut radio, ToDevice::GetStatus);
        let status = std::iter::repeat_with(|| foot.receive(&mut radio)).find_map(|status| status);
        let status = status.expect("the insole answers");
        assert_eq!(foot.live.len() as u32, status.live_sent, "every frame that was sent must arrive");
        assert!(foot.live.windows(2).all(|pair| pair[0].1.sequence < pair[1].1.sequence));
        let last = foot.live.last().map(|(_, live)| live.sequence);
        assert!(last < Some(status.live_due), "the last frame must be counted as due: {last:?}, {status:?}");
        for _ in 0..LAST_STEPS_WITHIN {
            if foot.steps.len() as u32 >= status.steps {
                break;
            }
            foot.receive(&mut radio);
        }
        let records = foot.numbers.len() as u32;
        assert!(foot.numbers.iter().copied().eq(0..records), "every record must arrive once, in order");
        assert_eq!(foot.steps.len() as u32, status.steps, "every step must arrive");
        assert_eq!((status.records_dropped, status.bad_frames), (0, 0));
        // The emulated board misses scans if the host is busy. A stance with too many missed scans is rejected as a step, and
        // counted.
        assert_eq!(status.steps + status.rejected.broken, STEPS as u32);

        let live_ms = foot.live.iter().map(|(arrival, live)| foot.age_ms(*arrival, live.t_us));
        let toe_off_us = |step: &Step| step.start_us + u64::from(step.duration_us);
        let step_ms = foot.steps.iter().map(|(arrival, step)| foot.age_ms(*arrival, toe_off_us(step)));
        let ((live_ms, live_most_ms), (step_ms, step_most_ms)) =
            (median_and_maximum(live_ms.collect()), median_and_maximum(step_ms.collect()));
        let seconds = foot.live[foot.live.len() - 1].0.duration_since(foot.live[0].0).as_secs_f64();
        println!(
            "{side}: {} of {} live frames, {:.1} a second for {seconds:.0} s, and {} steps",
            status.live_sent,
            status.live_due,
            foot.live.len() as f64 / seconds,
            foot.steps.len()
        );
        println!(
            "{side}: median age on arrival: live frame {live_ms:.0} ms (at most {live_most_ms:.0}), step after toe off \
             {step_ms:.0} ms (at most {step_most_ms:.0})"
        );
    }
    // A phone cannot determine these errors itself, because it does not know when the insole scans.
    let errors_us = feet.each_ref().map(|foot| {
        let (_, last) = foot.live[foot.live.len() - 1];
        let found_us = foot.mapping.host_us(last.t_us).expect("the mapping has answers") as i64;
        let error_us = found_us - (last.t_us as i64 - foot.true_offset_us(start));
        println!("error of a foot's converted time, due to the delay of its requests: {error_us} us");
        error_us
    });
    println!("difference of the two errors: {} us", errors_us[0] - errors_us[1]);
}
