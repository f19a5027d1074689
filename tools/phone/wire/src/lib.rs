//! The core of the page for a phone, as WebAssembly. It decodes messages to JSON in physical units, encodes requests, computes
//! the keys of records, the shapes of soles and the measures of walking, converts the times of insoles, counts lost frames,
//! detects lost records, and provides the constants of the protocol.
//!
//! The page calls plain WebAssembly exports and shares one buffer with them. A binding generator such as wasm-bindgen is not
//! used, because its command-line program would have to be installed in exactly the version of its crate. Messages are passed as
//! JSON. This takes some microseconds per message, and a step is the same object as in the files of the command line.
//!
//! The page's TypeScript types are in `tools/phone/src/generated`. A test of this crate checks that they are up to date;
//! `UPDATE_DOCS=1 cargo test --release --package phone-wire` rewrites them.

mod facts;
mod message;
mod sole;
#[cfg(test)]
mod typescript;

pub use message::decode_to_json;
pub use sole::{LayoutCell, RegionShape, Sole};

use client::gait::{FootStep, Gait, Length};
use client::{Arrival, ClockMapping, RecordOrder};
use phone_buffer::put;
use plantar::pipeline::alert::AlertRules;
use plantar::protocol::{LiveCounter, MAJOR, MAX_MESSAGE, MINOR, ToDevice, ToHost, decode as decode_message, encode};
use std::sync::{Mutex, PoisonError};

/// Encodes a request to the buffer and returns its length.
fn request(message: ToDevice) -> usize {
    let mut bytes = [0; MAX_MESSAGE];
    // Every request fits into the array, so the length is never 0.
    encode(&message, &mut bytes).map_or(0, |message| put(message))
}

/// Replaces the message in the buffer by its JSON and returns the length of the text. Returns 0 for bytes that are not a message
/// of this version, and for messages that the page does not use.
#[unsafe(no_mangle)]
pub extern "C" fn decode() -> usize {
    let json = phone_buffer::with(|buffer| decode_to_json(buffer));
    json.map_or(0, |json| put(json.as_bytes()))
}

/// Writes the constants of the protocol and the geometry of the sole to the buffer as JSON, and returns the length of the text.
#[unsafe(no_mangle)]
pub extern "C" fn facts() -> usize {
    put(facts::facts_to_json().as_bytes())
}

/// Replaces the list of an insole's cells in the buffer, a JSON array of [`LayoutCell`], by its [`Sole`] as JSON, and returns the
/// length of the text. Returns 0 for a list without cells, or with damaged ones.
#[unsafe(no_mangle)]
pub extern "C" fn sole() -> usize {
    let cells: Option<Vec<LayoutCell>> = phone_buffer::with(|buffer| serde_json::from_slice(buffer).ok());
    let sole = cells.and_then(|cells| serde_json::to_string(&Sole::of(&cells)?).ok());
    sole.map_or(0, |json| put(json.as_bytes()))
}

/// Encodes [`ToDevice::Connect`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn connect() -> usize {
    request(ToDevice::Connect { major: MAJOR, minor: MINOR })
}

/// Encodes [`ToDevice::Stream`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn stream(live: bool) -> usize {
    request(ToDevice::Stream { live })
}

/// Encodes [`ToDevice::StreamEllipses`] for the ellipses of one frame out of `every`, or of no frame for 0; returns the length of
/// the message.
#[unsafe(no_mangle)]
pub extern "C" fn stream_ellipses(every: u8) -> usize {
    request(ToDevice::StreamEllipses { every })
}

/// Encodes [`ToDevice::GetSetupCells`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn get_setup_cells(first: u16) -> usize {
    request(ToDevice::GetSetupCells { first })
}

/// Encodes [`ToDevice::Acknowledge`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn acknowledge(number: u32) -> usize {
    request(ToDevice::Acknowledge { number })
}

/// Encodes [`ToDevice::GetStatus`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn get_status() -> usize {
    request(ToDevice::GetStatus)
}

/// Encodes [`ToDevice::GetIdentified`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn get_identified() -> usize {
    request(ToDevice::GetIdentified)
}

/// Encodes [`ToDevice::GetAlertRules`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn get_alert_rules() -> usize {
    request(ToDevice::GetAlertRules)
}

