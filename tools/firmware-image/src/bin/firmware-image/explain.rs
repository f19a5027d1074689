//! Where in the source a fault was, from the addresses of calls that the insole kept.

use addr2line::Loader;
use anyhow::{Context, Result, anyhow};
use std::path::Path;

/// Digits of an address.
const DIGITS: usize = 8;

/// Prints each call in what an insole said, with the functions that were inlined there.
pub fn run(firmware: &Path, said: &str) -> Result<()> {
    let wrong = |error: Box<dyn std::error::Error>| anyhow!("{}: {error}", firmware.display());
    let loader = Loader::new(firmware).map_err(wrong).context("build it with `cargo xtask build`")?;
    let words = said.split_whitespace().filter(|word| word.len() == DIGITS);
    for address in words.filter_map(|word| u64::from_str_radix(word, 16).ok()) {
        println!("{address:08x}");
        let mut frames = loader.find_frames(address).map_err(wrong)?;
        while let Some(frame) = frames.next().map_err(|error| wrong(error.into()))? {
            let function = frame.function.and_then(|name| Some(name.demangle().ok()?.into_owned()));
            let place = frame.location.and_then(|at| Some(format!("{}:{}", at.file?, at.line?)));
            println!("    {}  {}", function.as_deref().unwrap_or("?"), place.as_deref().unwrap_or("?"));
        }
    }
    Ok(())
}
