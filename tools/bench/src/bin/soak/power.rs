//! Tests the storage with losses of power in any operation of the flash chip.

use anyhow::{Error, Result};
use bench::Figures;
use std::path::Path;
use testkit::nor_flash::Torn;
use testkit::power_cuts::Bench;
use testkit::store_script::Script;

/// Tests the store on a chip in memory: power fails before, within and after each operation of two scripts.
pub fn in_memory(short: bool, figures: &mut Figures) -> Result<()> {
    let stride = if short { 11 } else { 1 };
    let (mut cuts, mut operations, mut erasures) = (0u64, 0, 0);
    // A new chip, and one whose sectors are reused.
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
    figures.add("power.cuts", cuts, "losses of power, each with the old or the new state afterwards");
    Ok(())
}

/// Tests the real firmware: power fails during sessions that store data of every kind.
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
        "sessions with the real firmware, each on the chip of the previous one",
    );
    figures.add("power.firmware_cuts", cuts, "losses of power in them, each with the old or the new state afterwards");
    Ok(())
}
