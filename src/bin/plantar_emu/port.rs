//! Interrupt-driven USARTs of the emulated STM32F405, one byte an interrupt in either direction.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embedded_io_async::{ErrorType, Read, Write};
use stm32_metapac::usart::Usart;

/// A USART with its buffers.
pub struct Port {
    registers: Usart,
    received: Pipe<CriticalSectionRawMutex, 256>,
    to_send: Pipe<CriticalSectionRawMutex, 512>,
}

impl Port {
    pub const fn new(registers: Usart) -> Self {
        Self { registers, received: Pipe::new(), to_send: Pipe::new() }
    }

    /// Turns the port on; its interrupt must then call [`Port::on_interrupt`]. The emulator ignores bit rates.
    pub fn start(&self) {
        self.registers.cr1().write(|w| {
            w.set_ue(true);
            w.set_re(true);
            w.set_te(true);
            w.set_rxneie(true);
        });
    }

    pub fn on_interrupt(&self) {
        let status = self.registers.sr().read();
        if status.rxne() {
            let byte = self.registers.dr().read().dr() as u8;
            // A full buffer loses the byte; the frame it belonged to fails its CRC and is counted.
            let _ = self.received.try_write(&[byte]);
        }
        if status.txe() && self.registers.cr1().read().txeie() {
            let mut byte = [0];
            match self.to_send.try_read(&mut byte) {
                Ok(_) => self.registers.dr().write(|w| w.set_dr(byte[0].into())),
                Err(_) => self.registers.cr1().modify(|w| w.set_txeie(false)),
            }
        }
    }

    pub async fn read(&self, buffer: &mut [u8]) -> usize {
        self.received.read(buffer).await
    }

    pub async fn write(&self, bytes: &[u8]) -> usize {
        let count = self.to_send.write(bytes).await;
        // The interrupt changes the same register.
        critical_section::with(|_| self.registers.cr1().modify(|w| w.set_txeie(true)));
        count
    }
}

/// One end of a port for the link.
pub struct End(pub &'static Port);

impl ErrorType for End {
    type Error = core::convert::Infallible;
}

impl Read for End {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Self::Error> {
        Ok(self.0.read(buffer).await)
    }
}

impl Write for End {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        Ok(self.0.write(bytes).await)
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}
