//! liblsl, the C library of the Lab Streaming Layer: the functions that an outlet needs. The library is loaded when the program
//! runs, and never unloaded.

use client::unix_us;
use libloading::Library;
use std::error::Error as _;
use std::ffi::{CString, OsString, c_char, c_void};
use std::path::Path;
use std::ptr::NonNull;
use thiserror::Error;

/// Declares the functions, with the types of `lsl_c.h`.
macro_rules! functions {
    ($($name:ident: fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        #[derive(Clone, Copy)]
        struct Functions {
            $($name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            fn of(library: &Library) -> Result<Self, libloading::Error> {
                // SAFETY: liblsl has not changed the types of these functions since version 1.10, and the caller never unloads
                // it.
                unsafe { Ok(Self { $($name: *library.get(stringify!($name))?,)* }) }
            }
        }
    };
}

functions! {
    lsl_local_clock: fn() -> f64;
    lsl_create_streaminfo: fn(*const c_char, *const c_char, i32, f64, i32, *const c_char) -> *mut c_void;
    lsl_destroy_streaminfo: fn(*mut c_void);
    lsl_get_desc: fn(*mut c_void) -> *mut c_void;
    lsl_append_child: fn(*mut c_void, *const c_char) -> *mut c_void;
    lsl_append_child_value: fn(*mut c_void, *const c_char, *const c_char) -> *mut c_void;
    lsl_create_outlet: fn(*mut c_void, i32, i32) -> *mut c_void;
    lsl_destroy_outlet: fn(*mut c_void);
    lsl_push_sample_dt: fn(*mut c_void, *const f64, f64) -> i32;
    lsl_push_sample_strt: fn(*mut c_void, *const *const c_char, f64) -> i32;
}

/// `cft_double64` of liblsl.
const DOUBLE: i32 = 2;
/// `cft_string` of liblsl.
const STRING: i32 = 3;
/// `LSL_IRREGULAR_RATE` of liblsl.
const IRREGULAR: f64 = 0.0;
/// The chunk size with which liblsl sends each sample at once.
const NO_CHUNKS: i32 = 0;
/// The size of the buffer for a receiver that is too slow, in hundreds of samples, as liblsl counts it for a stream with an
/// irregular rate: its own default.
const BUFFER: i32 = 360;

/// liblsl cannot be loaded.
#[derive(Debug, Error)]
#[error(
    "cannot load {library}, the library of the Lab Streaming Layer ({reason}): install liblsl, for example with `conda install \
     -c conda-forge liblsl` or from https://github.com/sccn/liblsl/releases, or name its file with --lsl=LIBRARY (the Python \
     package pylsl contains it in its folder pylsl/lib)"
)]
pub struct MissingLiblsl {
    library: String,
    reason: String,
}

/// The loaded library.
#[derive(Clone, Copy)]
pub(crate) struct Liblsl(Functions);

/// A time on both clocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now {
    /// LSL's clock, s.
    pub lsl_s: f64,
    /// This computer's clock, us since 1970, UTC.
    pub unix_us: u64,
}