/// Encodes [`ToDevice::SetAlertRules`], which turns alerts on or off; returns the length of the message. The buffer contains the
/// insole's message with its present rules; all values but the number of alerts in a day and the beginning of the day remain.
/// Alerts are off if their number in a day is 0; if it was 0, it becomes the recommended one when they are turned on. The
/// wearer's day begins `day_start_min` minutes after midnight UTC.
#[unsafe(no_mangle)]
pub extern "C" fn set_alerts(is_on: bool, day_start_min: u16) -> usize {
    let rules = match phone_buffer::with(|message| decode_message(message)) {
        Some(ToHost::AlertRules(rules)) => rules,
        _ => AlertRules::OFF,
    };
    let per_day = match is_on {
        true if rules.per_day == 0 => AlertRules::RECOMMENDED.per_day,
        true => rules.per_day,
        false => 0,
    };
    request(ToDevice::SetAlertRules(AlertRules { day_start_min, per_day, ..rules }))
}

/// Encodes [`ToDevice::GetDailyLoad`]; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn get_daily_load() -> usize {
    request(ToDevice::GetDailyLoad)
}

/// Encodes [`ToDevice::SnoozeAlerts`], after which no alerts are raised for `snoozed_s`; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn snooze_alerts(snoozed_s: u16) -> usize {
    request(ToDevice::SnoozeAlerts { snoozed_s })
}

/// Encodes [`ToDevice::GetTime`] with a time in us since 1970; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn get_time(unix_us: f64) -> usize {
    request(ToDevice::GetTime { host_us: unix_us as u64 })
}

/// Encodes [`ToDevice::SetClock`] with a time in us since 1970; returns the length of the message.
#[unsafe(no_mangle)]
pub extern "C" fn set_clock(unix_us: f64) -> usize {
    request(ToDevice::SetClock { unix_us: unix_us as u64 })
}

/// Number of insoles that can be connected at the same time.
const INSOLES: usize = 2;

/// The clock mappings of the connected insoles, followed by those of the insoles in a recording.
static CLOCK_MAPPINGS: Mutex<[ClockMapping; 2 * INSOLES]> = Mutex::new([const { ClockMapping::new() }; 2 * INSOLES]);

/// The counters of the live frames of the connected insoles.
static COUNTERS: Mutex<[LiveCounter; INSOLES]> = Mutex::new([LiveCounter::NEW; INSOLES]);

/// Calls `act` with the item at `index` and returns the result. If `index` is out of range, `act` receives a new item instead,
/// which is dropped afterwards.
fn with<const N: usize, I: Default, T>(items: &Mutex<[I; N]>, index: usize, act: impl FnOnce(&mut I) -> T) -> T {
    let mut items = items.lock().unwrap_or_else(PoisonError::into_inner);
    act(items.get_mut(index).unwrap_or(&mut I::default()))
}

/// Resets the clock mapping of an insole. `index` is 0 or 1 for the connected insoles, and 2 or 3 for the insoles in a recording.
#[unsafe(no_mangle)]
pub extern "C" fn clock_mapping_clear(index: usize) {
    with(&CLOCK_MAPPINGS, index, |mapping| *mapping = ClockMapping::new());
}

/// Adds an insole's answer to [`get_time`] to its clock mapping. `asked_us` is the time in the request, and `device_us` is the
/// time of the insole in its answer.
#[unsafe(no_mangle)]
pub extern "C" fn clock_mapping_answer(index: usize, asked_us: f64, device_us: f64) {
    with(&CLOCK_MAPPINGS, index, |mapping| mapping.answer(asked_us as u64, device_us as u64));
}

/// The time, us since 1970, at which an insole's clock showed `device_us`. NaN before the first answer.
#[unsafe(no_mangle)]
pub extern "C" fn clock_mapping_unix_us(index: usize, device_us: f64) -> f64 {
    with(&CLOCK_MAPPINGS, index, |mapping| mapping.host_us(device_us as u64).map_or(f64::NAN, |us| us as f64))
}

/// See [`ClockMapping::is_comparable`].
#[unsafe(no_mangle)]
pub extern "C" fn clock_mapping_is_comparable(index: usize, device_us: f64) -> bool {
    with(&CLOCK_MAPPINGS, index, |mapping| mapping.is_comparable(device_us as u64))
}

/// See [`client::are_feet_comparable`].
#[unsafe(no_mangle)]
pub extern "C" fn are_feet_comparable(comparable: usize, steps: usize) -> bool {
    client::are_feet_comparable(comparable, steps)
}

/// Resets the counter of the live frames of an insole.
#[unsafe(no_mangle)]
pub extern "C" fn counter_clear(index: usize) {
    with(&COUNTERS, index, |counter| *counter = LiveCounter::NEW);
}

