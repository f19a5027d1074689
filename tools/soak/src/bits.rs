//! Bit errors on the cable.

use anyhow::{Result, ensure};
use fastrand::Rng;
use figures::Figures;
use plantar::protocol::{Decoder, ToHost, decode};
use testkit::{framed, live, status, step};

/// One bit in so many is wrong.
const BITS_AN_ERROR: f64 = 1e4;

pub fn soak(short: bool, figures: &mut Figures) -> Result<()> {
    let frames: u32 = if short { 100_000 } else { 1_000_000 };
    let mut random = Rng::with_seed(8);
    let mut decoder = Decoder::new();
    // Bits until the next error: exponential.
    let next_error = |random: &mut Rng| (-(1.0 - random.f64()).ln() * BITS_AN_ERROR) as u64;
    let mut until_error = next_error(&mut random);
    let (mut damaged, mut wrong, mut lost_whole, mut arrived) = (0u32, 0u32, 0u32, 0u32);
    // A frame whose end was damaged swallows the one after it; no more than that one.
    let mut was_damaged = false;
    for number in 0..frames {
        let message = match number % 100 {
            0 => ToHost::Step(step(number)),
            1 => ToHost::Status(status()),
            _ => ToHost::Live(live(number)),
        };
        let mut bytes = framed(&message);
        let mut errors = 0;
        let bits = 8 * bytes.len() as u64;
        let mut at = 0;
        while at + until_error < bits {
            at += until_error;
            bytes[(at / 8) as usize] ^= 1 << (at % 8);
            errors += 1;
            at += 1;
            until_error = next_error(&mut random);
        }
        until_error -= (bits - at).min(until_error);
        let mut got = 0;
        for &byte in &bytes {
            let Some(bytes) = decoder.push(byte) else { continue };
            let decoded = decode::<ToHost>(bytes);
            if decoded.as_ref() == Some(&message) { got += 1 } else { wrong += 1 }
        }
        arrived += got;
        damaged += u32::from(errors > 0);
        if errors == 0 {
            lost_whole += 1 - got;
            ensure!(got == 1 || was_damaged, "frame {number} was whole, so was the one before, and it was not taken");
        }
        was_damaged = errors > 0;
    }
    ensure!(wrong == 0, "{wrong} wrong messages were taken");
    ensure!(arrived + damaged + lost_whole >= frames, "frames are missing");
    figures.add("bits.frames", frames, "frames sent with one bit in 10,000 wrong");
    figures.add("bits.damaged", damaged, "of them with wrong bits");
    figures.add("bits.wrong_accepted", wrong, "messages taken that were not sent");
    figures.add(
        "bits.lost_after_damage",
        lost_whole,
        "whole frames lost because the end of the one before was damaged",
    );
    Ok(())
}