/// The names and values of the properties that describe a stream or a channel.
pub(crate) type Properties = Vec<(&'static str, String)>;

/// A stream before it is published.
pub(crate) struct Stream {
    pub name: String,
    /// The type of its content, a term of the Lab Streaming Layer such as `Markers`.
    pub content: &'static str,
    /// A unique and permanent name, by which receivers find the stream again after this program was restarted; empty if there
    /// is none.
    pub source_id: String,
    pub properties: Properties,
    pub channels: Vec<Properties>,
    /// True for text, false for numbers.
    pub is_text: bool,
}

impl Liblsl {
    /// Loads the library from this file, or, without a file, from where the system finds it.
    pub fn load(file: Option<&Path>) -> Result<Self, MissingLiblsl> {
        let file = file.map_or_else(|| libloading::library_filename("lsl"), OsString::from);
        let missing = |error: libloading::Error| MissingLiblsl {
            library: file.display().to_string(),
            // The source is the system's own message.
            reason: error.source().map_or_else(|| error.to_string(), ToString::to_string),
        };
        // SAFETY: liblsl's initialisation has no requirements. The user vouches for a file that the option `--lsl` names.
        let library = unsafe { Library::new(&file) }.map_err(missing)?;
        let functions = Functions::of(&library).map_err(missing)?;
        // The functions are valid as long as the library is loaded.
        std::mem::forget(library);
        Ok(Self(functions))
    }

    /// The time on both clocks, from the fastest of three readings: this program may be suspended between the two clocks.
    pub fn now(&self) -> Now {
        let reading = || {
            // SAFETY: the function has no arguments.
            let clock_s = || unsafe { (self.0.lsl_local_clock)() };
            let (before_s, unix_us, after_s) = (clock_s(), unix_us(), clock_s());
            (after_s - before_s, Now { lsl_s: (before_s + after_s) / 2.0, unix_us })
        };
        let (first, others) = (reading(), [reading(), reading()]);
        others.into_iter().fold(first, |best, next| if next.0 < best.0 { next } else { best }).1
    }

    /// Publishes a stream; `None` if liblsl cannot.
    pub fn publish(&self, stream: &Stream) -> Option<Outlet> {
        let [name, content, source_id] = [&stream.name, stream.content, &stream.source_id].map(c_string);
        let format = if stream.is_text { STRING } else { DOUBLE };
        let channels = stream.channels.len();
        let lsl = &self.0;
        // SAFETY: the strings end with a zero and outlive the calls, which copy them. Neither the stream's information nor the
        // description in it is used after the information is destroyed; the outlet has a copy of both.
        let outlet = unsafe {
            let (name, content, source_id) = (name.as_ptr(), content.as_ptr(), source_id.as_ptr());
            let info = (lsl.lsl_create_streaminfo)(name, content, channels as i32, IRREGULAR, format, source_id);
            let info = NonNull::new(info)?.as_ptr();
            let description = (lsl.lsl_get_desc)(info);
            self.describe(description, &stream.properties);
            let list = (lsl.lsl_append_child)(description, c"channels".as_ptr());
            for channel in &stream.channels {
                self.describe((lsl.lsl_append_child)(list, c"channel".as_ptr()), channel);
            }
            let outlet = (lsl.lsl_create_outlet)(info, NO_CHUNKS, BUFFER);
            (lsl.lsl_destroy_streaminfo)(info);
            outlet
        };
        NonNull::new(outlet).map(|handle| Outlet { lsl: self.0, handle, channels, is_text: stream.is_text })
    }

    /// Appends properties to an element.
    ///
    /// # Safety
    /// `element` is an element of a stream's description that is not destroyed.
    unsafe fn describe(&self, element: *mut c_void, properties: &Properties) {
        for (name, value) in properties {
            let (name, value) = (c_string(name), c_string(value));
            // SAFETY: the strings end with a zero and outlive the call, which copies them; the caller vouches for the element.
            unsafe { (self.0.lsl_append_child_value)(element, name.as_ptr(), value.as_ptr()) };
        }
    }
}

/// The text for C, without characters that XML cannot contain.
fn c_string(text: &str) -> CString {
    let text: String = text.chars().filter(|c| !c.is_control()).collect();
    // Zero is a control character.
    CString::new(text).unwrap_or_default()
}

/// A published stream, until it is dropped.
pub(crate) struct Outlet {
    lsl: Functions,
    handle: NonNull<c_void>,
    channels: usize,
    is_text: bool,
}

// SAFETY: liblsl allows the calls for an outlet on any thread.
unsafe impl Send for Outlet {}

impl Outlet {
    /// Sends a sample of numbers with its time on LSL's clock, s.
    ///
    /// # Panics
    /// Unless there is one number for each channel of a stream of numbers.
    pub fn push(&mut self, values: &[f64], t_s: f64) {
        assert!(values.len() == self.channels && !self.is_text, "one number for each channel");
        // SAFETY: the outlet was not dropped, and there are as many numbers as it has channels. The call copies them. It fails
        // only for invalid arguments.
        unsafe { (self.lsl.lsl_push_sample_dt)(self.handle.as_ptr(), values.as_ptr(), t_s) };
    }

    /// Sends a sample of text with its time on LSL's clock, s.
    ///
    /// # Panics
    /// Unless the stream has one channel of text.
    pub fn push_text(&mut self, text: &str, t_s: f64) {
        assert!(self.channels == 1 && self.is_text, "one text for the only channel");
        let text = c_string(text);
        let sample = [text.as_ptr()];
        // SAFETY: as in `push`; the text ends with a zero.
        unsafe { (self.lsl.lsl_push_sample_strt)(self.handle.as_ptr(), sample.as_ptr(), t_s) };
    }
}

impl Drop for Outlet {
    fn drop(&mut self) {
        // SAFETY: the outlet was created by liblsl, and is not used after this.
        unsafe { (self.lsl.lsl_destroy_outlet)(self.handle.as_ptr()) };
    }
}