/// See [`LiveCounter::new_session`].
#[unsafe(no_mangle)]
pub extern "C" fn counter_new_session(index: usize) {
    with(&COUNTERS, index, LiveCounter::new_session);
}

/// See [`LiveCounter::frame`].
#[unsafe(no_mangle)]
pub extern "C" fn counter_frame(index: usize, sequence: u32) {
    with(&COUNTERS, index, |counter| counter.frame(sequence));
}

/// See [`LiveCounter::due`].
#[unsafe(no_mangle)]
pub extern "C" fn counter_due(index: usize, live_due: u32) {
    with(&COUNTERS, index, |counter| counter.due(live_due));
}

/// [`LiveCounter::received`] as a floating-point number, because JavaScript interprets a 32-bit integer as signed.
#[unsafe(no_mangle)]
pub extern "C" fn counter_received(index: usize) -> f64 {
    with(&COUNTERS, index, |counter| counter.received.into())
}

/// [`LiveCounter::lost`] as a floating-point number, for the same reason as [`counter_received`].
#[unsafe(no_mangle)]
pub extern "C" fn counter_lost(index: usize) -> f64 {
    with(&COUNTERS, index, |counter| counter.lost.into())
}

/// The orders of the records of the connected insoles.
static ORDERS: Mutex<[RecordOrder; INSOLES]> = Mutex::new([RecordOrder::NEW; INSOLES]);

/// True if the record with this number, which has not arrived before, can be used. Otherwise records before it are missing, and
/// the insole must first send all its unacknowledged records again: see [`order_is_retransmission_due`]. `damaged` is the number
/// of damaged messages that have arrived.
#[unsafe(no_mangle)]
pub extern "C" fn order_accepts(index: usize, number: u32, damaged: u32) -> bool {
    with(&ORDERS, index, |order| match order.arrive(number, damaged) {
        Arrival::InOrder => true,
        Arrival::Gap => {
            // The time of the request is not used, because the page repeats the request by its own clock.
            order.request(0, damaged);
            false
        }
        Arrival::Awaited => false,
    })
}

/// See [`RecordOrder::repeat`].
#[unsafe(no_mangle)]
pub extern "C" fn order_repeat(index: usize, number: u32) {
    with(&ORDERS, index, |order| order.repeat(number));
}

/// True from the detection of a gap until [`order_begin`]: the page must send the message of [`connect`] again.
#[unsafe(no_mangle)]
pub extern "C" fn order_is_retransmission_due(index: usize) -> bool {
    with(&ORDERS, index, |order| order.requested_us().is_some())
}

/// See [`RecordOrder::begin`].
#[unsafe(no_mangle)]
pub extern "C" fn order_begin(index: usize) {
    with(&ORDERS, index, |order| order.begin());
}

/// See [`RecordOrder::interrupt`].
#[unsafe(no_mangle)]
pub extern "C" fn order_interrupt(index: usize) {
    with(&ORDERS, index, RecordOrder::interrupt);
}

/// The steps of the left and of the right foot for [`gait_measures`].
static GAIT_STEPS: Mutex<[Vec<FootStep>; 2]> = Mutex::new([Vec::new(), Vec::new()]);

/// Adds a step for [`gait_measures`]. `foot` is 0 for the left and 1 for the right foot. `number` counts the steps of the foot,
/// without its other records, `start_s` is the time of the heel strike, `duration_s` is the stance time, `peak_n` is the peak of
/// the total force, and `integral_n_s` is the time integral of the total force.
#[unsafe(no_mangle)]
pub extern "C" fn gait_step(foot: usize, number: u32, start_s: f64, duration_s: f64, peak_n: f64, integral_n_s: f64) {
    with(&GAIT_STEPS, foot, |steps| steps.push(FootStep { number, start_s, duration_s, peak_n, integral_n_s }));
}

/// Writes to the buffer, as JSON, the measures of the steps that were added since the last call. Returns the length of the text.
/// `has_common_clock` states whether the times of both feet are on one clock. `stride_m` is the mean length of a stride; 0 if it
/// is unknown.
#[unsafe(no_mangle)]
pub extern "C" fn gait_measures(has_common_clock: bool, stride_m: f64) -> usize {
    let steps = std::mem::take(&mut *GAIT_STEPS.lock().unwrap_or_else(PoisonError::into_inner));
    let length = (stride_m > 0.0).then_some(Length::Stride(stride_m));
    put(Gait::new(steps, has_common_clock).to_json(length).to_string().as_bytes())
}
