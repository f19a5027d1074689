//! The options of an evaluation: filter, method and bounds of the search, the tissue, the contact rule and the stance rule.

use crate::ReadFile;
use anyhow::{Context, Result, bail};
use fit::fixed::COMPRESSION;
use fit::{Bounds, Filter, Measured, Method, Options};
use parameters::{InsoleSize, TissueMeasurements};
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::PERIOD_US;
use plantar::pipeline::stance_rule::StanceRule;
use recording::{FrameSource, VirtualInsole};
use std::io;
use std::path::{Path, PathBuf};

/// Filter, method and bounds of an identification, and the tissue.
#[derive(Clone, Debug)]
pub struct Search {
    /// The filter of the contact area. `None` for the default of the method: direct for projection, smoothed for that of the
    /// paper.
    pub filter: Option<Filter>,
    /// The method of search.
    pub method: Method,
    /// True for least squares within [`Bounds::PAPER`], false for [`Bounds::USUAL`] and the prior.
    pub has_paper_bounds: bool,
    /// The file of tissue measurements, if there is one.
    pub tissue: Option<PathBuf>,
    /// The shoe size, which determines the thickness of the tissue in regions without a measurement.
    pub size: InsoleSize,
    /// Assumed largest compression of the tissue, as a fraction of its thickness, 0.05 to 0.95.
    pub compression: f64,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            filter: None,
            method: Method::Projection,
            has_paper_bounds: false,
            tissue: None,
            size: InsoleSize::default(),
            compression: COMPRESSION,
        }
    }
}

impl Search {
    /// The options of the fit. `resamples` is the number of bootstrap resamples of the steps.
    ///
    /// # Errors
    /// Fails if the compression is out of range.
    pub fn options(&self, tissue: &TissueMeasurements, resamples: u64) -> Result<Options> {
        if !(0.05..=0.95).contains(&self.compression) {
            bail!(
                "a largest compression of {} is out of range: expected a fraction of the thickness, 0.05 to 0.95",
                self.compression
            );
        }
        let typical_m = self.size.thickness_m();
        let thickness_m = std::array::from_fn(|region| tissue.0[region].thickness_m.unwrap_or(typical_m[region]));
        let measured = tissue.0.each_ref().map(|region| Measured {
            has_thickness: region.thickness_m.is_some(),
            peak_strain: region.peak_strain,
            curvature_m: region.curvature_m,
        });
        let bounds = if self.has_paper_bounds { Bounds::PAPER } else { Bounds::USUAL };
        // The paper's search has no prior.
        let has_prior = self.method == Method::Projection && !self.has_paper_bounds;
        let prior = has_prior.then_some(fit::prior::WALKERS);
        let usual_filter = match self.method {
            Method::Projection => Filter::Direct,
            Method::Paper => Filter::Smoothed,
        };
        Ok(Options {
            filter: self.filter.unwrap_or(usual_filter),
            method: self.method,
            bounds,
            prior,
            thickness_m,
            size_scale: self.size.scale(),
            compression: self.compression,
            measured,
            resamples,
        })
    }

    /// Reads the file of tissue measurements. Also returns a note for each value that is out of range and therefore not used, and
    /// one if the size determines a thickness, and is not one of the paper.
    ///
    /// # Errors
    /// Fails if the file cannot be read, or has another form.
    pub fn tissue(&self, read: ReadFile) -> Result<(TissueMeasurements, Vec<String>)> {
        let extrapolated = self.size.extrapolation_note();
        let Some(path) = &self.tissue else { return Ok((Default::default(), extrapolated.into_iter().collect())) };
        let tissue = TissueMeasurements::parse(&text(path, read(path))?, path)?;
        let regions = Region::ALL.iter().zip(&tissue.0);
        let note = |(region, value)| format!("{}: {}: {value}", path.display(), Region::name(region));
        let notes = regions.flat_map(|(&region, of)| of.rejected.iter().map(move |value| (region, value))).map(note);
        let is_typical = tissue.0.iter().any(|region| region.thickness_m.is_none());
        let notes = notes.chain(extrapolated.filter(|_| is_typical)).collect();
        Ok((tissue, notes))
    }
}

/// Converts `content`, which was read from the file `path`, to text. Messages name `path`.
pub(crate) fn text(path: &Path, content: io::Result<Vec<u8>>) -> Result<String> {
    let bytes =
        content.with_context(|| format!("cannot read {}: check the path and its permissions", path.display()))?;
    String::from_utf8(bytes).with_context(|| format!("{} is not text in UTF-8: save it in UTF-8", path.display()))
}

