//! Power that fails in any operation of the flash chip.

use anyhow::{Error, Result};
use figures::Figures;
use std::path::Path;
use testkit::nor_flash::Torn;
use testkit::power::Script;
use testkit::switched_off::Bench;

/// The store on a chip in memory: power fails before, within and after operations of scripts.
pub fn in_memory(short: bool, figures: &mut Figures) -> Result<()> {
    let stride = if short { 11 } else { 1 };
    let (mut cuts, mut operations, mut erasures) = (0u64, 0, 0);
    // A chip as new, and one whose sectors are used again.
    for (seed, used) in [(1, 0), (2, 12_000)] {
        let script = Script::new(seed, used, 400);
        operations += script.operations;
        erasures += script.erasures;
        for at in (0..script.operations).step_by(stride) {
            for torn in [Torn::Before, Torn::Within, Torn::After] {
                script.cut(at, torn).map_err(Error::msg)?;
                cuts += 1;
            }
        }
    }
    figures.add("power.script_operations", operations, "writes and erasures of the scripts");
    figures.add("power.script_erasures", erasures, "erasures among them");
    figures.add("power.cuts", cuts, "losses of power: each time the old or the new was there");
    Ok(())
}

/// The real firmware: power fails in operations of sessions that keep everything.
pub fn of_the_firmware(firmware: &Path, short: bool, figures: &mut Figures) -> Result<()> {
    const CUTS: u32 = 1000;
    let mut bench = Bench::new(firmware);
    let (mut cuts, mut rounds) = (0, 0);
    while rounds == 0 || (!short && cuts < CUTS) {
        cuts += bench.round(if short { 7 } else { 1 });
        rounds += 1;
        eprintln!("{cuts} losses of power in {rounds} sessions");
    }
    figures.add(
        "power.firmware_sessions",
        rounds,
        "sessions with the real firmware, each on the chip that the one before left",
    );
    figures.add("power.firmware_cuts", cuts, "losses of power in them: each time it started with the old or the new");
    Ok(())
}
