//! Both feet over Bluetooth in real time: nothing is lost silently, every step arrives. How old messages are when they arrive, and how
//! well the feet's clocks are known, is printed and not judged: it is the machine's as much as the insole's.
//!
//! Alone in its file, because other tests beside it would be measured too.

mod common;
mod phones;

use client::Axis;
use common::{firmware, tissue};
use emulator::{Recorded, Scan, Time, Walk};
use phones::{Air, Phone, boot};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::protocol::{Live, Status, Step, ToDevice, ToHost};
use recording::{VirtualInsole, synthetic};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// A minute of walking.
const STEPS: usize = 58;
/// Messages between two questions for the time: no multiple of the frames' rhythm.
const ASK_EVERY: u32 = 17;

/// Stands until it is told to walk, and notes when it was asked for each scan.
struct Standing {
    walk: Recorded,
    go: Arc<AtomicBool>,
    first: Option<u32>,
    scanned: Arc<Mutex<Vec<Instant>>>,
}

impl Walk for Standing {
    fn scans(&self) -> u32 {
        u32::MAX
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        let mut scanned = self.scanned.lock().unwrap_or_else(PoisonError::into_inner);
        // A scan that was left out has the time of the next.
        scanned.resize(seq as usize + 1, Instant::now());
        if self.first.is_none() && self.go.load(Ordering::Relaxed) {
            self.first = Some(seq);
        }
        // The walk begins and ends without load.
        let at = self.first.map_or(0, |first| (seq - first).min(self.walk.scans() - 1));
        self.walk.scan(at, codes)
    }
}

/// A foot and what its phone got.
struct Foot {
    phone: Phone,
    scanned: Arc<Mutex<Vec<Instant>>>,
    period_us: u32,
    live: Vec<(Instant, Live)>,
    steps: Vec<(Instant, Step)>,
    /// The insole's clock against the time since `start`.
    axis: Axis,
}

fn us_since(start: Instant, at: Instant) -> i64 {
    at.duration_since(start).as_micros() as i64
}

impl Foot {
    /// Takes the next message; the insole's counters, where it is those.
    fn take(&mut self, air: &mut Air) -> Option<Status> {
        let (at, message) = self.phone.next_at(air);
        match message {
            ToHost::Live(live) => self.live.push((at, live)),
            ToHost::Step(step) => {
                self.phone.send(air, ToDevice::Acknowledge { step: step.step });
                self.steps.push((at, step));
            }
            ToHost::Time { host_us, device_us } => self.axis.answer(host_us, device_us),
            ToHost::Status(status) => return Some(status),
            other => panic!("{other:?}"),
        }
        None
    }

    /// Age of what came at `at` and tells of the scan at `t_us`, ms.
    fn age_ms(&self, at: Instant, t_us: u64) -> f64 {
        let scanned = self.scanned.lock().unwrap_or_else(PoisonError::into_inner);
        let scan = t_us / u64::from(self.period_us);
        at.duration_since(scanned[scan as usize]).as_secs_f64() * 1e3
    }

    /// What the clock is ahead of `start` as the matrix saw it, us: a scan is asked for at its time, or a little later.
    fn true_ahead_us(&self, start: Instant) -> i64 {
        let scanned = self.scanned.lock().unwrap_or_else(PoisonError::into_inner);
        let ahead_us = |(scan, &at): (usize, &Instant)| {
            let (early, late) = (start.saturating_duration_since(at), at.saturating_duration_since(start));
            scan as i64 * i64::from(self.period_us) + early.as_micros() as i64 - late.as_micros() as i64
        };
        scanned.iter().enumerate().map(ahead_us).max().expect("it scans")
    }
}