/// Values that replace those of a contact rule, kPa. `None` leaves the value of the rule; in [`ContactOptions::rule`], `off_kpa`
/// is an exception.
#[derive(Clone, Copy, Debug, Default)]
pub struct ContactOptions {
    /// A cell comes into contact at this pressure.
    pub on_kpa: Option<f32>,
    /// A cell loses contact below this pressure.
    pub off_kpa: Option<f32>,
    /// A cell in contact counts with its whole area from this pressure on; 0 if every cell in contact counts with its whole area.
    pub full_kpa: Option<f32>,
}

impl ContactOptions {
    /// Returns `rule` with the values of these options that are given.
    pub fn changed(&self, rule: ContactRule) -> ContactRule {
        ContactRule {
            on_kpa: self.on_kpa.unwrap_or(rule.on_kpa),
            off_kpa: self.off_kpa.unwrap_or(rule.off_kpa),
            full_kpa: self.full_kpa.unwrap_or(rule.full_kpa),
        }
    }

    /// Returns `default` with the values of these options that are given. If `on_kpa` is given without `off_kpa`, the `off_kpa`
    /// of the rule changes in proportion to `on_kpa`.
    ///
    /// # Errors
    /// Fails if the result is no valid rule.
    pub fn rule(&self, default: ContactRule) -> Result<ContactRule> {
        let off_kpa = self.on_kpa.map_or(default.off_kpa, |on_kpa| default.off_kpa / default.on_kpa * on_kpa);
        let rule = self.changed(ContactRule { off_kpa, ..default });
        if !rule.is_valid() {
            bail!(
                "invalid contact rule, on at {} kPa, off below {} kPa, whole cell from {} kPa: contact-off must be positive, \
                 contact-off may not be above contact-on, contact-on not above 1000 kPa, and contact-full either 0, \
                 for whole cells, or from contact-on to 2000 kPa",
                rule.on_kpa,
                rule.off_kpa,
                rule.full_kpa
            );
        }
        Ok(rule)
    }
}

/// Values that replace those of a stance rule. `None` leaves the value of the rule.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StanceOptions {
    /// True for thresholds that are proportional to the peaks of the wearer's steps, false for fixed ones.
    pub is_adaptive: Option<bool>,
    /// Threshold of heel strike, N.
    pub strike_n: Option<f32>,
    /// Threshold of toe off, N.
    pub release_n: Option<f32>,
    /// A shorter contact is not a step, ms.
    pub min_stance_ms: Option<u16>,
    /// A shorter gap does not end a stance, ms.
    pub min_swing_ms: Option<u16>,
    /// A longer contact is not a step, ms.
    pub max_stance_ms: Option<u16>,
}

impl StanceOptions {
    /// Returns `rule` with the values of these options that are given.
    pub fn changed(&self, rule: StanceRule) -> StanceRule {
        StanceRule {
            strike_n: self.strike_n.unwrap_or(rule.strike_n),
            release_n: self.release_n.unwrap_or(rule.release_n),
            min_stance_ms: self.min_stance_ms.unwrap_or(rule.min_stance_ms),
            min_swing_ms: self.min_swing_ms.unwrap_or(rule.min_swing_ms),
            max_stance_ms: self.max_stance_ms.unwrap_or(rule.max_stance_ms),
            is_adaptive: self.is_adaptive.unwrap_or(rule.is_adaptive),
        }
    }

    /// Returns [`StanceRule::ADAPTIVE`] with the values of these options that are given.
    ///
    /// # Errors
    /// Fails if the result is no valid rule.
    pub fn rule(&self) -> Result<StanceRule> {
        let rule = self.changed(StanceRule::ADAPTIVE);
        if !rule.is_valid() {
            bail!(
                "invalid stance rule, from {} N until below {} N, {} to {} ms, gaps below {} ms bridged: strike and release must \
                 be above 0 and at most 1000 N, min-stance below max-stance, and min-swing above 0",
                rule.strike_n,
                rule.release_n,
                rule.min_stance_ms,
                rule.max_stance_ms,
                rule.min_swing_ms
            );
        }
        Ok(rule)
    }
}

/// Makes a virtual insole with these rules for a recording.
///
/// # Errors
/// Fails if no insole supports the recording's frame rate, or the recording cannot be read.
pub fn virtual_insole(source: &FrameSource, contact: ContactRule, stance: StanceRule) -> Result<VirtualInsole> {
    let recording = source.head();
    let insole = VirtualInsole::up_to(source.largest_kpa()?, recording, contact, stance);
    if !PERIOD_US.contains(&insole.setup.period_us) {
        bail!(
            "the recording has {:.2} frames per second, and 20 to 500 are supported: import it again with --rate 100",
            recording.rate_hz
        );
    }
    Ok(insole)
}
