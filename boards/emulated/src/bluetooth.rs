//! Bluetooth of the emulated board: a controller on the host, by HCI over USART2.

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use plantar::firmware::board::BluetoothBoard;

/// The Bluetooth configuration of the emulated board.
pub struct Emulated {
    /// The random static address.
    pub address: [u8; 6],
    /// Time after the start in which a central can bond.
    pub bonding: Duration,
    /// Charge of the battery, percent; `None` for a board that does not measure it.
    pub battery_percent: Option<u8>,
}

impl BluetoothBoard for Emulated {
    fn address(&self) -> Option<[u8; 6]> {
        Some(self.address)
    }

    fn battery_percent(&self) -> Option<u8> {
        self.battery_percent
    }

    fn allows_bonding(&self) -> bool {
        Instant::now().as_micros() < self.bonding.as_micros()
    }
}

/// Copies all bytes of `from` to `to`. Never returns.
pub async fn pump(mut from: impl Read, mut to: impl Write) -> ! {
    let mut bytes = [0; 32];
    loop {
        let len = from.read(&mut bytes).await.unwrap_or(0);
        // Neither the ports nor the pipes can fail.
        let _ = to.write_all(&bytes[..len]).await;
    }
}
