//! What every Cortex-M board needs below the safe code: the stack's high-water mark and the evidence of a panic.

use core::fmt::{Display, Write};
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut};
use heapless::String;

/// Longest text of a panic, bytes.
pub const EVIDENCE: usize = 96;

/// Marks evidence that a panic wrote, against what RAM holds after power-on.
const MAGIC: u32 = 0x504c_414e;

/// Calls that are kept of a panic: as many as the text has room for.
const CALLS: usize = 9;

#[repr(C)]
struct Evidence {
    magic: u32,
    calls: [u32; CALLS],
}

#[unsafe(link_section = ".evidence")]
static mut KEPT: MaybeUninit<Evidence> = MaybeUninit::uninit();

/// Keeps where the program was, the innermost call first, across the reset that must follow: `at`, and what the stack holds of
/// calls, some of them of the past. Messages and lines of panics would take a fifth of the flash; `cargo xtask explain` finds the
/// lines in the firmware's file.
pub fn keep_calls(at: Option<u32>) {
    unsafe extern "C" {
        static _stack_start: u32;
    }
    let (here, top) = (cortex_m::register::msp::read(), addr_of!(_stack_start) as u32);
    // SAFETY: from the stack pointer to the top RAM holds the stack of all that runs, in whole words.
    let words = (here..top).step_by(4).map(|at| unsafe { (at as *const u32).read_volatile() });
    let mut evidence = Evidence { magic: MAGIC, calls: [0; CALLS] };
    for (place, call) in evidence.calls.iter_mut().zip(at.into_iter().chain(words.filter_map(call_before))) {
        *place = call;
    }
    // SAFETY: runs before a reset, and never returns to what was interrupted; nobody else holds a reference to KEPT.
    unsafe { addr_of_mut!(KEPT).cast::<Evidence>().write_volatile(evidence) };
}

/// The address of the call that returns to `word`, if it is one.
fn call_before(word: u32) -> Option<u32> {
    unsafe extern "C" {
        static __stext: u16;
        static __etext: u16;
    }
    let (start, end) = (addr_of!(__stext) as u32, addr_of!(__etext) as u32);
    // Bit 0 tells that the code is Thumb.
    let back = word.checked_sub(1).filter(|back| back % 2 == 0 && (start + 4..end).contains(back))? as *const u16;
    // SAFETY: two halfwords before `back` are code.
    let (first, second) = unsafe { (back.sub(2).read(), back.sub(1).read()) };
    let is_branch_with_link = first & 0xf800 == 0xf000 && second & 0xd000 == 0xd000;
    let is_branch_to_register = second & 0xff87 == 0x4780;
    (is_branch_with_link || is_branch_to_register).then_some(back as u32 - 2)
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

/// Where the program was in the panic before this start, once; `None` after any other reset. Call it before interrupts run.
pub fn take_panic() -> Option<String<EVIDENCE>> {
    // SAFETY: integers are valid for any content of RAM; nobody else uses KEPT before a panic.
    let evidence = unsafe { addr_of!(KEPT).cast::<Evidence>().read_volatile() };
    // SAFETY: as above.
    unsafe { addr_of_mut!(KEPT).cast::<u32>().write_volatile(0) };
    if evidence.magic != MAGIC {
        return None;
    }
    let mut text = String::new();
    // There is room for all of it.
    let _ = text.push_str("panic at");
    for call in evidence.calls.into_iter().take_while(|&call| call != 0) {
        let _ = text.push(' ');
        let digits = (0..8).rev().filter_map(|digit| char::from_digit(call >> (4 * digit) & 0xf, 16));
        let _ = digits.map(|digit| text.push(digit)).count();
    }
    Some(text)
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
