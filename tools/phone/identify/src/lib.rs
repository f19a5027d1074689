//! The identification of a wearer's tissue parameters on the page for a phone, as WebAssembly.
//!
//! It runs in a Web Worker of the page. While a guided session collects steps, the page passes the messages of the session's
//! insoles, unchanged and in the order of their arrival; [`collected`] reports how many steps can be used, and [`identify`] fits
//! the parameters of one foot with the code of `plantar fit`. As in `phone-wire`, the page calls plain WebAssembly exports,
//! shares one buffer with them, and receives results as JSON.

mod session;

pub use session::Session;

use parameters::InsoleSize;
use phone_buffer::put;
use std::sync::{Mutex, PoisonError};

/// The session, with the messages of the insoles since the last [`clear`].
static SESSION: Mutex<Option<Session>> = Mutex::new(None);

/// Calls `act` with the session.
fn with<T>(act: impl FnOnce(&mut Session) -> T) -> T {
    act(SESSION.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_default())
}

#[cfg(target_arch = "wasm32")]
#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// The page's function that receives the index of each region when its fit is complete.
    safe fn region_fitted(region: u32);
}

#[cfg(not(target_arch = "wasm32"))]
fn region_fitted(_region: u32) {}

/// Removes all messages.
#[unsafe(no_mangle)]
pub extern "C" fn clear() {
    with(|session| *session = Session::default());
}

/// Adds the message in the buffer, which arrived from the insole with this index. Returns true if it is a step.
#[unsafe(no_mangle)]
pub extern "C" fn add(insole: usize) -> bool {
    phone_buffer::with(|message| with(|session| session.add(insole, message)))
}

/// Writes the result of [`Session::collected`] to the buffer as JSON, and returns the length of the text.
#[unsafe(no_mangle)]
pub extern "C" fn collected() -> usize {
    let json = with(|session| session.collected().to_string());
    put(json.as_bytes())
}

/// Fits the parameters to the steps of the insole with this index. Writes the result of [`Session::identify`] to the buffer as
/// JSON and returns the length of the text. `size` is the European shoe size, to which the typical thickness of the tissue is
/// scaled; a size outside of 20 to 52 counts as size 42, the default.
#[unsafe(no_mangle)]
pub extern "C" fn identify(insole: usize, size: u8) -> usize {
    let size = size.to_string().parse::<InsoleSize>().unwrap_or_default();
    let json = with(|session| session.identify(insole, size, &|region| region_fitted(region as u32)).to_string());
    put(json.as_bytes())
}
