//! Turns frames into live messages, steps, load bouts and alerts.

use super::DeviceInsole;
use super::board::Stopwatch;
use super::scan::Frame;
use super::shared::Shared;
use crate::faults::Faults;
use crate::insole::NotLifted;
use crate::log;
use crate::pipeline::step::RegionStep;
use crate::protocol::session::ToInsole;
use crate::protocol::{Alert, Bout, ContactEllipse, Ellipses, Live, LoadRecord, Refusal, Step};
use core::sync::atomic::Ordering;
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::Receiver;

/// Time without load after which the insole counts as not worn, s.
const UNWORN_AFTER_S: u32 = 60;

/// Number of scans in a second while the insole is not worn. With one, all scans of a walk with strides of a second could meet
/// swings. With two, one of three successive scans meets a stance, if strides take 0.63 to 2 s and stances 60 % of them.
const UNWORN_SCANS_PER_S: u32 = 2;

/// Processes frames. Never returns.
pub async fn process<S: Stopwatch>(
    insole: &mut DeviceInsole,
    mut frames: Receiver<'_, CriticalSectionRawMutex, Frame>,
    shared: &Shared,
    stopwatch: S,
) -> ! {
    loop {
        let frame = frames.receive().await;
        adopt_tissue(insole, shared);
        let start = stopwatch.start();
        let seq = frame.seq;
        let is_toe_off = evaluate_frame(insole, shared, seq, &frame.codes);
        let cycles = stopwatch.cycles_since(start);
        frames.receive_done();
        if !shared.scan.is_worn() && insole.is_loaded() {
            set_scan_interval(shared, 1);
        }
        let ellipses_due = shared.session.borrow_mut().ellipses.due();
        if let Some(sequence) = ellipses_due {
            push_ellipses(insole, shared, sequence, insole.time_us(seq));
        }
        shared.frame_us.set(insole.time_us(seq));
        {
            let mut counters = shared.counters.borrow_mut();
            if insole.on_ground() {
                let (least, most) = counters.frame_cycles;
                counters.frame_cycles = (least.min(cycles), most.max(cycles));
            }
            counters.rejected = insole.rejected();
            counters.add_processing(cycles, S::CYCLES_PER_MS);
        }
        report_faults(insole.faults(), shared);
        if is_toe_off {
            complete_step(insole, shared, || stopwatch.cycles_since(start)).await;
        }
        if let Some(bout) = insole.take_bout() {
            let start_unix_us = shared.session.borrow().unix_us(bout.start_us);
            log::info!("process: load bout {} is {}", bout.number, bout.kind.name());
            queue(shared, Bout { start_unix_us, ..Bout::new(&bout) }.into());
        }
        if insole.has_ended_second() {
            end_second(insole, shared);
        }
        shared.scan.heartbeats.frame_processed();
        shared.signal_changed();
        // The link can run here, even while further frames are queued.
        yield_now().await;
    }
}

/// Computes and queues the ellipses of the last frame.
#[cold]
#[inline(never)]
fn push_ellipses(insole: &DeviceInsole, shared: &Shared, sequence: u32, t_us: u64) {
    let regions = core::array::from_fn(|region| ContactEllipse::new(insole.ellipse(region)));
    shared.session.borrow_mut().ellipses.push(Ellipses { sequence, t_us, regions });
}

/// Evaluates a frame, and queues its live message and its cells. True at toe off.
///
/// This function, [`evaluate_region`] and [`assemble_step`] are not generic. So they are compiled with this library, which is
/// optimised for speed on most boards, and not with the board's package, which is optimised for size.
#[inline(never)]
fn evaluate_frame(insole: &mut DeviceInsole, shared: &Shared, seq: u32, codes: &[u16]) -> bool {
    let is_toe_off = insole.frame(seq, codes);
    let mut session = shared.session.borrow_mut();
    if let Some(sequence) = session.next_live() {
        let live = Live::new(sequence, insole.time_us(seq), insole.loads(), insole.masked(), insole.foot_centre_mm());
        session.push_live(live);
    }
    session.push_cells(seq, codes.get(..insole.cells()).unwrap_or_default());
    is_toe_off
}

/// Evaluates a region of the step that just ended.
#[inline(never)]
fn evaluate_region(insole: &DeviceInsole, region: usize) -> RegionStep<f32> {
    insole.step_region(region)
}

/// Adapts the parameters to the step that just ended, and assembles its record.
#[inline(never)]
fn assemble_step(insole: &mut DeviceInsole, regions: [RegionStep<f32>; 8]) -> Option<Step> {
    insole.step(regions).map(|step| Step::new(&step))
}

