//! The flash chip: a W25Q128 (16 MiB), or a smaller one of this series with at least 2 MiB, on SPI2, with DMA.
//!
//! The controller's own flash is not written while the radio runs: erasing it stops the core for milliseconds, and must be agreed
//! with the radio's core by a protocol of its own.

use embassy_stm32::gpio::{Output, Pull};
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{DMA1_CH2, DMA1_CH3, PB13, PB14, PB15, SPI2};
use embassy_stm32::spi::mode::Master;
use embassy_stm32::spi::{self, Spi};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Peri, bind_interrupts, dma, pac};
use embassy_time::{Delay, Timer};
use embedded_hal_bus::spi::ExclusiveDevice;
use plantar::storage::flash_map::{LARGEST_CHIP, SMALLEST_CHIP};
use plantar::storage::supplied::Supplied;
use w25::{JedecId, Q, W25};

bind_interrupts!(struct Irqs {
    DMA1_CHANNEL2 => dma::InterruptHandler<DMA1_CH2>;
    DMA1_CHANNEL3 => dma::InterruptHandler<DMA1_CH3>;
});

/// Bit rate of the SPI: the transfer of a step, up to 490 bytes, takes 0.25 ms, and the chip needs longer to program it. The
/// chip allows 50 MHz, but wires on a breadboard do not.
const BIT_HZ: u32 = 16_000_000;

/// The chip, which is written and erased only while its supply is sufficient.
pub type Chip =
    Supplied<W25<Q, ExclusiveDevice<Spi<'static, Async, Master>, Output<'static>, Delay>, (), ()>, fn() -> bool>;

/// The setting of the voltage detector for 2.8 V. The chip works from 2.7 V on.
const SUPPLY_LEVEL: u8 = 5;
/// Number of times that the identity of the chip is read, a millisecond apart.
const IDENTITY_READS: usize = 5;

/// Waits until the supply is high enough for the chip.
async fn supplied() {
    pac::PWR.cr2().modify(|w| {
        w.set_pls(SUPPLY_LEVEL);
        w.set_pvde(true);
    });
    // The detector needs some microseconds.
    Timer::after_millis(1).await;
    while !is_supplied() {
        Timer::after_millis(1).await;
    }
}

/// True if the supply is above [`SUPPLY_LEVEL`]. The detector must have been started.
fn is_supplied() -> bool {
    !pac::PWR.sr2().read().pvdo()
}

/// Time in which a chip leaves its power-down mode, us. A W25Q needs 3 us, and chips of other manufacturers up to 30 us.
const WAKE_US: u64 = 30;

/// Opens the chip once its supply is high enough and it is ready; the caller limits the time. Returns `None` unless each read of
/// the identity shows the manufacturer of these chips and the same capacity, at least [`SMALLEST_CHIP`]. Without a chip, and from
/// one that does not work yet, the controller reads 0.
pub async fn open(
    spi: Peri<'static, SPI2>,
    clock: Peri<'static, PB13>,
    to_chip: Peri<'static, PB15>,
    from_chip: Peri<'static, PB14>,
    send: Peri<'static, DMA1_CH2>,
    receive: Peri<'static, DMA1_CH3>,
    select: Output<'static>,
) -> Option<Chip> {
    supplied().await;
    let mut config = spi::Config::default();
    config.frequency = Hertz(BIT_HZ);
    config.miso_pull = Pull::Down;
    let spi = Spi::new(spi, clock, to_chip, from_chip, send, receive, Irqs, config);
    // Neither a pin of this controller nor its SPI as master can fail. `unwrap` is not used, because it needs errors with
    // `Debug`: the first error lacks it, and the texts of the second would take kilobytes.
    let device = ExclusiveDevice::new(spi, select, Delay).unwrap_or_else(|_| unreachable!());
    let mut chip = W25::new_no_pins(device, LARGEST_CHIP).await.unwrap_or_else(|_| unreachable!());
    // Other firmware may have left the chip in power-down mode, in which it ignores all other commands. As above, this cannot
    // fail.
    let _ = chip.disable_power_down_mode().await;
    Timer::after_micros(WAKE_US).await;
    let mut first = None;
    for _ in 0..IDENTITY_READS {
        let identity = chip.jedec_id().await.ok().filter(|id| id.manufacturer() == JedecId::MANUFACTURER)?;
        let bytes = identity.major_device_id().ok()?.capacity();
        if bytes < SMALLEST_CHIP || *first.get_or_insert(bytes) != bytes {
            return None;
        }
        Timer::after_millis(1).await;
    }
    Some(Supplied::new(chip, first?.min(LARGEST_CHIP), is_supplied))
}
