//! The bus to the flash chip on the module XIAO nRF52840: the QSPI peripheral.
//!
//! `embassy-nrf` has a driver for it, too. It is not used here, because it panics on addresses, lengths and buffers that are not
//! aligned, and because it waits in a loop without a time limit if a transfer is cancelled, as after a timeout.
//!
//! The chip is used with one data line in each direction. Four lines would need a bit in a non-volatile register of the chip, and
//! the board needs no higher rate: at 16 Mbit/s, it reads an image in a quarter of a second.

use crate::flash::{BUS_LIMIT_MS, Bus, NoAnswer, PAGE_WORDS, Page};
use core::sync::atomic::{AtomicU32, Ordering, compiler_fence};
use embassy_nrf::Peri;
use embassy_nrf::pac::gpio::vals::{Dir, Drive, Input, Pull};
use embassy_nrf::pac::qspi::regs::{Cinstrdat0, Cinstrdat1};
use embassy_nrf::pac::qspi::vals::{Addrmode, Len, Length, Ppsize, Readoc, Spimode, Writeoc};
use embassy_nrf::pac::shared::regs::Psel;
use embassy_nrf::pac::{P0, QSPI};
use embassy_nrf::peripherals;

/// The pins of port 0 to the chip on the XIAO: clock, select, data to the chip, and data from the chip.
const CLOCK: usize = 21;
const SELECT: usize = 25;
const TO_CHIP: usize = 20;
const FROM_CHIP: usize = 24;
/// The pins of write protection and hold, which are inactive while they are high.
const WRITE_PROTECT: usize = 22;
const HOLD: usize = 23;

/// Divider of the bit rate: 32 MHz / (1 + 1) = 16 MHz.
const RATE: u8 = 1;
/// Shortest time for which the select line is high between commands, in units of 62.5 ns. The chip needs 50 ns.
const SELECT_HIGH: u8 = 2;

/// The buffer of the transfers. A cancelled transfer may still change it, which does no harm, because it has no other use.
static PAGE: Page = [const { AtomicU32::new(0) }; PAGE_WORDS];

/// The way in which a program waits: the bootloader in loops, the firmware while other tasks run.
#[allow(async_fn_in_trait, reason = "executors of this board do not move tasks between threads")]
pub trait Wait {
    /// Waits until `is_ready` returns true; returns false if it does not within `limit_ms`. The peripheral requests the
    /// interrupt `QSPI` when the result of `is_ready` changes to true.
    async fn until(&mut self, limit_ms: u32, is_ready: impl Fn() -> bool) -> bool;

    /// Waits for `ms` milliseconds.
    async fn pause_ms(&mut self, ms: u32);
}

/// The bus. It owns its pins, which the module connects to the chip and to nothing else.
pub struct Qspi<W> {
    wait: W,
    /// The peripheral is enabled.
    is_active: bool,
}

impl<W: Wait> Qspi<W> {
    /// Configures the pins and the peripheral, which remains off.
    pub fn new(_qspi: Peri<'static, peripherals::QSPI>, wait: W) -> Self {
        for pin in [CLOCK, SELECT, TO_CHIP, WRITE_PROTECT, HOLD] {
            // While the peripheral is off, these levels signal no command.
            P0.outset().write(|w| w.set_pin(pin, pin != CLOCK && pin != TO_CHIP));
            P0.pin_cnf(pin).write(|w| {
                w.set_dir(Dir::Output);
                w.set_input(Input::Connect);
                w.set_drive(Drive::H0h1);
            });
        }
        // A missing chip reads 0, as does one in power-down. As a status, this means that it is not busy, so that the activation
        // ends; as an identity, it is not valid.
        P0.pin_cnf(FROM_CHIP).write(|w| {
            w.set_input(Input::Connect);
            w.set_pull(Pull::Pulldown);
            w.set_drive(Drive::H0h1);
        });
        let connected = |pin: usize| {
            let mut psel = Psel(0);
            psel.set_pin(pin as u8);
            psel
        };
        QSPI.psel().sck().write_value(connected(CLOCK));
        QSPI.psel().csn().write_value(connected(SELECT));
        QSPI.psel().io0().write_value(connected(TO_CHIP));
        QSPI.psel().io1().write_value(connected(FROM_CHIP));
        QSPI.ifconfig0().write(|w| {
            w.set_readoc(Readoc::Fastread);
            w.set_writeoc(Writeoc::Pp);
            w.set_addrmode(Addrmode::_24bit);
            w.set_ppsize(Ppsize::_256bytes);
        });
        QSPI.ifconfig1().write(|w| {
            w.set_sckdelay(SELECT_HIGH);
            w.set_spimode(Spimode::Mode0);
            w.set_sckfreq(RATE);
        });
        // The delay with which data from the chip are sampled, in cycles of 64 MHz; this is the value after a reset.
        QSPI.iftiming().write(|w| w.set_rxdelay(2));
        Self { wait, is_active: false }
    }

