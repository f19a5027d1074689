//! The resistive matrix: a row at ground through an analogue switch, four columns at a time through multiplexers to the SAADC.
//!
//! `README.md` has the wiring and the time of a frame. The switches are controlled through a shift register, because the module
//! has eleven pins only. The front end, the switches included, has no supply between two frames.

use crate::clock::Microseconds;
use core::cell::Cell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::ops::Range;
use core::pin::pin;
use core::sync::atomic::{AtomicU8, AtomicU16, Ordering};
use core::task::Poll;
use embassy_nrf::gpio::Output;
use embassy_nrf::saadc::{
    AnyInput, ChannelConfig, Config, Gain, InterruptHandler, Oversample, Reference, Resolution, Saadc, Time, VddInput,
};
use embassy_nrf::{Peri, bind_interrupts, pac, peripherals};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use nrf52840_drivers::{battery, wait_cycles};
use plantar::firmware::board::{Matrix, MatrixTimeout};
use plantar::firmware::front_end::{SETTLE_US, START_US};
use plantar::firmware::layout::{COLUMNS, ROWS, WIRING};
use plantar::pipeline::calibrate::FULL_CODE;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::protocol::SUFFICIENT_SUPPLY_MV;

bind_interrupts!(struct Irqs {
    SAADC => InterruptHandler;
});

/// Number of inputs of the converter. A multiplexer connects one of [`CHANNELS`] columns to each.
pub const INPUTS: usize = 4;
/// Number of columns that share an input.
const CHANNELS: usize = 4;
const _: () = assert!(INPUTS * CHANNELS == COLUMNS && ROWS == 16);

/// Least code that counts as saturated. A saturated amplifier has the code 65,204, but the gain of the converter may be 3 % too
/// low: the code is then 63,248.
const CLIPPED_CODE: u16 = 62_900;
/// Settling time after a change of the multiplexers, us: they connect settled outputs to the converter,
/// with some 60 pF.
const SWITCH_US: u32 = 3;

/// The core's clock, MHz.
const CORE_MHZ: u32 = 64;

/// About ten times the time of a row. A frame in which a row takes longer is abandoned and counted as missed, provided that the
/// converter can be stopped: the driver waits for this without a limit.
const ROW_TIMEOUT: Duration = Duration::from_millis(5);
/// Longest time to measure the battery.
const BATTERY_TIMEOUT: Duration = Duration::from_millis(5);
/// Time between two measurements of the battery.
const BATTERY_PERIOD: Duration = Duration::from_secs(10);

/// Range of the voltage of an empty lithium-polymer cell, mV: a further discharge would damage it, and a damaged one must not be
/// charged. With a lower voltage there is no cell, and the board has another supply.
const EMPTY_MV: Range<u32> = 1_000..3_000;
/// Number of successive measurements of an empty cell after which the board switches itself off.
const EMPTY_READINGS: u8 = 3;

/// Factor from a result of the converter, which has 14 bits, to a code, which has the scale of a sum of 16 conversions of 12
/// bits.
const CODES_PER_LSB: u16 = 4;

/// The charge of the battery, percent; 0 before the first measurement.
static BATTERY_PERCENT: AtomicU8 = AtomicU8::new(0);

/// The controller's supply, mV; 0 before the first measurement, and after a measurement that failed.
static SUPPLY_MV: AtomicU16 = AtomicU16::new(0);

/// The last measured supply of the controller, mV; `None` before the first measurement, and if the last one failed.
pub fn supply_mv() -> Option<u16> {
    Some(SUPPLY_MV.load(Ordering::Relaxed)).filter(|&supply_mv| supply_mv > 0)
}

/// True if the last measured supply is at least [`SUFFICIENT_SUPPLY_MV`], which has a margin above the 2.3 V that the flash chip
/// needs; false if [`supply_mv`] is `None`. The supply is regulated to 3.3 V.
pub fn is_supplied() -> bool {
    supply_mv().is_some_and(|supply_mv| supply_mv >= SUFFICIENT_SUPPLY_MV)
}

/// The last measured charge of the battery, percent.
pub fn battery_percent() -> u8 {
    BATTERY_PERCENT.load(Ordering::Relaxed)
}

