//! Finds the source locations of the calls whose addresses are in an insole's crash report.

use addr2line::Loader;
use anyhow::{Result, anyhow, ensure};
use std::path::Path;

/// Number of hex digits of an address.
const DIGITS: usize = 8;

/// Prints each address in `report` with its function and source location, and those of the functions inlined there. A word of
/// eight hex digits is an address, also after `0x` and next to punctuation; other words are skipped.
pub fn run(firmware: &Path, report: &str) -> Result<()> {
    let in_file = |error: Box<dyn std::error::Error>| anyhow!("{}: {error}", firmware.display());
    let loader = Loader::new(firmware)
        .map_err(|error| anyhow!("{}: {error}; build it with `cargo xtask build`", firmware.display()))?;
    let words = report.split(|letter: char| !letter.is_ascii_alphanumeric());
    let digits = words.map(|word| word.strip_prefix("0x").unwrap_or(word)).filter(|digits| digits.len() == DIGITS);
    let addresses: Vec<u64> = digits.filter_map(|digits| u64::from_str_radix(digits, 16).ok()).collect();
    ensure!(
        !addresses.is_empty(),
        "no address in the report: pass the part of it with the addresses, which have {DIGITS} hex digits, such as 0800a1b2"
    );
    for address in addresses {
        println!("{address:08x}");
        let mut frames = loader.find_frames(address).map_err(in_file)?;
        while let Some(frame) = frames.next().map_err(|error| in_file(error.into()))? {
            let function = frame.function.and_then(|name| Some(name.demangle().ok()?.into_owned()));
            let place = frame.location.and_then(|at| Some(format!("{}:{}", at.file?, at.line?)));
            println!("    {}  {}", function.as_deref().unwrap_or("?"), place.as_deref().unwrap_or("?"));
        }
    }
    Ok(())
}
