//! Properties of the core, the library `plantar`. A property is a function that takes an input and panics if the core behaves
//! differently from a simple, independent model.
//!
//! `tests/exhaustive.rs` calls each property for all inputs within its bounds, on any machine; `tests/stored.rs` has further
//! properties, of sequences of events on a simulated flash chip. With the harnesses in the module `harnesses`, which only Kani
//! compiles, Kani can prove some properties for all inputs at once, without running the code.

pub mod acknowledgement;
pub mod calendar;
pub mod cells;
pub mod codec;
pub mod flash;
pub mod fragments;
pub mod image;
pub mod numbers;
pub mod order;
pub mod streams;
pub mod supervision;

#[cfg(kani)]
mod harnesses;

/// Calls `check` with all sequences of up to `longest` elements of `alphabet`, the empty sequence included. Returns their number.
pub fn sequences<T: Copy>(alphabet: &[T], longest: usize, mut check: impl FnMut(&[T])) -> u64 {
    let mut count = 0;
    let mut sequence = Vec::with_capacity(longest);
    for length in 0..=longest {
        let mut digits = vec![0; length];
        loop {
            sequence.clear();
            sequence.extend(digits.iter().map(|&digit: &usize| alphabet[digit]));
            check(&sequence);
            count += 1;
            // The next sequence: the digits count up, in a number system whose base is the length of the alphabet.
            let Some(raised) = digits.iter().rposition(|&digit| digit + 1 < alphabet.len()) else { break };
            digits[raised] += 1;
            digits[raised + 1..].fill(0);
        }
    }
    count
}

/// All values of a byte.
pub fn all_bytes() -> [u8; 256] {
    core::array::from_fn(|byte| byte as u8)
}
