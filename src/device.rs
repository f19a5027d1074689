//! What every Cortex-M board needs below the safe code: the stack's high-water mark, the look at who stands still, and
//! evidence of what ended a start, over the reset that follows.

use crate::watch::{LIVED_LOOKS, LOOK_MS, Life, PARTS, Watch};
use crate::wire::Reset;
use core::cell::Cell;
use core::fmt::{Display, Write};
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut};
use cortex_m::peripheral::SCB;
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use heapless::String;

/// Longest text of what went wrong, bytes.
pub const EVIDENCE: usize = 96;

/// After so many starts in a row that failed within [`LIVED_LOOKS`] the board starts with what is built in.
const FAILED_STARTS: u32 = 3;

/// Marks what a start wrote, against what RAM holds after power-on.
const MAGIC: u32 = 0x504c_414f;

/// Calls that are kept: as many as the text has room for.
const CALLS: usize = 9;

/// What ended a start: nothing that is known, or one of these.
const PANIC: u32 = 1;
const FAULT: u32 = 2;
const OVERFLOW: u32 = 3;
/// With the bits of [`Watch::look`].
const WEDGED: u32 = 1 << 8;

#[repr(C)]
#[derive(Clone, Copy)]
struct Kept {
    magic: u32,
    /// Starts in a row that failed, this one among them until it has lived.
    failed: u32,
    cause: u32,
    /// How long the start lived, looks.
    looks: u32,
    calls: [u32; CALLS],
}

#[unsafe(link_section = ".evidence")]
static mut KEPT: MaybeUninit<Kept> = MaybeUninit::uninit();

static WATCH: CriticalSectionMutex<Cell<Watch>> = CriticalSectionMutex::new(Cell::new(Watch::new()));

fn kept() -> Kept {
    // SAFETY: integers are valid for any content of RAM. Only this file uses KEPT: before interrupts run, in the interrupt that
    // looks, and with interrupts off before a reset.
    unsafe { addr_of!(KEPT).cast::<Kept>().read_volatile() }
}

fn keep(kept: Kept) {
    // SAFETY: as above.
    unsafe { addr_of_mut!(KEPT).cast::<Kept>().write_volatile(kept) };
}

/// Ends of the stack, the lower one first.
fn stack() -> (u32, u32) {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    (addr_of!(_stack_end) as u32, addr_of!(_stack_start) as u32)
}

/// A word of the stack between its ends.
fn word(at: u32) -> u32 {
    // SAFETY: the callers stay between the ends; the linker aligns them, and the stack's pointer is.
    unsafe { (at as *const u32).read_volatile() }
}

/// Keeps why the start ends and where the program was, the innermost call first: `pc`, and what the stack holds of calls from
/// `from` on, some of them of the past. Then resets. Messages and lines of panics would take a fifth of the flash;
/// `cargo xtask explain` finds the lines in the firmware's file.
fn end(cause: u32, pc: Option<u32>, from: u32) -> ! {
    cortex_m::interrupt::disable();
    let mut calls = [0; CALLS];
    let found = (from..stack().1).step_by(4).filter_map(|at| call_before(word(at)));
    for (place, call) in calls.iter_mut().zip(pc.into_iter().chain(found)) {
        *place = call;
    }
    let looks = WATCH.lock(|watch| watch.get().looks());
    keep(Kept { cause, looks, calls, ..kept() });
    SCB::sys_reset()
}

/// As [`end`], in an exception with these registers on the stack.
fn end_at(cause: u32, frame: u32) -> ! {
    /// Bytes of them, and the program counter's place.
    const FRAME: u32 = 32;
    const PC: u32 = 24;
    end(cause, Some(word(frame + PC)), frame + FRAME)
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    end(PANIC, None, cortex_m::register::msp::read())
}

/// Faults. The stack may be what failed, so this runs on another one, at the end of the memory that outlives the reset.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
extern "C" fn hard_fault() -> ! {
    core::arch::naked_asm!(
        "mov r0, sp",
        "movw r1, :lower16:_evidence_end",
        "movt r1, :upper16:_evidence_end",
        "mov sp, r1",
        "b {fault}",
        fault = sym fault,
    )
}

extern "C" fn fault(frame: u32) -> ! {
    /// The most that one instruction pushes: so near to the end it was that push.
    const PUSH: u32 = 128;
    let (low, top) = stack();
    if (low + PUSH..top).contains(&frame) {
        end_at(FAULT, frame)
    } else {
        // The registers found no room.
        end(OVERFLOW, None, low)
    }
}

