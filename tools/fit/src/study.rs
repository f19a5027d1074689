//! The identification of one person: the recordings, their steps, and the identified parameters.

use crate::steps::{self, ExcludedContact};
use crate::{NotFitted, Options, RegionFit, Step};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::SetupError;
use plantar::{Region, Side};
use recording::{Layout, Recording, VirtualInsole};

/// One recording of a [`Study`], without its pressures.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Name for display: the name of the file.
    pub name: String,
    /// Provenance, in sentences.
    pub origin: String,
    /// The foot.
    pub side: Side,
    /// Frames per second.
    pub rate_hz: f64,
    /// The cells.
    pub layout: Layout,
}

/// The identification of one person: the recordings, their steps and, after [`Study::fit`], the parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Name of the person.
    pub participant: String,
    /// The recordings, in the order in which they were added.
    pub sources: Vec<Source>,
    /// The contact rule by which the areas were measured. The parameters are valid for this rule only.
    pub contact: ContactRule,
    /// The steps that a fit may use.
    pub steps: Vec<Step>,
    /// The contacts that were excluded.
    pub excluded_contacts: Vec<ExcludedContact>,
    /// The options of the fit.
    pub options: Options,
    /// The results of the regions, in the order of [`Region::ALL`]. Empty before [`Study::fit`].
    pub fits: Vec<Result<RegionFit, NotFitted>>,
}

impl Study {
    /// A study without recordings.
    pub fn new(participant: String, contact: ContactRule, options: Options) -> Self {
        Self {
            participant,
            sources: Vec::new(),
            contact,
            steps: Vec::new(),
            excluded_contacts: Vec::new(),
            options,
            fits: Vec::new(),
        }
    }

    /// Adds a recording and extracts its steps. `name` is its name for display, and `insole` is its virtual insole. `progress`
    /// receives the number of frames that have been processed.
    ///
    /// # Errors
    /// Fails if the insole cannot be set up. The study is then unchanged.
    pub fn add(
        &mut self,
        name: String,
        recording: &Recording,
        insole: &VirtualInsole,
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), SetupError> {
        let (steps, excluded) = steps::isolate(recording, insole, self.sources.len(), progress)?;
        self.steps.extend(steps);
        self.excluded_contacts.extend(excluded);
        self.sources.push(Source {
            name,
            origin: recording.source.clone(),
            side: recording.side,
            rate_hz: recording.rate_hz,
            layout: recording.layout.clone(),
        });
        Ok(())
    }

    /// Fits all regions. `progress` receives each region when its fit is complete; regions may complete in any order.
    pub fn fit(&mut self, progress: &(dyn Fn(Region) + Sync)) {
        self.fits = crate::fit(&self.steps, &self.options, progress).into();
    }
}