/// Passes newly detected faults of the sensor to the session.
fn report_faults(faults: &Faults, shared: &Shared) {
    let new = shared.session.borrow_mut().set_faults(faults);
    let known = faults.found.saturating_sub(new) as usize;
    for fault in faults.list.iter().skip(known) {
        log::warn!("fault: {} {}", fault.kind, fault.place);
    }
}

/// Puts new parameters in force from this frame on, once the session has announced them.
fn adopt_tissue(insole: &mut DeviceInsole, shared: &Shared) {
    let mut session = shared.session.borrow_mut();
    if let Some(tissue) = session.take_tissue_due() {
        // This cannot fail: the session has applied the same check before it accepted the parameters.
        let _ = insole.set_tissue(tissue);
        insole.track(session.tracked_regions());
        log::info!("settings: parameters {:x} are in force", insole.tissue_id());
    }
}

/// Sets the number of frames from one scan to the next; 1 scans every frame.
#[cold]
fn set_scan_interval(shared: &Shared, interval: u32) {
    if shared.scan.interval.swap(interval, Ordering::Relaxed) != interval {
        log::info!("scan: one of every {} frames", interval);
    }
}

/// Executes the requests of hosts that concern alerts and baselines, publishes the load of the day, queues an alert that was
/// raised, and determines whether the insole is worn. A request takes effect within a second.
#[cold]
#[inline(never)]
fn end_second(insole: &mut DeviceInsole, shared: &Shared) {
    let mut session = shared.session.borrow_mut();
    let ToInsole { rules, snooze_s, is_load_awaited, zero } = session.take_to_insole();
    let zeroed = insole.take_zero();
    if zero {
        // An outcome at this time is that of an earlier request, for which the host does not wait any more. It is discarded.
        insole.request_zero();
    } else if let Some(outcome) = zeroed {
        session.answer_zero(outcome.map_err(|NotLifted| Refusal::NotLifted));
    }
    if let Some(rules) = rules {
        insole.set_alert_rules(&rules);
    }
    if let Some(snooze_s) = snooze_s {
        insole.snooze_alerts(snooze_s);
    }
    let sends_cells = session.streams_cells() && !shared.is_host_silent();
    let is_worn = insole.unloaded_s() < UNWORN_AFTER_S || sends_cells || insole.is_zero_requested();
    set_scan_interval(shared, if is_worn { 1 } else { insole.second_frames() / UNWORN_SCANS_PER_S });
    if let Some(unix_us) = session.unix_us(shared.frame_us.get()) {
        insole.enter_day(unix_us);
    }
    session.set_daily_load(insole.daily_load(), is_load_awaited);
    // With a full queue, the alert waits for the next second.
    if !shared.records.is_full()
        && let Some(alert) = insole.take_alert()
    {
        let start_unix_us = session.unix_us(alert.start_us);
        drop(session);
        log::info!(
            "process: alert {}, regions under sustained load {:x}, by dose {:x}",
            alert.number,
            alert.sustained,
            alert.dose
        );
        queue(shared, Alert { start_unix_us, ..Alert::new(&alert) }.into());
    }
}

/// Evaluates the step that just ended, and queues it to be stored. Other tasks can run between the evaluations of two regions.
/// `cycles` reads the board's cycle counter; the number of cycles in the log is invalid if the counter wrapped in a measurement.
async fn complete_step(insole: &mut DeviceInsole, shared: &Shared, cycles: impl Fn() -> u32) {
    let mut regions = [RegionStep::default(); 8];
    let mut region_cycles = [0; 8];
    for (region, (step, used)) in regions.iter_mut().zip(&mut region_cycles).enumerate() {
        let before = cycles();
        *step = evaluate_region(insole, region);
        *used = cycles().wrapping_sub(before);
        yield_now().await;
    }
    let before = cycles();
    let Some(step) = assemble_step(insole, regions) else { return };
    let used = cycles().wrapping_sub(before);
    log::info!("process: step {}: {} cycles for each region, {} for the record", step.step, region_cycles, used);
    let start_unix_us = shared.session.borrow().unix_us(step.start_us);
    queue(shared, Step { start_unix_us, ..step }.into());
    let mut cadence = shared.cadence.get();
    cadence.step(step.start_us, step.duration_us);
    shared.cadence.set(cadence);
    shared.counters.borrow_mut().steps += 1;
}

/// Queues a record to be stored. Must be called before the frame that completed it counts as processed.
fn queue(shared: &Shared, record: LoadRecord) {
    let frames_before = shared.frames_before.get().unwrap_or(shared.scan.heartbeats.processed());
    shared.frames_before.set(Some(frames_before));
    if shared.records.try_send(record).is_err() {
        log::warn!("storage: record {} was dropped before it could be stored", record.number());
        shared.session.borrow_mut().count_dropped(1);
    }
    shared.to_persist.signal(());
}
