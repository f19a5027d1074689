//! The identification of one person: the recordings, their steps, and the identified parameters.

use crate::live::LiveSteps;
use crate::sensitivity::Sensitivity;
use crate::steps::ExcludedContact;
use crate::{NotFitted, Options, RegionFit, Step};
use plantar::pipeline::contact::ContactRule;
use plantar::{Region, Side};
use std::fmt;
#[cfg(feature = "recordings")]
use {
    crate::steps::{IsolateError, isolate},
    recording::{FrameSource, Layout, VirtualInsole},
};

/// One recording or live stream of a [`Study`], without its pressures.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Name for display, such as the name of the file.
    pub name: String,
    /// Provenance, in sentences.
    pub origin: String,
    /// The foot.
    pub side: Side,
    /// Frames per second.
    pub rate_hz: f64,
    /// The layout of the cells. It has no cells for a live stream, which does not contain the layout.
    #[cfg(feature = "recordings")]
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
    /// Mean NRMSE, as a fraction, of the steps of each region if each step is predicted from the other steps, and the areas are
    /// those of counted cells instead of covered shares. In the order of [`Region::ALL`]. `None` if it was not computed, for
    /// example because the sources do not contain the cells.
    pub counted_nrmse: [Option<f64>; 8],
    /// The main results with other contact rules, filters and selections of steps; `None` if they were not computed.
    pub sensitivity: Option<Sensitivity>,
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
            counted_nrmse: [None; 8],
            sensitivity: None,
            fits: Vec::new(),
        }
    }

    /// Adds a recording and extracts its steps. `name` is its name for display, and `insole` is its virtual insole. `progress`
    /// receives the number of frames that have been processed.
    ///
    /// # Errors
    /// Fails if the insole cannot be set up, or the recording cannot be read. The study is then unchanged.
    #[cfg(feature = "recordings")]
    pub fn add<'r>(
        &mut self,
        name: String,
        recording: impl Into<FrameSource<'r>>,
        insole: &VirtualInsole,
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), IsolateError> {
        let recording = recording.into();
        let head = recording.head();
        let (origin, side) = (head.source.clone(), head.side);
        let source = Source { name, origin, side, rate_hz: head.rate_hz, layout: head.layout.clone() };
        let (steps, excluded) = isolate(insole, insole.scans(recording), self.sources.len(), progress)?;
        self.steps.extend(steps);
        self.excluded_contacts.extend(excluded);
        self.sources.push(source);
        Ok(())
    }

    /// Adds the steps of a live stream. `name` is its name for display, `origin` its provenance, in sentences, and `side` the
    /// foot.
    ///
    /// # Errors
    /// Fails if a step was measured by another contact rule than that of the study. The study is then unchanged.
    pub fn add_live(
        &mut self,
        name: String,
        origin: String,
        side: Side,
        live: &LiveSteps,
    ) -> Result<(), OtherContactRule> {
        if let Some(&found) = live.contact_rules().iter().find(|rule| **rule != self.contact) {
            return Err(OtherContactRule { found, expected: self.contact });
        }
        let (steps, excluded) = live.collected(self.sources.len());
        self.steps.extend(steps);
        self.excluded_contacts.extend(excluded);
        self.sources.push(Source {
            name,
            origin,
            side,
            rate_hz: live.rate_hz(),
            #[cfg(feature = "recordings")]
            layout: Layout { name: String::new(), cells: Vec::new(), sheet: None },
        });
        Ok(())
    }

    /// The foot of all steps; `None` if there are steps of both feet, or none.
    pub fn side(&self) -> Option<Side> {
        let side = self.steps.first()?.side;
        self.steps.iter().all(|step| step.side == side).then_some(side)
    }

    /// True if all regions were fitted and none of their results has a defect: see [`RegionFit::defects`].
    pub fn is_complete(&self) -> bool {
        !self.fits.is_empty() && self.fits.iter().all(|fit| fit.as_ref().is_ok_and(|fit| fit.defects.is_empty()))
    }

    /// A note if the prior was learnt from areas of another contact rule than that of the study; otherwise `None`.
    pub fn prior_note(&self) -> Option<String> {
        (self.options.prior.is_some() && self.contact != ContactRule::COVERED).then(|| {
            format!(
                "the prior was learnt from areas by the contact rule {} (on / off / full), and force grows differently with areas of \
                 another rule: parameters, their intervals, and the marks for undetermined values may be less \
                 accurate than with the default rule; --bounds paper uses no prior",
                in_words(&ContactRule::COVERED)
            )
        })
    }

    /// True if the areas are effective areas, which depend on the pressure too: those of covered shares.
    pub fn has_effective_area(&self) -> bool {
        self.contact.full_kpa > 0.0
    }

    /// A note on the meaning of stiffness, moduli and energies.
    pub fn measures_note(&self) -> String {
        let mut note = String::from(
            "area and force come from the same pressures, so viscous modulus and dissipated energy are smaller than those of \
             the tissue",
        );
        if self.has_effective_area() {
            note.push_str(
                "; the area with covered shares follows the pressure, so n, K, stiffness and moduli are those of the effective \
                 area, not of the tissue, and can be compared only between results of the same contact rule",
            );
        }
        note
    }

    /// Fits all regions. `progress` receives each region when its fit is complete; regions may complete in any order.
    pub fn fit(&mut self, progress: &(dyn Fn(Region) + Sync)) {
        self.fits = crate::fit(&self.steps, &self.options, progress).into();
    }
}

/// Steps were measured by another contact rule than that of the study, so that their areas cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherContactRule {
    /// The rule of the steps.
    pub found: ContactRule,
    /// The rule of the study.
    pub expected: ContactRule,
}

/// The pressures of a contact rule: on / off / full.
fn in_words(rule: &ContactRule) -> String {
    format!("{} / {} / {} kPa", rule.on_kpa, rule.off_kpa, rule.full_kpa)
}

impl fmt::Display for OtherContactRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "some steps were measured by the contact rule {} (on / off / full), but the rule of this fit is {}: areas of \
             different rules cannot be fitted together; record and fit the steps of each rule separately",
            in_words(&self.found),
            in_words(&self.expected)
        )
    }
}

impl std::error::Error for OtherContactRule {}
