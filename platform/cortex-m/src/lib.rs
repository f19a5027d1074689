//! Code that all Cortex-M boards share: the measurement of the stack, the supervision interrupt, and a crash record in RAM that
//! survives a reset.
#![no_std]

use core::cell::Cell;
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut};
use cortex_m::peripheral::{DWT, SCB};
use embassy_sync::blocking_mutex::CriticalSectionMutex;
use heapless::String;
use plantar::firmware::board::Stopwatch;
use plantar::firmware::boot_report::{BootReport, Failures, RADIO_DELAYED, is_started_by_user};
use plantar::firmware::supervise::{CHECK_PERIOD_MS, Heartbeats, PARTS, Watchdog};
use plantar::protocol::{MAX_FAULT_TEXT, Reset};

/// Distinguishes a crash record from the contents of RAM after power-on, and from a record of other firmware with other fields.
/// Must be changed with [`CrashRecord`].
const MAGIC: u32 = 0x504c_4150;

/// Number of addresses in a crash record: at least as many as fit into the text of the hello.
const CALLS: usize = 9;

/// The run ended by a panic. This and the following constants are the values of [`CrashRecord::cause`].
const PANIC: u32 = 1;
/// The run ended by a hard fault.
const FAULT: u32 = 2;
/// The run ended by a stack overflow.
const OVERFLOW: u32 = 3;
/// The run ended because a part was stalled. Combined with the bits of [`Watchdog::check`].
const STALLED: u32 = 1 << 8;

/// The crash record. It is written at every start, when the number of failures changes because the run has been healthy for long
/// enough ([`Failures::recorded_after`]), and when a failure ends the run (the time from a start to the next reset). It is read
/// at the next start.
#[repr(C)]
#[derive(Clone, Copy)]
struct CrashRecord {
    magic: u32,
    /// The failures of successive runs, as [`Failures::recorded`] returns them at a start, or
    /// [`Failures::recorded_after`] later.
    failures: Failures,
    /// The failure that ended the run; 0 if none was recorded.
    cause: u32,
    /// Duration of the run: the number of checks, which are [`CHECK_PERIOD_MS`] apart.
    checks: u32,
    /// The addresses of the calls in progress, the innermost first; 0 after the last one.
    calls: [u32; CALLS],
}

#[unsafe(link_section = ".crash_record")]
static mut RECORD: MaybeUninit<CrashRecord> = MaybeUninit::uninit();

static WATCHDOG: CriticalSectionMutex<Cell<Watchdog>> = CriticalSectionMutex::new(Cell::new(Watchdog::new()));

fn read_record() -> CrashRecord {
    // SAFETY: integers are valid for any content of RAM. Only this file uses RECORD: before interrupts are enabled, in the
    // supervision interrupt, and with interrupts disabled before a reset.
    unsafe { addr_of!(RECORD).cast::<CrashRecord>().read_volatile() }
}

fn write_record(record: CrashRecord) {
    // SAFETY: as in `read_record`.
    unsafe { addr_of_mut!(RECORD).cast::<CrashRecord>().write_volatile(record) };
}

/// The ends of the stack, the lower one first.
fn stack() -> (u32, u32) {
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    (addr_of!(_stack_end) as u32, addr_of!(_stack_start) as u32)
}

/// Reads a word of the stack, between its ends.
fn word(at: u32) -> u32 {
    // SAFETY: the callers stay between the ends, which the linker aligns; the stack pointer is aligned too.
    unsafe { (at as *const u32).read_volatile() }
}

/// Records the cause and the addresses of the calls in progress, the innermost first, then resets. The addresses are `pc` and,
/// for each return address on the stack from `from` on, that of its call; some return addresses may be stale. The record contains
/// addresses, because panic messages and locations would take some 45 KiB of flash; `cargo xtask explain` finds the source lines
/// in the file of the firmware.
fn save_crash_record_and_reset(cause: u32, pc: Option<u32>, from: u32) -> ! {
    cortex_m::interrupt::disable();
    let mut calls = [0; CALLS];
    let stacked_calls = (from..stack().1).step_by(4).filter_map(|at| call_before(word(at)));
    for (place, call) in calls.iter_mut().zip(pc.into_iter().chain(stacked_calls)) {
        *place = call;
    }
    let checks = WATCHDOG.lock(|watchdog| watchdog.get().checks());
    write_record(CrashRecord { cause, checks, calls, ..read_record() });
    SCB::sys_reset()
}

