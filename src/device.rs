//! What every Cortex-M board needs below the safe code: the stack's high-water mark and the evidence of a panic.

use core::fmt::{Display, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::{addr_of, addr_of_mut};
use heapless::String;

/// Longest panic text that is kept, bytes.
pub const EVIDENCE: usize = 96;

/// Marks evidence that a panic wrote, against what RAM holds after power-on.
const MAGIC: u32 = 0x504c_414e;

#[repr(C)]
struct Evidence {
    magic: u32,
    len: u32,
    text: [u8; EVIDENCE],
}

#[unsafe(link_section = ".evidence")]
static mut KEPT: MaybeUninit<Evidence> = MaybeUninit::uninit();

/// Keeps the panic's place and message across the reset that must follow.
pub fn keep_panic(info: &PanicInfo) {
    // The path is long and its end tells most.
    let text = match info.location() {
        Some(place) => {
            let file = place.file().rsplit('/').next().unwrap_or_default();
            cut(format_args!("{file}:{} {}", place.line(), info.message()))
        }
        None => cut(format_args!("{}", info.message())),
    };
    let mut evidence = Evidence { magic: MAGIC, len: text.len() as u32, text: [0; EVIDENCE] };
    evidence.text[..text.len()].copy_from_slice(text.as_bytes());
    // SAFETY: runs in the panic handler, which never returns; nobody else holds a reference to KEPT.
    unsafe { addr_of_mut!(KEPT).cast::<Evidence>().write_volatile(evidence) };
}

/// A text for the hello; what does not fit is cut.
pub fn cut(text: impl Display) -> String<EVIDENCE> {
    struct Cut(String<EVIDENCE>);

    impl Write for Cut {
        fn write_str(&mut self, s: &str) -> core::fmt::Result {
            s.chars().try_for_each(|c| self.0.push(c)).map_err(|_| core::fmt::Error)
        }
    }

    let mut cut = Cut(String::new());
    // An error here is the cut.
    let _ = write!(cut, "{text}");
    cut.0
}

/// The text of the panic before this start, once; `None` after any other reset. Call it before interrupts run.
pub fn take_panic() -> Option<String<EVIDENCE>> {
    // SAFETY: integers and bytes are valid for any content of RAM; nobody else uses KEPT before a panic.
    let evidence = unsafe { addr_of!(KEPT).cast::<Evidence>().read_volatile() };
    // SAFETY: as above.
    unsafe { addr_of_mut!(KEPT).cast::<u32>().write_volatile(0) };
    let text = evidence.text.get(..evidence.len as usize).filter(|_| evidence.magic == MAGIC)?;
    core::str::from_utf8(text).ok()?.try_into().ok()
}

/// Deepest use of the stack so far, bytes: what is no longer painted as `cortex-m-rt` left it at start.
pub fn stack_bytes() -> u32 {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    let (mut at, top) = (addr_of!(_stack_end), addr_of!(_stack_start));
    // SAFETY: both ends come from the linker, are aligned and enclose RAM; reading the unused part below the stack pointer
    // races with nobody who cares.
    unsafe {
        while at < top && at.read_volatile() == cortex_m_rt::STACK_PAINT_VALUE {
            at = at.add(1);
        }
        top.byte_offset_from(at) as u32
    }
}
