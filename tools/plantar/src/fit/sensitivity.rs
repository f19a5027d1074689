//! Repeats a fit with other choices of the method, for the report.

use crate::replay::progress;
use crate::setup::{self, ZeroArgs};
use fit::sensitivity::{Sensitivity, choices};
use fit::steps::isolate;
use fit::{Step, Study};
use plantar::pipeline::contact::ContactRule;
use recording::Recording;

/// The main results of the study with other choices. `recordings` are the recordings of the study with all cells, if all of its
/// sources are such recordings. `is_used` selects the steps of the fit by their numbers.
pub fn of(
    study: &Study,
    recordings: &[Recording],
    zero: &ZeroArgs,
    is_used: impl Fn(u32) -> bool + Sync,
) -> Sensitivity {
    let steps_by = |rule: &ContactRule| -> Result<Vec<Step>, String> {
        let mut all = Vec::new();
        for (index, recording) in recordings.iter().enumerate() {
            let mut insole = setup::insole(recording, *rule).map_err(|e| format!("{e:#}"))?;
            zero.apply(&mut insole).map_err(|e| format!("{e:#}"))?;
            let (steps, _) = isolate(recording, &insole, index, &mut |_| ()).map_err(|e| e.to_string())?;
            all.extend(steps.into_iter().filter(|step| is_used(step.number)));
        }
        Ok(all)
    };
    let has_cells = recordings.len() == study.sources.len();
    let bar = progress(8 * choices(study, has_cells).len() as u64, "fits with other choices");
    let sensitivity = Sensitivity::of(study, has_cells.then_some(&steps_by), &|| bar.inc(1));
    bar.finish_and_clear();
    sensitivity
}
