//! The resistive matrix: a row at ground through its transistor, all columns through ADC1 into memory by DMA.
//!
//! Time of a row at 64 MHz (`docs/hardware.md`): 37 us for settling, 16 columns x 16 conversions x 25 cycles = 100 us for the
//! conversions, and an allowance of 15 us for set-up and wake-ups. 16 rows take 2.43 ms, and 2.45 ms with the first conversion,
//! which is discarded, of the 2.5 ms of a frame at 400 Hz. After a longer scan, the next scan starts late, or is skipped and
//! counted.

use embassy_stm32::adc::vals::{OversamplingRatio, OversamplingShift, Rovsm, Trovs};
use embassy_stm32::adc::{Adc, AdcConfig, AnyAdcChannel, SampleTime};
use embassy_stm32::gpio::Output;
use embassy_stm32::peripherals::{ADC1, DMA1_CH1};
use embassy_stm32::{Peri, bind_interrupts, dma};
use embassy_time::{Duration, Timer, with_timeout};
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

/// Sampling time of a conversion: four time constants of the 150 ohm and 330 pF at each input. Only the first of 16 conversions
/// starts with the charge of another column.
const SAMPLE: SampleTime = match front_end::SAMPLE_HALF_CYCLES {
    25 => SampleTime::CYCLES12_5,
    49 => SampleTime::CYCLES24_5,
    95 => SampleTime::CYCLES47_5,
    _ => panic!("the converter has no such sampling time"),
};

/// Ten times the conversion time of a row. A frame in which a row takes longer is abandoned and counted as missed.
const CONVERSION_TIMEOUT: Duration = Duration::from_millis(1);

/// The sensor matrix, behind the row switch and the converter.
pub struct ResistiveMatrix {
    adc: Adc<'static, ADC1>,
    dma: Peri<'static, DMA1_CH1>,
    columns: [AnyAdcChannel<'static, ADC1>; COLUMNS],
    /// Address lines of the row decoder, the least significant bit first.
    address: [Output<'static>; 4],
    /// High: no row is connected.
    rows_off: Output<'static>,
}

impl ResistiveMatrix {
    /// Calibrates the converter and configures it to return sums of 16 conversions.
    pub fn new(
        adc: Peri<'static, ADC1>,
        dma: Peri<'static, DMA1_CH1>,
        columns: [AnyAdcChannel<'static, ADC1>; COLUMNS],
        address: [Output<'static>; 4],
        rows_off: Output<'static>,
    ) -> Self {
        let config = AdcConfig {
            oversampling_ratio: Some(OversamplingRatio::RATIO16),
            oversampling_shift: Some(OversamplingShift::SHIFT0),
            oversampling_mode: Some((Rovsm::CONTINUED, Trovs::AUTOMATIC, true)),
            ..Default::default()
        };
        Self { adc: Adc::new_with_config(adc, config), dma, columns, address, rows_off }
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
}

impl Matrix for ResistiveMatrix {
    fn rows(&self) -> usize {
        ROWS
    }

    async fn read_row(&mut self, _seq: u32, row: usize, codes: &mut [u16; DEVICE_CELLS]) -> Result<(), MatrixTimeout> {
        if row == 0 {
            // The first conversion after a pause of more than 1 ms may be wrong (an erratum of this family of converters).
            self.convert::<1>().await?;
        }
        self.select(row);
        Timer::after(SETTLE).await;
        let converted = self.convert::<COLUMNS>().await;
        // Between rows and frames no cell draws current.
        self.rows_off.set_high();
        for (&cell, code) in WIRING.get(row).into_iter().flatten().zip(converted?) {
            if let Some(cell) = cell {
                codes[usize::from(cell)] = if code < CLIPPED_CODE { code } else { FULL_CODE };
            }
        }
        Ok(())
    }
}