/// The median and the largest.
fn spread(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    (values[values.len() / 2], values[values.len() - 1])
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble: cargo xtask test"]
fn both_feet_stream_a_minute_in_real_time() {
    let firmware = firmware();
    let mut air = Air::start();
    let start = Instant::now();
    let go = Arc::<AtomicBool>::default();
    let mut boards = Vec::new();
    let mut scans = 0;
    let mut feet = [(Side::Left, "Plantar L"), (Side::Right, "Plantar R")].map(|(side, name)| {
        let walk = synthetic::SyntheticWalk { steps: STEPS, side, rate_hz: 100.0, ..Default::default() };
        let recording = synthetic::walk(&walk).recording;
        let worn = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
        let scanned = Arc::<Mutex<Vec<Instant>>>::default();
        let walk = Recorded::new(recording, worn.clone());
        scans = walk.scans();
        let standing = Standing { walk, go: go.clone(), first: None, scanned: scanned.clone() };
        boards.push(boot(&mut air, &firmware, &worn, Time::Real, standing, |_| {}, None));
        let mut phone = air.bonded_phone(boards.len() as u8, name, 247);
        phone.set_tissue(&mut air, tissue());
        let period_us = worn.setup.period_us;
        Foot { phone, scanned, period_us, live: Vec::new(), steps: Vec::new(), axis: Axis::new() }
    });
    for foot in &mut feet {
        foot.phone.send(&mut air, ToDevice::Stream { live: true });
    }
    go.store(true, Ordering::Relaxed);
    let mut turn = 0;
    while feet.iter().any(|foot| foot.live.last().is_none_or(|(_, live)| live.sequence < scans)) {
        for foot in &mut feet {
            if turn % ASK_EVERY == 0 {
                let host_us = us_since(start, Instant::now()) as u64;
                foot.phone.send(&mut air, ToDevice::GetTime { host_us });
            }
            foot.take(&mut air);
        }
        turn += 1;
    }
    for (foot, side) in feet.iter_mut().zip(["left", "right"]) {
        foot.phone.send(&mut air, ToDevice::GetStatus);
        let status = std::iter::repeat_with(|| foot.take(&mut air)).find_map(|status| status);
        let status = status.expect("the phone waits for it");
        assert_eq!(foot.live.len() as u32, status.live_sent, "what was sent arrives");
        assert!(foot.live.windows(2).all(|two| two[0].1.sequence < two[1].1.sequence));
        assert!(foot.steps.iter().map(|(_, step)| step.step).eq(0..status.steps), "every step, once, in order");
        assert_eq!((status.steps_dropped, status.bad_frames), (0, 0));
        // A busy host costs the emulated board scans, and too many a step, which is counted.
        assert_eq!(status.steps + status.rejected.broken, STEPS as u32);

        let live_ms = foot.live.iter().map(|(at, live)| foot.age_ms(*at, live.t_us));
        let toe_off_us = |step: &Step| step.start_us + u64::from(step.duration_us);
        let step_ms = foot.steps.iter().map(|(at, step)| foot.age_ms(*at, toe_off_us(step)));
        let ((live_ms, live_most_ms), (step_ms, step_most_ms)) = (spread(live_ms.collect()), spread(step_ms.collect()));
        let seconds = foot.live[foot.live.len() - 1].0.duration_since(foot.live[0].0).as_secs_f64();
        println!(
            "{side}: {} of {} live frames, {:.1} a second for {seconds:.0} s, and {} steps",
            status.live_sent,
            status.live_due,
            foot.live.len() as f64 / seconds,
            foot.steps.len()
        );
        println!(
            "{side}: a live frame is {live_ms:.0} ms old (at most {live_most_ms:.0}), a step {step_ms:.0} ms after toe off (at \
             most {step_most_ms:.0})"
        );
    }
    // What the phones cannot know: how far off they are.
    let errors_us = feet.each_ref().map(|foot| {
        let (_, last) = foot.live[foot.live.len() - 1];
        let found_us = foot.axis.host_us(last.t_us).expect("answered") as i64;
        let error_us = found_us - (last.t_us as i64 - foot.true_ahead_us(start));
        println!("a foot's clock is off by {error_us} us: the way of its quickest question");
        error_us
    });
    println!("one foot against the other: off by {} us", errors_us[0] - errors_us[1]);
}
