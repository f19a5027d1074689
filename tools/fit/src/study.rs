//! All of one person's recordings and what was identified from them.

use crate::steps::{self, LeftOut};
use crate::{Options, RegionFit, Step, Unfit};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::SetupError;
use plantar::{Region, Side};
use recording::{Layout, Recording, VirtualInsole};

/// One recording of a [`Study`], without its pressures.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// What the user calls it: its file.
    pub name: String,
    /// Where it comes from, in sentences.
    pub origin: String,
    /// The foot.
    pub side: Side,
    /// Frames per second.
    pub rate_hz: f64,
    /// The cells.
    pub layout: Layout,
}

/// One person's steps and, once [`Study::fit`] ran, parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Whose they are.
    pub participant: String,
    /// The recordings, in the order they were added.
    pub sources: Vec<Source>,
    /// The rule that areas were counted by; parameters hold for this rule.
    pub contact: ContactRule,
    /// The steps that may be used.
    pub steps: Vec<Step>,
    /// The contacts that were left out.
    pub left_out: Vec<LeftOut>,
    /// What was fitted through and within.
    pub options: Options,
    /// Per region in the order of [`Region::ALL`]; empty before the fit.
    pub fits: Vec<Result<RegionFit, Unfit>>,
}

impl Study {
    /// No recording yet.
    pub fn new(participant: String, contact: ContactRule, options: Options) -> Self {
        Self {
            participant,
            sources: Vec::new(),
            contact,
            steps: Vec::new(),
            left_out: Vec::new(),
            options,
            fits: Vec::new(),
        }
    }

    /// Takes the steps out of a recording worn as `worn`. `progress` is told frames done.
    pub fn add(
        &mut self,
        name: String,
        recording: &Recording,
        worn: &VirtualInsole,
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), SetupError> {
        let (steps, left_out) = steps::isolate(recording, worn, self.sources.len(), progress)?;
        self.steps.extend(steps);
        self.left_out.extend(left_out);
        self.sources.push(Source {
            name,
            origin: recording.source.clone(),
            side: recording.side,
            rate_hz: recording.rate_hz,
            layout: recording.layout.clone(),
        });
        Ok(())
    }

    /// Fits all regions. `progress` is told the regions that are done, in any order.
    pub fn fit(&mut self, progress: &(dyn Fn(Region) + Sync)) {
        self.fits = crate::fit(&self.steps, &self.options, progress).into();
    }
}
