//! Turns frames into live messages and steps.

use super::DeviceInsole;
use super::board::Stopwatch;
use super::scan::Frame;
use super::shared::Shared;
use crate::faults::Faults;
use crate::log;
use crate::pipeline::step::RegionStep;
use crate::protocol::{Bout, ContactEllipse, Ellipses, Live, LoadRecord, Step};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::Receiver;

/// Processes frames. Never returns.
pub async fn process(
    insole: &mut DeviceInsole,
    mut frames: Receiver<'_, CriticalSectionRawMutex, Frame>,
    shared: &Shared,
    stopwatch: impl Stopwatch,
) -> ! {
    let period_us = insole.setup().map_or(0, |setup| u64::from(setup.period_us));
    loop {
        let frame = frames.receive().await;
        adopt_tissue(insole, shared);
        let start = stopwatch.start();
        let seq = frame.seq;
        let is_toe_off = insole.frame(seq, &frame.codes);
        {
            let mut session = shared.session.borrow_mut();
            if let Some(sequence) = session.next_live() {
                let t_us = u64::from(seq) * period_us;
                let live = Live::new(sequence, t_us, insole.loads(), insole.masked(), insole.foot_centre_mm());
                session.push_live(live);
            }
            session.push_cells(seq, frame.codes.get(..insole.cells()).unwrap_or_default());
        }
        let cycles = stopwatch.cycles_since(start);
        frames.receive_done();
        let ellipses_due = shared.session.borrow_mut().ellipses.due();
        if let Some(sequence) = ellipses_due {
            push_ellipses(insole, shared, sequence, u64::from(seq) * period_us);
        }
        shared.frame_us.set(u64::from(seq) * period_us);
        {
            let mut counters = shared.counters.borrow_mut();
            if insole.on_ground() {
                let (least, most) = counters.frame_cycles;
                counters.frame_cycles = (least.min(cycles), most.max(cycles));
            }
            counters.rejected = insole.rejected();
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
    let session = shared.session.borrow();
    if let Some(tissue) = session.tissue_due().filter(|tissue| tissue.id != insole.tissue_id()) {
        // This cannot fail: the session has applied the same check before it accepted the parameters.
        let _ = insole.set_tissue(tissue);
        if session.is_identified() {
            insole.track();
        }
        log::info!("settings: parameters {:x} are in force", tissue.id);
    }
}

/// Evaluates the step that just ended, and queues it to be stored. Other tasks can run between the evaluations of two regions.
/// `cycles` reads the board's cycle counter; the number of cycles in the log is invalid if the counter wrapped in a measurement.
async fn complete_step(insole: &mut DeviceInsole, shared: &Shared, cycles: impl Fn() -> u32) {
    let mut regions = [RegionStep::default(); 8];
    let mut region_cycles = [0; 8];
    for (region, (step, used)) in regions.iter_mut().zip(&mut region_cycles).enumerate() {
        let before = cycles();
        *step = insole.step_region(region);
        *used = cycles().wrapping_sub(before);
        yield_now().await;
    }
    let before = cycles();
    let Some(step) = insole.step(regions) else { return };
    let used = cycles().wrapping_sub(before);
    log::info!("process: step {} was evaluated in {} cycles by region, and {} cycles", step.step, region_cycles, used);
    let start_unix_us = shared.session.borrow().unix_us(step.start_us);
    queue(shared, Step { start_unix_us, ..Step::new(&step) }.into());
    let mut cadence = shared.cadence.get();
    cadence.step(step.start_us);
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