/// Saves the crash record in an exception, and resets. `frame` is the address of the registers that the exception put on the
/// stack.
fn save_exception_and_reset(cause: u32, frame: u32) -> ! {
    /// Size of these registers, bytes.
    const FRAME: u32 = 32;
    /// Offset of the program counter in them, bytes.
    const PC: u32 = 24;
    save_crash_record_and_reset(cause, Some(word(frame + PC)), frame + FRAME)
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    save_crash_record_and_reset(PANIC, None, cortex_m::register::msp::read())
}

/// The handler of the hard fault. The stack may be the cause of the fault, so the handler uses another stack, at the end of the
/// region CRASH_RECORD.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
extern "C" fn hard_fault() -> ! {
    core::arch::naked_asm!(
        "mov r0, sp",
        "movw r1, :lower16:_crash_record_end",
        "movt r1, :upper16:_crash_record_end",
        "mov sp, r1",
        "b {fault}",
        fault = sym fault,
    )
}

/// Records a hard fault or a stack overflow. `frame` is the stack pointer at the exception.
extern "C" fn fault(frame: u32) -> ! {
    /// Largest number of bytes that one instruction pushes. A fault with the stack pointer this close to the end of the stack
    /// counts as an overflow, because a push may have caused it.
    const PUSH: u32 = 128;
    let (low, top) = stack();
    if (low + PUSH..top).contains(&frame) {
        save_exception_and_reset(FAULT, frame)
    } else {
        // The stack had no space for the registers.
        save_crash_record_and_reset(OVERFLOW, None, low)
    }
}

/// Defines the exception `SysTick`: it calls the function `$tick` with the address of the registers that the exception put on the
/// stack.
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

/// Checks that all parts ([`PARTS`]) make progress; if one of them is stalled, saves the crash record and resets the board. To
/// be called every [`CHECK_PERIOD_MS`] in an exception with a higher priority than all tasks, with the address of the registers
/// that the exception put on the stack, as [`on_systick`] passes it.
pub fn check(frame: u32, heartbeats: &Heartbeats) {
    let (stalled, healthy_checks) = WATCHDOG.lock(|cell| {
        let mut watchdog = cell.get();
        let stalled = watchdog.check(heartbeats);
        cell.set(watchdog);
        (stalled, watchdog.healthy_checks())
    });
    if stalled != 0 {
        save_exception_and_reset(STALLED | stalled, frame);
    }
    let record = read_record();
    if let Some(failures) = record.failures.recorded_after(healthy_checks) {
        write_record(CrashRecord { failures, ..record });
    }
}

/// Reports the circumstances of this start. `controller_reset` is the reset reason that the controller reports; `None` if it
/// reports none. To be called once, before interrupts are enabled.
pub fn boot_report(controller_reset: Option<Reset>) -> BootReport {
    let before = Some(read_record()).filter(|record| record.magic == MAGIC);
    let cause = before.map_or(0, |before| before.cause);
    let reset = match (cause, controller_reset, before) {
        (PANIC | FAULT | OVERFLOW, ..) => Reset::Panic,
        (STALLED.., ..) => Reset::Watchdog,
        (_, Some(reset), _) => reset,
        (_, None, Some(_)) => Reset::Software,
        (_, None, None) => Reset::Power,
    };
    let stalled = cause.saturating_sub(STALLED);
    let failures = before.map_or(Failures::default(), |before| before.failures.at_next_start(reset, stalled));
    write_record(CrashRecord { magic: MAGIC, failures: failures.recorded(), cause: 0, checks: 0, calls: [0; CALLS] });
    let mut text = Text::default();
    if failures.lead_to_recovery() {
        text.push("recovery after ").push_number(failures.starts).push(" failed starts: ");
    } else if failures.is_radio_delayed() {
        text.push(RADIO_DELAYED);
    }
    match before {
        Some(before) if cause != 0 => text.push_record(&before),
        _ if reset == Reset::Watchdog => text.push("stalled with interrupts disabled"),
        // A lockup resets some controllers before anything is recorded.
        _ if reset == Reset::Panic => text.push("fault in a fault handler"),
        _ => &mut text,
    };
    let is_started_by_user = is_started_by_user(reset, before.is_some());
    BootReport { reset, fault: Some(text.0).filter(|text| !text.is_empty()), failures, is_started_by_user }
}

/// A text that is composed without `core::fmt`.
#[derive(Default)]
struct Text(String<MAX_FAULT_TEXT>);

