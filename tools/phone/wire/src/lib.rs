//! The wire messages for the page on a phone: bytes to JSON in physical units, requests to bytes.
//!
//! The page calls plain WebAssembly exports and shares one buffer with them. That needs no binding generator, whose
//! command line would have to be installed in the version of its crate; JSON costs some microseconds a message, and a
//! step is the same object here as from the command line.

mod message;
mod sole;

pub use message::decode_to_json;
pub use sole::{REGION_COUNT, RegionShape, outline_mm, region_shapes};

use client::Axis;
use plantar::Region;
use plantar::protocol::session::STEP_QUEUE;
use plantar::protocol::{MAJOR, MAX_MESSAGE, MINOR, ToDevice, encode};
use serde_json::json;
use std::sync::{Mutex, PoisonError};

/// What goes in and what comes out.
static BUFFER: Mutex<Vec<u8>> = Mutex::new(Vec::new());

/// Replaces the buffer's content; returns its length.
fn put(bytes: &[u8]) -> usize {
    let mut buffer = BUFFER.lock().unwrap_or_else(PoisonError::into_inner);
    buffer.clear();
    buffer.extend_from_slice(bytes);
    buffer.len()
}

fn request(message: ToDevice) -> usize {
    let mut bytes = [0; MAX_MESSAGE];
    // Every message fits; nothing is what the page would see otherwise.
    encode(&message, &mut bytes).map_or(0, |message| put(message))
}

/// Makes room for so many bytes; returns where the page writes them.
#[unsafe(no_mangle)]
pub extern "C" fn room(len: usize) -> *mut u8 {
    let mut buffer = BUFFER.lock().unwrap_or_else(PoisonError::into_inner);
    buffer.resize(len, 0);
    buffer.as_mut_ptr()
}

/// Where the page reads results.
#[unsafe(no_mangle)]
pub extern "C" fn result() -> *const u8 {
    BUFFER.lock().unwrap_or_else(PoisonError::into_inner).as_ptr()
}

/// The message in the buffer as JSON; length of the text, 0 where it is no message of this version.
#[unsafe(no_mangle)]
pub extern "C" fn decode() -> usize {
    let bytes = BUFFER.lock().unwrap_or_else(PoisonError::into_inner).clone();
    decode_to_json(&bytes).map_or(0, |value| put(value.to_string().as_bytes()))
}

/// [`ToDevice::Connect`].
#[unsafe(no_mangle)]
pub extern "C" fn connect() -> usize {
    request(ToDevice::Connect { major: MAJOR, minor: MINOR })
}

/// [`ToDevice::Stream`].
#[unsafe(no_mangle)]
pub extern "C" fn stream(live: bool) -> usize {
    request(ToDevice::Stream { live })
}

/// [`ToDevice::Acknowledge`].
#[unsafe(no_mangle)]
pub extern "C" fn acknowledge(step: u32) -> usize {
    request(ToDevice::Acknowledge { step })
}

/// [`ToDevice::GetStatus`].
#[unsafe(no_mangle)]
pub extern "C" fn get_status() -> usize {
    request(ToDevice::GetStatus)
}

/// [`ToDevice::GetTime`], us since 1970.
#[unsafe(no_mangle)]
pub extern "C" fn get_time(unix_us: f64) -> usize {
    request(ToDevice::GetTime { host_us: unix_us as u64 })
}

/// [`ToDevice::SetClock`], us since 1970.
#[unsafe(no_mangle)]
pub extern "C" fn set_clock(unix_us: f64) -> usize {
    request(ToDevice::SetClock { unix_us: unix_us as u64 })
}

/// Two insoles live, and two of a recording.
static AXES: Mutex<[Axis; 4]> = Mutex::new([const { Axis::new() }; 4]);

/// Does something with an axis; those that are not there are empty.
fn with_axis<T>(index: usize, act: impl FnOnce(&mut Axis) -> T) -> T {
    let mut axes = AXES.lock().unwrap_or_else(PoisonError::into_inner);
    act(axes.get_mut(index).unwrap_or(&mut Axis::new()))
}

/// Forgets what is known of an insole's clock.
#[unsafe(no_mangle)]
pub extern "C" fn axis_clear(index: usize) {
    with_axis(index, |axis| *axis = Axis::new());
}

/// Takes an insole's answer to [`get_time`].
#[unsafe(no_mangle)]
pub extern "C" fn axis_answer(index: usize, asked_us: f64, device_us: f64) {
    with_axis(index, |axis| axis.answer(asked_us as u64, device_us as u64));
}

/// The time since 1970, us, when an insole's clock showed `device_us`; not a number before the first answer.
#[unsafe(no_mangle)]
pub extern "C" fn axis_unix_us(index: usize, device_us: f64) -> f64 {
    with_axis(index, |axis| axis.host_us(device_us as u64).map_or(f64::NAN, |us| us as f64))
}

/// What never changes while the page runs: version, regions and how to draw them.
#[unsafe(no_mangle)]
pub extern "C" fn facts() -> usize {
    let regions: Vec<_> = Region::ALL
        .iter()
        .zip(region_shapes())
        .map(|(region, shape)| {
            json!({ "name": region.name(), "outline_mm": shape.outline_mm, "centre_mm": shape.centre_mm })
        })
        .collect();
    let facts = json!({
        "major": MAJOR,
        "minor": MINOR,
        "step_queue": STEP_QUEUE,
        "regions": regions,
        "sole": { "length_mm": sole::LENGTH_MM, "width_mm": sole::WIDTH_MM, "outline_mm": outline_mm() },
    });
    put(facts.to_string().as_bytes())
}
