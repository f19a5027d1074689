//! Bluetooth of the emulated board: a controller on the host, by HCI over USART2.

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use plantar::ble::{BONDS_BYTES, Board, BondStore};
use plantar::emulation::BONDS_FILE;
use semihosting::fs::{self, File};
use semihosting::io::{Read as _, Write as _};

/// A new file of bonds, until it is whole.
const NEW_BONDS_FILE: &core::ffi::CStr = c"bonds.new";

/// What the emulator stands for.
pub struct Emulated {
    pub address: [u8; 6],
    pub bonding: Duration,
}

impl Board for Emulated {
    fn address(&self) -> Option<[u8; 6]> {
        Some(self.address)
    }

    fn battery_percent(&self) -> u8 {
        // A mains adapter, as it were.
        100
    }

    fn allows_bonding(&self) -> bool {
        Instant::now().as_micros() < self.bonding.as_micros()
    }
}

/// A file on the host: the machine's flash cannot be written.
pub struct BondsFile {
    /// It is neither read nor written.
    pub is_ignored: bool,
}

impl BondStore for BondsFile {
    fn load(&mut self, bytes: &mut [u8; BONDS_BYTES]) -> usize {
        if self.is_ignored {
            return 0;
        }
        File::open(BONDS_FILE).and_then(|mut file| file.read(bytes)).unwrap_or(0)
    }

    fn save(&mut self, bytes: &[u8]) {
        if self.is_ignored {
            return;
        }
        let written = File::create(NEW_BONDS_FILE).and_then(|mut file| file.write_all(bytes));
        // What cannot be kept is forgotten at the next reset, and the phone bonds again.
        let _ = written.and_then(|()| fs::rename(NEW_BONDS_FILE, BONDS_FILE));
    }
}

/// Takes bytes from one to the other, for ever.
pub async fn pump(mut from: impl Read, mut to: impl Write) -> ! {
    let mut bytes = [0; 32];
    loop {
        let len = from.read(&mut bytes).await.unwrap_or(0);
        // Neither end can fail.
        let _ = to.write_all(&bytes[..len]).await;
    }
}
