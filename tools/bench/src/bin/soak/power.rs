//! Tests the storage with power cuts in every operation of the flash chip.

use anyhow::{Error, Result};
use bench::Figures;
use std::path::Path;
use testkit::nor_flash::Torn;
use testkit::power_cuts::Bench;
use testkit::store_script::Script;

/// Tests the store on a simulated chip: power fails before, within and after each operation of two fixed sequences of storage
/// calls. `short` tests only every eleventh operation.
pub fn test_store(short: bool, figures: &mut Figures) -> Result<()> {
    let stride = if short { 11 } else { 1 };
    let (mut cuts, mut operations, mut erasures) = (0u64, 0, 0);
    // The first sequence starts with a new chip, the second one with one after 12,000 storage calls, which reuses its sectors.
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
    figures.add(
        "power.script_operations",
        operations,
        "write and erase operations of two sequences of storage calls on a simulated chip",
    );
    figures.add("power.script_erasures", erasures, "erase operations among these");
    figures.add(
        "power.cuts",
        cuts,
        "power cuts in these operations; the chip always had the old or the new state afterwards, or, of an acknowledgement of \
         several steps, the state with some of them deleted",
    );
    Ok(())
}

/// Tests the real firmware in the emulator: power fails during sessions that store data of every kind. `short` tests every
/// seventh operation of one session.
pub fn test_firmware(firmware: &Path, short: bool, figures: &mut Figures) -> Result<()> {
    /// The test ends after at least this number of power cuts.
    const CUTS: u32 = 1000;
    let mut bench = Bench::new(firmware);
    let (mut cuts, mut rounds) = (0, 0);
    while rounds == 0 || (!short && cuts < CUTS) {
        cuts += bench.round(if short { 7 } else { 1 });
        rounds += 1;
        eprintln!("{cuts} power cuts in {rounds} sessions");
    }
    figures.add(
        "power.firmware_sessions",
        rounds,
        "sessions with the real firmware, each with the chip as the previous one left it",
    );
    figures.add(
        "power.firmware_cuts",
        cuts,
        "power cuts in these sessions; the insole always had the old or the new state afterwards",
    );
    Ok(())
}