impl Text {
    fn push(&mut self, words: &str) -> &mut Self {
        // This does not fail: without addresses, every text that occurs is shorter than MAX_FAULT_TEXT, and addresses are only
        // added if they fit. Otherwise, the words that do not fit would be missing.
        let _ = self.0.push_str(words);
        self
    }

    fn push_number(&mut self, number: u32) -> &mut Self {
        let mut unit = 1_000_000_000;
        while unit > 0 {
            if number >= unit || unit == 1 {
                self.push_digit(number / unit % 10);
            }
            unit /= 10;
        }
        self
    }

    fn push_digit(&mut self, digit: u32) {
        let _ = char::from_digit(digit, 16).map(|digit| self.0.push(digit));
    }

    /// Adds the contents of a crash record: the cause, the duration of the run, and as many addresses as fit.
    fn push_record(&mut self, record: &CrashRecord) -> &mut Self {
        self.push(match record.cause {
            PANIC => "panic",
            FAULT => "fault",
            OVERFLOW => "stack overflow",
            _ => "stalled:",
        });
        let stalled =
            PARTS.iter().enumerate().filter(|(bit, _)| record.cause >= STALLED && record.cause >> bit & 1 == 1);
        stalled.for_each(|(_, part)| {
            self.push(" ").push(part);
        });
        let per_s = 1000 / CHECK_PERIOD_MS;
        self.push(" after ")
            .push_number(record.checks / per_s)
            .push(".")
            .push_number(record.checks % per_s)
            .push(" s at");
        for &call in record.calls.iter().take_while(|&&call| call != 0) {
            // An address takes a space and eight digits.
            if self.0.len() + 9 > MAX_FAULT_TEXT {
                break;
            }
            self.push(" ");
            (0..8).rev().for_each(|digit| self.push_digit(call >> (4 * digit) & 0xf));
        }
        self
    }
}

/// An address within the call instruction that returns to `word`; `None` if `word` is not a return address.
fn call_before(word: u32) -> Option<u32> {
    unsafe extern "C" {
        static __stext: u16;
        static __etext: u16;
    }
    let (start, end) = (addr_of!(__stext) as u32, addr_of!(__etext) as u32);
    // Bit 0 marks Thumb code.
    let is_code = |address: &u32| address.is_multiple_of(2) && (start + 4..end).contains(address);
    let return_address = word.checked_sub(1).filter(is_code)? as *const u16;
    // SAFETY: the two halfwords before `return_address` are code.
    let (first, second) = unsafe { (return_address.sub(2).read(), return_address.sub(1).read()) };
    // The encodings of BL (immediate) and BLX (register) in the ARMv7-M Architecture Reference Manual.
    let is_branch_with_link = first & 0xf800 == 0xf000 && second & 0xd000 == 0xd000;
    let is_branch_to_register = second & 0xff87 == 0x4780;
    (is_branch_with_link || is_branch_to_register).then_some(return_address as u32 - 2)
}

/// Deepest use of the stack so far, bytes: the part that no longer contains the pattern that `cortex-m-rt` wrote at the start.
pub fn stack_bytes() -> u32 {
    let (low, top) = stack();
    let painted = (low..top).step_by(4).take_while(|&at| word(at) == cortex_m_rt::STACK_PAINT_VALUE).count();
    top - low - 4 * painted as u32
}

/// The running image: everything that the linker has placed in the controller's flash.
pub fn image() -> &'static [u8] {
    unsafe extern "C" {
        static __vector_table: u32;
        static __sidata: u32;
        static __sdata: u32;
        static __edata: u32;
    }
    // The initial values of variables come last.
    let start = addr_of!(__vector_table) as usize;
    let end = addr_of!(__sidata) as usize + (addr_of!(__edata) as usize - addr_of!(__sdata) as usize);
    // SAFETY: the linker has filled the flash between these addresses, and the application never writes it.
    unsafe { core::slice::from_raw_parts(start as *const u8, end - start) }
}

/// Counts the core's cycles, including the cycles of interrupts. `CORE_KHZ` is the clock of the core, kHz. The cycle counter of
/// the core must have been enabled.
pub struct CycleCounter<const CORE_KHZ: u32>;

impl<const CORE_KHZ: u32> Stopwatch for CycleCounter<CORE_KHZ> {
    const CYCLES_PER_MS: u32 = CORE_KHZ;

    fn start(&self) -> u32 {
        DWT::cycle_count()
    }

    fn cycles_since(&self, start: u32) -> u32 {
        DWT::cycle_count().wrapping_sub(start)
    }
}
