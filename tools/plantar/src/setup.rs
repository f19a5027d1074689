//! Options that several commands share: the wearer's parameters, the contact rule and the baseline of the cells.

use anyhow::{Result, bail};
use clap::Args;
use parameters::{Identified, InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::PERIOD_US;
use recording::{Recording, VirtualInsole, Zero};
use std::path::PathBuf;

#[derive(Args)]
pub struct WearerArgs {
    /// The wearer's tissue parameters, a TOML file (`plantar fit` identifies personal ones).
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Without --params, use typical parameters for this European shoe size, 35 to 46; they are not personal.
    #[arg(long, default_value_t, conflicts_with = "params")]
    size: InsoleSize,
}

impl WearerArgs {
    /// The parameters, with a note on stderr where they are not personal.
    pub fn parameters(&self) -> Result<Parameters> {
        let parameters = match &self.params {
            Some(path) => Parameters::read(path)?,
            None => Parameters::typical(self.size),
        };
        note_unless_personal(&parameters);
        Ok(parameters)
    }
}

/// Prints a note on stderr where parameters are not personal.
pub fn note_unless_personal(parameters: &Parameters) {
    if !parameters.personal {
        eprintln!(
            "note: parameters \"{}\" are not personal: model force and deformation are rough estimates",
            parameters.subject
        );
    }
}

#[derive(Args)]
pub struct ContactArgs {
    /// A cell comes into contact at this pressure, kPa [default: the value of the parameters in use, or 10].
    #[arg(long, value_name = "KPA")]
    contact_on: Option<f32>,
    /// A cell loses contact below this pressure, kPa [default: --contact-on times the ratio of the two in the parameters in
    /// use, or 3/4 of --contact-on].
    #[arg(long, value_name = "KPA")]
    contact_off: Option<f32>,
    /// Count the fraction sqrt(p / KPA), at most 1, of the area of a cell in contact; 150 is a good value. With 0, the whole area
    /// is counted [default: the value of the parameters in use, or 0].
    #[arg(long, value_name = "KPA")]
    contact_full: Option<f32>,
}

impl ContactArgs {
    /// The contact rule: the rule of `identified` or the usual one, changed by the options that were given. Prints a note on
    /// stderr where the result differs from the rule of `identified`.
    pub fn rule(&self, identified: Option<&Identified>) -> Result<ContactRule> {
        let default = identified.map_or(ContactRule::COUNTED, |i| i.contact);
        let on_kpa = self.contact_on.unwrap_or(default.on_kpa);
        let rule = ContactRule {
            on_kpa,
            // The relative hysteresis of the default also holds for another threshold.
            off_kpa: self.contact_off.unwrap_or(default.off_kpa / default.on_kpa * on_kpa),
            full_kpa: self.contact_full.unwrap_or(default.full_kpa),
        };
        if !rule.is_valid() {
            bail!(
                "invalid contact rule, on at {} kPa, off below {} kPa, whole cell from {} kPa: --contact-off must be \
                 positive, --contact-off may not be above --contact-on (at most 1000), nor --contact-on above \
                 --contact-full (at most 2000, or 0 for whole cells)",
                rule.on_kpa,
                rule.off_kpa,
                rule.full_kpa
            );
        }
        if let Some(identified) = identified {
            note_unless_same_rule(&identified.contact, &rule);
            if identified.filter != "step" {
                eprintln!(
                    "note: the parameters were identified through the {} filter: they are valid for the live stream, \
                     but not for steps, which pass through the step filter",
                    identified.filter
                );
            }
        }
        Ok(rule)
    }
}

/// Prints a note on stderr where parameters were identified with another contact rule.
pub fn note_unless_same_rule(identified: &ContactRule, counted: &ContactRule) {
    if identified != counted {
        eprintln!(
            "note: the parameters were identified with the contact rule {}, but the rule in use is {}: model force and \
             deformation are not valid",
            rule_in_words(identified),
            rule_in_words(counted)
        );
    }
}

/// A contact rule in words.
pub fn rule_in_words(rule: &ContactRule) -> String {
    let counted =
        if rule.full_kpa > 0.0 { format!("fraction sqrt(p / {} kPa)", rule.full_kpa) } else { "whole cells".into() };
    format!("{counted}, on at {} kPa, off below {} kPa", rule.on_kpa, rule.off_kpa)
}

/// The virtual insole for a recording, with a contact rule.
pub fn insole(recording: &Recording, rule: ContactRule) -> Result<VirtualInsole> {
    let insole = VirtualInsole::new(recording, rule, plantar::pipeline::stance::StanceRule::WALKING);
    if !PERIOD_US.contains(&insole.setup.period_us) {
        bail!(
            "the recording has {:.2} frames per second, and 20 to 500 are supported: import it again with --rate 100",
            recording.rate_hz
        );
    }
    Ok(insole)
}

#[derive(Args)]
pub struct ZeroArgs {
    /// The baseline of the unloaded cells, a TOML file from `plantar zero`; the insole subtracts it.
    #[arg(long, value_name = "FILE")]
    pub(crate) zero: Option<PathBuf>,
}

impl ZeroArgs {
    /// Sets the offsets of the insole's cells, where a baseline file is given.
    pub fn apply(&self, insole: &mut VirtualInsole) -> Result<()> {
        if let Some(path) = &self.zero {
            Zero::read(path)?.apply_to(insole, &path.display().to_string())?;
        }
        Ok(())
    }
}
