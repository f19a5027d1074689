//! Messages without framing: a decoded message can be encoded again, in at most as many bytes as the input has, and these bytes
//! are decoded to the same message.

use plantar::protocol::{MAX_MESSAGE, ToDevice, ToHost, decode, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Checks one input.
pub fn check(data: &[u8]) {
    round_trip::<ToDevice>(data);
    round_trip::<ToHost>(data);
}

/// Decodes a message, encodes it, and decodes and encodes it once more.
fn round_trip<T: Serialize + DeserializeOwned>(data: &[u8]) {
    let Some(message) = decode::<T>(data) else { return };
    let mut buffers = [[0; MAX_MESSAGE]; 2];
    let [once, twice] = &mut buffers;
    let once = encode(&message, once).expect("every message fits");
    // A sender may encode numbers with more bytes than necessary.
    assert!(once.len() <= data.len());
    let again: T = decode(once).expect("an encoded message can be decoded");
    // Compared as bytes, because a NaN is not equal to itself.
    assert_eq!(once, encode(&again, twice).expect("every message fits"));
}
