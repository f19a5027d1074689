//! The resistive matrix: a row at ground through its transistor, all columns through ADC1 into memory by DMA.
//!
//! Time of a row at 64 MHz (`docs/hardware.md`): 37 us for settling, 16 columns x 16 conversions x 25 cycles = 100 us for the
//! conversions, and an allowance of 35 us for set-up and wake-ups. 16 rows take 2.75 ms; with the first conversion, which is
//! discarded, a scan takes 2.79 ms. Frame rates above 333 Hz are not supported: if a scan does not fit into a frame, the next one
//! starts late, and a frame time that has passed by then counts as missed.
//!
//! Between scans no row is connected and, at frame rates that leave the time for it, the front end has no supply.

use core::sync::atomic::{AtomicU16, Ordering};
use embassy_stm32::adc::vals::{OversamplingRatio, OversamplingShift, Rovsm, Trovs};
use embassy_stm32::adc::{Adc, AdcChannel, AdcConfig, AnyAdcChannel, SampleTime};
use embassy_stm32::gpio::Output;
use embassy_stm32::peripherals::{ADC1, DMA1_CH1};
use embassy_stm32::{Peri, bind_interrupts, dma, pac};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use plantar::firmware::board::{Matrix, MatrixTimeout};
use plantar::firmware::front_end::{self, CLIPPED_CODE};
use plantar::firmware::layout::{COLUMNS, ROWS, WIRING};
use plantar::pipeline::calibrate::FULL_CODE;
use plantar::pipeline::setup::DEVICE_CELLS;

bind_interrupts!(struct Irqs {
    DMA1_CHANNEL1 => dma::InterruptHandler<DMA1_CH1>;
});

/// Settling time after a change of the row, which `cargo xtask hardware` compares with the simulated front end.
const SETTLE: Duration = Duration::from_micros(front_end::SETTLE_US as u64);

/// Time from switching on the supply of the front end to the first row, which `cargo xtask hardware` compares with the
/// simulated front end.
const FRONT_END_START: Duration = Duration::from_micros(front_end::START_US as u64);
/// Shortest time between frames at which the front end is switched off between scans, us. A scan with the start of the front end
/// takes 3.3 ms.
const SWITCHING_PERIOD_US: u32 = 4_000;

/// Sampling time of a conversion: four time constants of the 150 ohm and 330 pF at each input. Only the first of 16 conversions
/// starts with the charge of another column.
const SAMPLE: SampleTime = match front_end::SAMPLE_HALF_CYCLES {
    25 => SampleTime::CYCLES12_5,
    49 => SampleTime::CYCLES24_5,
    95 => SampleTime::CYCLES47_5,
    _ => panic!("the converter has no such sampling time"),
};

/// Ten times the conversion time of a row. A frame in which a row takes longer is abandoned and counted as missed. The
/// measurement of the supply has the same limit; if it takes longer, no frame is missed.
const CONVERSION_TIMEOUT: Duration = Duration::from_millis(1);

/// Time between two measurements of the supply.
const SUPPLY_PERIOD: Duration = Duration::from_secs(10);
/// Sampling time of the internal reference, which needs at least 4 us: 10 us at 64 MHz.
const REFERENCE_SAMPLE: SampleTime = SampleTime::CYCLES640_5;
/// The supply at which the manufacturer measured the reference of each controller, mV (DS11929, internal voltage reference).
const CALIBRATION_MV: u32 = 3_600;

/// The supply, mV; 0 until it is measured.
static SUPPLY_MV: AtomicU16 = AtomicU16::new(0);

/// The supply, mV; `None` until the first measurement.
pub fn supply_mv() -> Option<u16> {
    Some(SUPPLY_MV.load(Ordering::Relaxed)).filter(|&supply_mv| supply_mv > 0)
}