/// Defines the exception `SysTick`: it calls `$tick`, a function, with the address of the registers that the exception put on the stack.
#[macro_export]
macro_rules! on_systick {
    ($tick:path) => {
        #[unsafe(naked)]
        #[unsafe(export_name = "SysTick")]
        extern "C" fn systick() {
            core::arch::naked_asm!("mov r0, sp", "b {tick}", tick = sym $tick)
        }
    };
}

/// Looks at who stands still, and resets the board where someone does. Call it every [`crate::watch::LOOK_MS`] in the exception
/// `SysTick`, with what [`crate::on_systick`] gave.
pub fn look(frame: u32, life: &Life) {
    let (wedged, lived) = WATCH.lock(|watch| {
        let mut seen = watch.get();
        let wedged = seen.look(life);
        watch.set(seen);
        (wedged, seen.lived())
    });
    if wedged != 0 {
        end_at(WEDGED | wedged, frame);
    }
    if lived == LIVED_LOOKS {
        keep(Kept { failed: 0, ..kept() });
    }
}

/// How this start came about.
pub struct Start {
    /// Why the board started.
    pub reset: Reset,
    /// What ended the start before, where it was not meant to end.
    pub fault: Option<String<EVIDENCE>>,
    /// Three starts in a row failed: use what is built in, and nothing that is stored.
    pub is_fallback: bool,
}

impl Start {
    /// What is known of this start; `flags` is the board's own word on the reset, if it has one. Call it once, before interrupts run.
    pub fn take(flags: Option<Reset>) -> Self {
        let before = Some(kept()).filter(|kept| kept.magic == MAGIC);
        let cause = before.map_or(0, |before| before.cause);
        let reset = match (cause, flags, before) {
            (PANIC | FAULT | OVERFLOW, ..) => Reset::Panic,
            (WEDGED.., ..) => Reset::Watchdog,
            (_, Some(flags), _) => flags,
            (_, None, Some(_)) => Reset::Software,
            (_, None, None) => Reset::Power,
        };
        // A start that was ended by hand did not fail.
        let failed =
            before.filter(|_| matches!(reset, Reset::Panic | Reset::Watchdog)).map_or(0, |before| before.failed);
        let is_fallback = failed >= FAILED_STARTS;
        keep(Kept { magic: MAGIC, failed: failed.saturating_add(1), cause: 0, looks: 0, calls: [0; CALLS] });
        let mut text = Text::default();
        if is_fallback {
            text.say("fallback after ").number(failed).say(" failed starts: ");
        }
        match before {
            Some(before) if cause != 0 => text.tell(&before),
            _ if reset == Reset::Watchdog => text.say("wedged with interrupts off"),
            _ => &mut text,
        };
        Self { reset, fault: Some(text.0).filter(|text| !text.is_empty()), is_fallback }
    }
}

/// A text without the formatting of `core`, which takes kilobytes of flash.
#[derive(Default)]
struct Text(String<EVIDENCE>);

impl Text {
    fn say(&mut self, words: &str) -> &mut Self {
        // The longest text without addresses is shorter.
        let _ = self.0.push_str(words);
        self
    }

    fn number(&mut self, number: u32) -> &mut Self {
        let mut unit = 1_000_000_000;
        while unit > 0 {
            if number >= unit || unit == 1 {
                self.digit(number / unit % 10);
            }
            unit /= 10;
        }
        self
    }

    fn digit(&mut self, digit: u32) {
        let _ = char::from_digit(digit, 16).map(|digit| self.0.push(digit));
    }

    /// What ended a start: why, when, and as many calls as there is room for.
    fn tell(&mut self, kept: &Kept) -> &mut Self {
        self.say(match kept.cause {
            PANIC => "panic",
            FAULT => "fault",
            OVERFLOW => "stack overflow",
            _ => "wedged:",
        });
        let stood_still =
            PARTS.iter().enumerate().filter(|(bit, _)| kept.cause >= WEDGED && kept.cause >> bit & 1 == 1);
        stood_still.for_each(|(_, part)| {
            self.say(" ").say(part);
        });
        let per_s = 1000 / LOOK_MS;
        self.say(" after ").number(kept.looks / per_s).say(".").number(kept.looks % per_s).say(" s at");
        for &call in kept.calls.iter().take_while(|&&call| call != 0) {
            if self.0.len() + 9 > EVIDENCE {
                break;
            }
            self.say(" ");
            (0..8).rev().for_each(|digit| self.digit(call >> (4 * digit) & 0xf));
        }
        self
    }
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

/// Deepest use of the stack so far, bytes: what is no longer painted as `cortex-m-rt` left it at start.
pub fn stack_bytes() -> u32 {
    let (low, top) = stack();
    let painted = (low..top).step_by(4).take_while(|&at| word(at) == cortex_m_rt::STACK_PAINT_VALUE).count();
    top - low - 4 * painted as u32
}
