//! Tests framing and decoding of messages with bit errors on the cable.

use anyhow::{Result, ensure};
use bench::Figures;
use fastrand::Rng;
use plantar::protocol::{Decoder, ToHost, decode};
use testkit::{framed, live, status, step};

/// Mean number of bits per bit error.
const BITS_PER_ERROR: f64 = 1e4;

/// A cable that flips bits at exponentially distributed distances.
struct NoisyCable {
    random: Rng,
    /// Number of bits that are transmitted correctly before the next bit error.
    until_error: u64,
}

impl NoisyCable {
    fn new(seed: u64) -> Self {
        let mut cable = Self { random: Rng::with_seed(seed), until_error: 0 };
        cable.until_error = cable.next_error();
        cable
    }

    /// A random number of correct bits between two bit errors.
    fn next_error(&mut self) -> u64 {
        (-(1.0 - self.random.f64()).ln() * BITS_PER_ERROR) as u64
    }

    /// Transmits bytes. Returns true if it flipped a bit of them.
    fn transmit(&mut self, bytes: &mut [u8]) -> bool {
        let bits = 8 * bytes.len() as u64;
        let mut is_damaged = false;
        let mut at = 0;
        while at + self.until_error < bits {
            at += self.until_error;
            bytes[(at / 8) as usize] ^= 1 << (at % 8);
            is_damaged = true;
            at += 1;
            self.until_error = self.next_error();
        }
        self.until_error -= (bits - at).min(self.until_error);
        is_damaged
    }
}

/// Sends frames over a noisy cable; `short` sends a tenth of them.
pub fn soak(short: bool, figures: &mut Figures) -> Result<()> {
    let frames: u32 = if short { 100_000 } else { 1_000_000 };
    let mut cable = NoisyCable::new(8);
    let mut decoder = Decoder::new();
    let (mut damaged, mut wrong, mut lost_undamaged) = (0u32, 0u32, 0u32);
    // If the delimiter at the end of a frame is damaged, the next frame is lost too, but no further one.
    let mut was_damaged = false;
    for number in 0..frames {
        let message = match number % 100 {
            0 => ToHost::Step(step(number)),
            1 => ToHost::Status(status()),
            _ => ToHost::Live(live(number)),
        };
        let mut bytes = framed(&message);
        let is_damaged = cable.transmit(&mut bytes);
        let mut decoded = 0;
        for &byte in &bytes {
            let Some(bytes) = decoder.push(byte) else { continue };
            if decode::<ToHost>(bytes).as_ref() == Some(&message) { decoded += 1 } else { wrong += 1 }
        }
        ensure!(decoded <= 1, "frame {number} was decoded twice");
        damaged += u32::from(is_damaged);
        if !is_damaged {
            lost_undamaged += 1 - decoded;
            ensure!(
                decoded == 1 || was_damaged,
                "frame {number} was not decoded, although it and the previous frame were undamaged"
            );
        }
        was_damaged = is_damaged;
    }
    ensure!(wrong == 0, "{wrong} wrong messages were decoded");
    figures.add("bits.frames", frames, "frames sent over a cable that flips one bit in 10,000");
    figures.add("bits.damaged", damaged, "of these, frames with flipped bits");
    figures.add("bits.wrong_accepted", wrong, "decoded messages that differ from the sent ones");
    figures.add(
        "bits.lost_after_damage",
        lost_undamaged,
        "undamaged frames lost because the end of the previous one was damaged",
    );
    Ok(())
}
