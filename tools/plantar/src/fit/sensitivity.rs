//! Repeats a fit with cells that count with their whole area and, for the report, with other contact rules, filters and steps.

use super::Fit;
use crate::replay::progress;
use fit::sensitivity::{Sensitivity, choices, predicted_nrmse};
use fit::steps::isolate;
use fit::{Method, Step, Study};
use plantar::pipeline::contact::ContactRule;
use recording::{FrameSource, RecordingReader};
use std::path::Path;

impl Fit {
    /// Extracts the steps of the recordings with another contact rule.
    fn steps_by(&self, recordings: &[&Path], rule: &ContactRule) -> Result<Vec<Step>, String> {
        let mut all = Vec::new();
        for (index, path) in recordings.iter().enumerate() {
            let recording = FrameSource::from(RecordingReader::open(path).map_err(|e| e.to_string())?);
            let insole = self.stance.rule().and_then(|stance| study::virtual_insole(&recording, *rule, stance));
            let mut insole = insole.map_err(|e| format!("{e:#}"))?;
            self.zero.apply(&mut insole).map_err(|e| format!("{e:#}"))?;
            let (steps, _) =
                isolate(&insole, insole.scans(recording), index, &mut |_| ()).map_err(|e| e.to_string())?;
            all.extend(steps.into_iter().filter(|step| self.is_used(step)));
        }
        Ok(all)
    }

    /// Computes [`Study::counted_nrmse`]. `recordings` are the sources of the study that contain all cells. If another source
    /// exists, if the method is that of the paper, or if the steps cannot be extracted, all results are `None`.
    pub(super) fn counted_nrmse(&self, study: &Study, recordings: &[&Path]) -> [Option<f64>; 8] {
        // The method of the paper is too slow to be repeated.
        if recordings.len() != study.sources.len() || study.options.method != Method::Projection {
            return [None; 8];
        }
        let steps = self.steps_by(recordings, &ContactRule { full_kpa: 0.0, ..study.contact });
        steps.map_or([None; 8], |steps| predicted_nrmse(&steps, &study.options))
    }

    /// Sensitivity analysis: the main results with other contact rules, filters and steps. `recordings` are the sources of the
    /// study that contain all cells. If another source exists, the contact rule is not varied.
    pub(super) fn sensitivity(&self, study: &Study, recordings: &[&Path]) -> Sensitivity {
        let steps_by = |rule: &ContactRule| self.steps_by(recordings, rule);
        let has_cells = recordings.len() == study.sources.len();
        let bar = progress(8 * choices(study, has_cells).len() as u64, "fits of the sensitivity analysis");
        let sensitivity = Sensitivity::of(study, has_cells.then_some(&steps_by), &|| bar.inc(1));
        bar.finish_and_clear();
        sensitivity
    }
}
