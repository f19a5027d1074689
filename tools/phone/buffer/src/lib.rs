//! The buffer for input and output that the page for a phone shares with a WebAssembly module.
//!
//! Each module that uses this crate has a buffer of its own, and exports [`resize_buffer`] and [`result`].

use std::sync::{Mutex, PoisonError};

static BUFFER: Mutex<Vec<u8>> = Mutex::new(Vec::new());

/// Calls `act` with the content of the buffer.
pub fn with<T>(act: impl FnOnce(&mut Vec<u8>) -> T) -> T {
    act(&mut BUFFER.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Replaces the content of the buffer by `bytes` and returns their number.
pub fn put(bytes: &[u8]) -> usize {
    with(|buffer| {
        buffer.clear();
        buffer.extend_from_slice(bytes);
        buffer.len()
    })
}

/// Resizes the buffer to `len` bytes and returns its address. The page writes the input of the next call there: a message, or
/// text in JSON.
#[unsafe(no_mangle)]
pub extern "C" fn resize_buffer(len: usize) -> *mut u8 {
    with(|buffer| {
        buffer.resize(len, 0);
        buffer.as_mut_ptr()
    })
}

/// The address of the buffer. The page reads a result there.
#[unsafe(no_mangle)]
pub extern "C" fn result() -> *const u8 {
    with(|buffer| buffer.as_ptr())
}
