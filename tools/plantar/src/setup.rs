//! Options that several commands share: the wearer's parameters, the contact rule and the cells' zero.

use anyhow::{Result, bail};
use clap::Args;
use parameters::{Identified, InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::PERIOD_US;
use recording::{Recording, VirtualInsole, Zero};
use std::path::PathBuf;

#[derive(Args)]
pub struct Wearer {
    /// The wearer's tissue parameters, a TOML file (`plantar fit` finds a person's own).
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Without --params: typical, not personal, parameters for this European shoe size, 35 to 46.
    #[arg(long, default_value_t, conflicts_with = "params")]
    size: InsoleSize,
}

impl Wearer {
    /// The parameters, with a word on stderr where they are not personal.
    pub fn parameters(&self) -> Result<Parameters> {
        let parameters = match &self.params {
            Some(path) => Parameters::read(path)?,
            None => Parameters::typical(self.size),
        };
        note_unless_personal(&parameters);
        Ok(parameters)
    }
}

/// A word on stderr where parameters are not the wearer's own.
pub fn note_unless_personal(parameters: &Parameters) {
    if !parameters.personal {
        eprintln!(
            "note: parameters \"{}\" are not personal: model force and deformation are a rough guide",
            parameters.subject
        );
    }
}

#[derive(Args)]
pub struct Contact {
    /// A cell comes into contact at this pressure, kPa [default: that of the parameters in use, or 10].
    #[arg(long, value_name = "KPA")]
    contact_on: Option<f32>,
    /// and leaves it below this one, kPa [default: the same, or three quarters of it].
    #[arg(long, value_name = "KPA")]
    contact_off: Option<f32>,
    /// Count a cell in contact by the share sqrt(p / KPA), at most whole; 150 is a good value, 0 counts every cell in contact
    /// whole [default: the same, or 0].
    #[arg(long, value_name = "KPA")]
    contact_full: Option<f32>,
}

impl Contact {
    /// The rule, by default the one that `identified` holds for; a word on stderr where it is another.
    pub fn rule(&self, identified: Option<&Identified>) -> Result<ContactRule> {
        let usual = identified.map_or(ContactRule::COUNTED, |i| i.contact);
        let on_kpa = self.contact_on.unwrap_or(usual.on_kpa);
        let rule = ContactRule {
            on_kpa,
            // The usual hysteresis at another threshold.
            off_kpa: self.contact_off.unwrap_or(usual.off_kpa / usual.on_kpa * on_kpa),
            full_kpa: self.contact_full.unwrap_or(usual.full_kpa),
        };
        if !rule.is_valid() {
            bail!(
                "contact on at {} kPa, off below {} kPa, whole from {} kPa: --contact-off may not be above --contact-on, nor that \
                 above --contact-full (0 for whole cells), and all are 1000 kPa at most",
                rule.on_kpa,
                rule.off_kpa,
                rule.full_kpa
            );
        }
        if let Some(identified) = identified {
            note_unless_same_rule(&identified.contact, &rule);
            if identified.filter != "step" {
                eprintln!(
                    "note: the parameters were identified through the {} filter: they hold for the live stream, steps go through \
                     another filter",
                    identified.filter
                );
            }
        }
        Ok(rule)
    }
}

/// A word on stderr where areas are counted in another way than the parameters were identified with.
pub fn note_unless_same_rule(identified: &ContactRule, counted: &ContactRule) {
    if identified != counted {
        eprintln!(
            "note: the parameters were identified with areas counted by {}, here they are counted by {}: model force and \
             deformation do not hold",
            rule_in_words(identified),
            rule_in_words(counted)
        );
    }
}

/// A contact rule for people.
pub fn rule_in_words(rule: &ContactRule) -> String {
    let counted =
        if rule.full_kpa > 0.0 { format!("share sqrt(p / {} kPa)", rule.full_kpa) } else { "whole cells".into() };
    format!("{counted}, on at {} kPa, off below {} kPa", rule.on_kpa, rule.off_kpa)
}

/// The insole that feels `recording` under a rule.
pub fn insole(recording: &Recording, rule: ContactRule) -> Result<VirtualInsole> {
    let worn = VirtualInsole::new(recording, rule, plantar::pipeline::stance::StanceRule::WALKING);
    if !PERIOD_US.contains(&worn.setup.period_us) {
        bail!(
            "{:.2} frames a second: 20 to 500 are understood; import the recording again with --rate 100",
            recording.rate_hz
        );
    }
    Ok(worn)
}

#[derive(Args)]
pub struct Zeroed {
    /// What the unloaded cells read, a TOML file that `plantar zero` wrote: the insole subtracts it.
    #[arg(long, value_name = "FILE")]
    pub(crate) zero: Option<PathBuf>,
}

impl Zeroed {
    /// Gives the cells of `worn` their offsets.
    pub fn wear(&self, worn: &mut VirtualInsole) -> Result<()> {
        if let Some(path) = &self.zero {
            Zero::read(path)?.wear(worn, &path.display().to_string())?;
        }
        Ok(())
    }
}
