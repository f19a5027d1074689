//! USARTs of the emulated STM32F405. Reception is by interrupt; the emulated transmitter accepts every byte immediately
//! and, before QEMU 8.2, has no interrupt.

use cortex_m::peripheral::NVIC;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embedded_io_async::{ErrorType, Read, Write};
use stm32_metapac::Interrupt;
use stm32_metapac::usart::Usart;

/// A USART with its receive buffer.
pub struct Port {
    registers: Usart,
    interrupt: Interrupt,
    /// Received bytes that no task has read yet. While this buffer is full, the emulator delays further bytes, so no byte is
    /// lost.
    received: Pipe<CriticalSectionRawMutex, 288>,
}

impl Port {
    /// A port that is not enabled yet.
    pub const fn new(registers: Usart, interrupt: Interrupt) -> Self {
        Self { registers, interrupt, received: Pipe::new() }
    }

    /// Enables the port and its request of an interrupt for each received byte; the caller then unmasks the interrupt. The
    /// handler of the interrupt must call [`Port::on_interrupt`]. The emulator ignores bit rates.
    pub fn start(&self) {
        self.registers.cr1().write(|w| {
            w.set_ue(true);
            w.set_re(true);
            w.set_te(true);
            w.set_rxneie(true);
        });
    }

    /// Moves a received byte from the USART to the receive buffer or, if it is full, masks the interrupt until [`Port::read`].
    /// The handler of the USART's interrupt must call this function.
    pub fn on_interrupt(&self) {
        if self.received.is_full() {
            // `read` unmasks the interrupt again. Clearing RXNEIE in the register CR1 would not suffice: before QEMU 8.2, the
            // request of a byte remains until the byte is read, so this handler would be called without end.
            NVIC::mask(self.interrupt);
        } else if self.registers.sr().read().rxne() {
            let byte = self.registers.dr().read().dr() as u8;
            // The buffer is not full, and this is the only writer.
            let _ = self.received.try_write(&[byte]);
        }
    }

    /// Waits for received bytes, copies them to `buffer`, and returns their number.
    pub async fn read(&self, buffer: &mut [u8]) -> usize {
        let len = self.received.read(buffer).await;
        // SAFETY: the port is in use, so everything that the handler uses is initialised; no critical section depends on the
        // mask.
        unsafe { NVIC::unmask(self.interrupt) };
        len
    }

    /// Sends all bytes. The status register is not read, because its value is known, and because each read of it wakes the thread
    /// of the emulator that serves the ports.
    pub fn write(&self, bytes: &[u8]) {
        for &byte in bytes {
            self.registers.dr().write(|w| w.set_dr(byte.into()));
        }
    }
}

/// A handle of a port with the traits of `embedded-io-async`: a task can read through one handle while another writes through a
/// second one.
pub struct PortHandle(pub &'static Port);

impl ErrorType for PortHandle {
    type Error = core::convert::Infallible;
}

impl Read for PortHandle {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Self::Error> {
        Ok(self.0.read(buffer).await)
    }
}

impl Write for PortHandle {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        self.0.write(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}