/// The sensor matrix, between row decoder and converter.
pub struct ResistiveMatrix {
    adc: Adc<'static, ADC1>,
    dma: Peri<'static, DMA1_CH1>,
    columns: [AnyAdcChannel<'static, ADC1>; COLUMNS],
    /// Address lines of the row decoder, the least significant bit first.
    address: [Output<'static>; 4],
    /// High: no row is connected.
    rows_off: Output<'static>,
    /// High: the front end has a supply.
    front_end: Output<'static>,
    /// The front end is switched off between scans.
    is_switched: bool,
    /// The converter's input for the internal reference voltage.
    reference: AnyAdcChannel<'static, ADC1>,
    /// The supply is measured at the end of the first scan after this time.
    supply_due: Instant,
}

impl ResistiveMatrix {
    /// Calibrates the converter and configures it to return sums of 16 conversions.
    pub fn new(
        adc: Peri<'static, ADC1>,
        dma: Peri<'static, DMA1_CH1>,
        columns: [AnyAdcChannel<'static, ADC1>; COLUMNS],
        address: [Output<'static>; 4],
        rows_off: Output<'static>,
        front_end: Output<'static>,
    ) -> Self {
        let config = AdcConfig {
            oversampling_ratio: Some(OversamplingRatio::RATIO16),
            oversampling_shift: Some(OversamplingShift::SHIFT0),
            oversampling_mode: Some((Rovsm::CONTINUED, Trovs::AUTOMATIC, true)),
            ..Default::default()
        };
        let adc = Adc::new_with_config(adc, config);
        let reference = adc.enable_vrefint().degrade_adc();
        let (is_switched, supply_due) = (false, Instant::MIN);
        Self { adc, dma, columns, address, rows_off, front_end, is_switched, reference, supply_due }
    }

    /// Adapts the matrix to the time between frames, us.
    pub fn set_period(&mut self, period_us: u32) {
        self.is_switched = period_us >= SWITCHING_PERIOD_US;
    }

    /// Disconnects all rows, then connects this one.
    fn select(&mut self, row: usize) {
        self.rows_off.set_high();
        for (bit, line) in self.address.iter_mut().enumerate() {
            line.set_level((row >> bit & 1 == 1).into());
        }
        self.rows_off.set_low();
    }

    /// Converts the first `N` columns; the core sleeps meanwhile.
    async fn convert<const N: usize>(&mut self) -> Result<[u16; N], MatrixTimeout> {
        let mut codes = [0; N];
        let sequence = self.columns.iter_mut().take(N).map(|column| (column, SAMPLE));
        let read = self.adc.read(self.dma.reborrow(), Irqs, sequence, &mut codes);
        with_timeout(CONVERSION_TIMEOUT, read).await.map_err(|_| MatrixTimeout)?;
        Ok(codes)
    }

    /// Converts all columns of a row. Before the first row, switches the front end on if it is off between scans, and discards
    /// one conversion.
    async fn convert_row(&mut self, row: usize) -> Result<[u16; COLUMNS], MatrixTimeout> {
        if row == 0 {
            if self.is_switched {
                self.front_end.set_high();
                Timer::after(FRONT_END_START).await;
            }
            // The first conversion after a pause of more than 1 ms may be wrong (errata sheet of the STM32WB55, ADC).
            self.convert::<1>().await?;
        }
        self.select(row);
        Timer::after(SETTLE).await;
        self.convert::<COLUMNS>().await
    }

    /// Measures the supply if a measurement is due.
    async fn measure_supply(&mut self) -> Result<(), MatrixTimeout> {
        if Instant::now() < self.supply_due {
            return Ok(());
        }
        self.supply_due = Instant::now() + SUPPLY_PERIOD;
        let mut code = [0; 1];
        let sequence = core::iter::once((&mut self.reference, REFERENCE_SAMPLE));
        let read = self.adc.read(self.dma.reborrow(), Irqs, sequence, &mut code);
        with_timeout(CONVERSION_TIMEOUT, read).await.map_err(|_| MatrixTimeout)?;
        // The code is the sum of 16 conversions (RM0434, "Calculating the actual VDDA voltage").
        let calibration = u32::from(pac::VREFINTCAL.data().read());
        let supply_mv = (CALIBRATION_MV * calibration * 16).checked_div(code[0].into()).unwrap_or(0);
        SUPPLY_MV.store(supply_mv.try_into().unwrap_or(u16::MAX), Ordering::Relaxed);
        Ok(())
    }
}

impl Matrix for ResistiveMatrix {
    fn rows(&self) -> usize {
        ROWS
    }

    async fn read_row(&mut self, _seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
        let converted = self.convert_row(row).await;
        // Between rows and frames no cell draws current.
        self.rows_off.set_high();
        let is_end = row + 1 == ROWS || converted.is_err();
        if is_end && self.is_switched {
            self.front_end.set_low();
        }
        if is_end {
            // The frame is complete without the supply, which is measured again after `SUPPLY_PERIOD`.
            let _ = self.measure_supply().await;
        }
        for (&cell, code) in WIRING.get(row).into_iter().flatten().zip(converted?) {
            if let Some(cell) = cell {
                codes[usize::from(cell)] = if code < CLIPPED_CODE { code } else { FULL_CODE };
            }
        }
        Ok(())
    }
}