/// The shift register (74HC595): bits 0 to 3 are the address of the row, bit 4 connects the row, bits 5 and 6 are the address of
/// the multiplexers.
pub struct ShiftRegister {
    /// The next bit, which the register reads at the rising edge of the clock.
    pub data: Output<'static>,
    /// The clock.
    pub clock: Output<'static>,
    /// Outputs the bits at its rising edge.
    pub latch: Output<'static>,
}

/// The bit that connects the selected row to ground.
const CONNECT: u8 = 1 << 4;
/// Position of the lowest address bit of the multiplexers in the bits of the register.
const CHANNEL_SHIFT: usize = 5;

impl ShiftRegister {
    /// Outputs these bits.
    fn output(&mut self, bits: u8) {
        /// Each level lasts for at least this number of cycles, 94 ns: with a supply of 3.3 V, the register needs some 45 ns from
        /// the data to the edge of the clock, and some 30 ns for a pulse (between the values for 2 V and 4.5 V in its data
        /// sheet).
        const LEVEL_CYCLES: u32 = 6;
        let hold = || wait_cycles(LEVEL_CYCLES);
        for bit in (0..u8::BITS).rev() {
            self.data.set_level((bits >> bit & 1 == 1).into());
            hold();
            self.clock.set_high();
            hold();
            self.clock.set_low();
        }
        hold();
        self.latch.set_high();
        hold();
        self.latch.set_low();
    }
}

/// The sensor matrix and the battery, which share the converter.
pub struct ResistiveMatrix {
    /// The converter.
    pub adc: Peri<'static, peripherals::SAADC>,
    /// The inputs of the columns: of the columns 0 to 3, 4 to 7, and so on.
    pub inputs: [AnyInput<'static>; INPUTS],
    /// The input of the battery.
    pub battery: AnyInput<'static>,
    /// The register of the row switch and the multiplexers.
    pub register: ShiftRegister,
    /// Switches the supply of the front end.
    pub supply: Output<'static>,
    /// The timer for settling times.
    pub timer: Microseconds,
    /// When the battery was last measured.
    pub measured_at: Instant,
    /// Number of successive measurements of an empty cell.
    pub empty_readings: u8,
}

impl ResistiveMatrix {
    /// Measures the battery and the controller's supply. The front end must be off, because its current lowers the
    /// battery's voltage.
    pub async fn measure_battery(&mut self) {
        let mut battery = ChannelConfig::single_ended(self.battery.reborrow());
        battery.gain = Gain::Gain1_3;
        // The source resistance of the divider is 340 kOhm. The product specification of the nRF52840 (SAADC, acquisition time)
        // requires 20 us for up to 400 kOhm, and 40 us for up to 800 kOhm.
        battery.time = Time::_40US;
        // With two channels the converter remains in scan mode: it loses events after a change to a single channel (erratum 212).
        let channels = [battery, ChannelConfig::single_ended(VddInput)];
        let mut adc = Saadc::new(self.adc.reborrow(), Irqs, Config::default(), channels);
        let mut codes = [0; 2];
        let is_measured = with_timeout(BATTERY_TIMEOUT, adc.sample(&mut codes)).await.is_ok();
        drop(adc);
        // Only now, because the end of the start can cancel a measurement.
        self.measured_at = Instant::now();
        if !is_measured {
            // A supply of 0 means that it is unknown; nothing is then written to the flash chip.
            return SUPPLY_MV.store(0, Ordering::Relaxed);
        }
        let battery_mv = battery::millivolts(codes[0]);
        BATTERY_PERCENT.store(battery::percent(battery_mv), Ordering::Relaxed);
        SUPPLY_MV.store(battery::supply_millivolts(codes[1]), Ordering::Relaxed);
        let has_usb_power = pac::POWER.usbregstatus().read().vbusdetect();
        let is_empty = EMPTY_MV.contains(&battery_mv) && !has_usb_power;
        self.empty_readings = if is_empty { self.empty_readings + 1 } else { 0 };
        if self.empty_readings >= EMPTY_READINGS {
            defmt::error!("the battery is empty: the board switches itself off until it is charged");
            pac::POWER.systemoff().write(|w| w.set_systemoff(true));
            // With a debug probe, the controller does not switch off, and continues here.
            self.empty_readings = 0;
        }
    }