    /// Starts an operation, and waits until the peripheral is ready again.
    async fn run(&mut self, start: impl FnOnce()) -> Result<(), NoAnswer> {
        QSPI.events_ready().write_value(0);
        // The interrupt that [`Wait::until`] promises.
        QSPI.intenset().write(|w| w.set_ready(true));
        // The buffer must be complete before the transfer begins, and must not be read before it has ended.
        compiler_fence(Ordering::SeqCst);
        start();
        let is_ready = self.wait.until(BUS_LIMIT_MS, || QSPI.events_ready().read() != 0).await;
        compiler_fence(Ordering::SeqCst);
        if is_ready { Ok(()) } else { Err(NoAnswer) }
    }
}

/// The length in bytes of a transfer of this many words, at most a page.
const fn bytes(words: usize) -> u32 {
    let words = if words < PAGE_WORDS { words } else { PAGE_WORDS };
    4 * words as u32
}

impl<W: Wait> Bus for Qspi<W> {
    fn page(&self) -> &Page {
        &PAGE
    }

    async fn activate(&mut self) -> Result<(), NoAnswer> {
        if self.is_active {
            // An operation was cancelled before it switched the bus off. The chip may still be busy with it.
            self.deactivate();
        }
        self.is_active = true;
        QSPI.enable().write(|w| w.set_enable(true));
        // The peripheral is not ready before the chip is. If it were activated without its pins, it would not wait, but then each
        // operation would have to wait for the chip.
        self.run(|| QSPI.tasks_activate().write_value(1)).await
    }

    fn deactivate(&mut self) {
        /// A register without a name. Writing 1 completes the deactivation, without which the peripheral continues to draw
        /// current (erratum 122).
        const COMPLETE: *mut u32 = 0x4002_9054 as *mut u32;
        QSPI.intenclr().write(|w| w.set_ready(true));
        QSPI.tasks_deactivate().write_value(1);
        // SAFETY: this is a register of the peripheral that belongs to `self`, and the erratum prescribes the value.
        unsafe { COMPLETE.write_volatile(1) };
        QSPI.enable().write(|w| w.set_enable(false));
        self.is_active = false;
    }

    async fn read(&mut self, address: u32, words: usize) -> Result<(), NoAnswer> {
        QSPI.read().src().write_value(address);
        QSPI.read().dst().write_value(PAGE.as_ptr() as u32);
        QSPI.read().cnt().write(|w| w.set_cnt(bytes(words)));
        self.run(|| QSPI.tasks_readstart().write_value(1)).await
    }

    async fn write(&mut self, address: u32, words: usize) -> Result<(), NoAnswer> {
        QSPI.write().dst().write_value(address);
        QSPI.write().src().write_value(PAGE.as_ptr() as u32);
        QSPI.write().cnt().write(|w| w.set_cnt(bytes(words)));
        self.run(|| QSPI.tasks_writestart().write_value(1)).await
    }

    async fn erase(&mut self, address: u32) -> Result<(), NoAnswer> {
        QSPI.erase().ptr().write_value(address);
        QSPI.erase().len().write(|w| w.set_len(Len::_4kb));
        self.run(|| QSPI.tasks_erasestart().write_value(1)).await
    }

    async fn command(&mut self, opcode: u8) -> Result<[u8; 3], NoAnswer> {
        QSPI.cinstrdat0().write_value(Cinstrdat0(0));
        QSPI.cinstrdat1().write_value(Cinstrdat1(0));
        self.run(|| {
            QSPI.cinstrconf().write(|w| {
                w.set_opcode(opcode);
                // The opcode and three bytes.
                w.set_length(Length::_4b);
                // Write protection and hold remain inactive.
                w.set_lio2(true);
                w.set_lio3(true);
            })
        })
        .await?;
        let [first, second, third, _] = QSPI.cinstrdat0().read().0.to_le_bytes();
        Ok([first, second, third])
    }

    async fn pause_ms(&mut self, ms: u32) {
        self.wait.pause_ms(ms).await;
    }
}
