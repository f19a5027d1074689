//! The wire messages for the page on a phone: bytes to JSON in physical units, requests to bytes.
//!
//! The page calls plain WebAssembly exports and shares one buffer with them. That needs no binding generator, whose
//! command line would have to be installed in the version of its crate; JSON costs some microseconds a message, and a
//! step is the same object here as from the command line.

mod message;
mod sole;

pub use message::decode_to_json;
pub use sole::{REGION_COUNT, RegionShape, outline_mm, region_shapes};

use plantar::Region;
use plantar::link::STEP_QUEUE;
use plantar::wire::{MAJOR, MAX_MESSAGE, MINOR, ToDevice, encode};
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