    /// Measures the battery and the controller's supply at regular intervals. For the time before scans begin: the start may
    /// erase the flash chip, for which the supply must be known.
    pub async fn watch_supply(&mut self) -> Infallible {
        loop {
            Timer::at(self.measured_at + BATTERY_PERIOD).await;
            self.measure_battery().await;
        }
    }

    /// Supplies the front end.
    async fn switch_on(&mut self) {
        self.supply.set_high();
        self.timer.wait(START_US).await;
    }

    /// Removes the supply of the front end. Its inputs are low, so that no current flows into them.
    fn switch_off(&mut self) {
        self.register.output(0);
        self.supply.set_low();
    }

    /// Reads the columns of a row, and increments `progress` after each wait.
    async fn read_columns(&mut self, row: usize, progress: &Cell<u32>) -> [u16; COLUMNS] {
        let mut config = Config::default();
        config.resolution = Resolution::_14bit;
        config.oversample = Oversample::Over4x;
        let channels = self.inputs.each_mut().map(|input| {
            let mut channel = ChannelConfig::single_ended(input.reborrow());
            // The reference is a fraction of the supply, as the signals are, so that the supply cancels.
            channel.reference = Reference::VDD1_4;
            channel.gain = Gain::Gain1_4;
            channel.time = Time::_3US;
            channel
        });
        let mut adc = Saadc::new(self.adc.reborrow(), Irqs, config, channels);
        let mut codes = [0; COLUMNS];
        for channel in 0..CHANNELS {
            self.register.output(row as u8 | CONNECT | (channel as u8) << CHANNEL_SHIFT);
            if channel == 0 {
                self.timer.wait(SETTLE_US).await;
                progress.set(progress.get() + 1);
            } else {
                // Waiting for an interrupt would take longer.
                wait_cycles(SWITCH_US * CORE_MHZ);
            }
            let mut converted = [0; INPUTS];
            adc.sample(&mut converted).await;
            progress.set(progress.get() + 1);
            for (input, code) in converted.into_iter().enumerate() {
                // Offsets can make a code negative; the largest one is 16,383.
                codes[input * CHANNELS + channel] = code.max(0).unsigned_abs() * CODES_PER_LSB;
            }
        }
        codes
    }
}

/// The output of `operation`; `None` after the timeout. Unlike `with_timeout`, it polls its timer only at first and after a wake
/// without progress: the converter wakes the scan in each group of columns, and each poll of a timer costs more than the wake.
/// `operation` counts its progress. A wake without progress may come from the timer of an earlier row: the time driver stores
/// only one wake-up time for each task, the earliest, so it may store the timeout of this row only when the timer is polled
/// again. If that wake coincides with progress, the timer is not polled again: if the converter then stops in the same row, the
/// supervision restarts the board.
async fn within<T>(timeout: Duration, progress: &Cell<u32>, operation: impl Future<Output = T>) -> Option<T> {
    let (mut operation, mut timer) = (pin!(operation), pin!(Timer::after(timeout)));
    let mut is_armed = false;
    poll_fn(|context| {
        let before = progress.get();
        if let Poll::Ready(output) = operation.as_mut().poll(context) {
            return Poll::Ready(Some(output));
        }
        if !is_armed || progress.get() == before {
            is_armed = true;
            return timer.as_mut().poll(context).map(|()| None);
        }
        Poll::Pending
    })
    .await
}

impl Matrix for ResistiveMatrix {
    fn rows(&self) -> usize {
        ROWS
    }

    async fn read_row(&mut self, _seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
        if row == 0 {
            if self.measured_at.elapsed() >= BATTERY_PERIOD {
                self.measure_battery().await;
            }
            self.switch_on().await;
        }
        let progress = Cell::new(0);
        let converted = within(ROW_TIMEOUT, &progress, self.read_columns(row, &progress)).await;
        if row + 1 == ROWS || converted.is_none() {
            self.switch_off();
        }
        for (&cell, code) in WIRING.get(row).into_iter().flatten().zip(converted.ok_or(MatrixTimeout)?) {
            if let Some(cell) = cell {
                codes[usize::from(cell)] = if code < CLIPPED_CODE { code } else { FULL_CODE };
            }
        }
        Ok(())
    }
}
