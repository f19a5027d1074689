//! Options that several commands share: the wearer's parameters, the contact rule, the stance rule and the zero of the cells.

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use parameters::{Identified, InsoleSize, Parameters};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::Step;
use recording::{FrameSource, VirtualInsole, Zero};
use std::path::{Path, PathBuf};
use study::walk::OptionNames;
use study::{ContactOptions, StanceOptions};

/// The options of a command that plays a recording into a virtual or emulated insole.
#[derive(Args)]
pub struct InsoleArgs {
    #[command(flatten)]
    pub wearer: WearerArgs,
    #[command(flatten)]
    pub contact: ContactArgs,
    #[command(flatten)]
    pub stance: StanceArgs,
    #[command(flatten)]
    zero: ZeroArgs,
}

impl InsoleArgs {
    /// The files that a command with these options reads: `recordings`, the parameters and the zero.
    pub fn inputs(&self, recordings: &[PathBuf]) -> Vec<PathBuf> {
        recordings.iter().chain(&self.wearer.params).chain(&self.zero.zero).cloned().collect()
    }

    /// True if an option has another value than its default.
    #[cfg(feature = "serve")]
    pub fn is_given(&self) -> bool {
        let Self { wearer, contact, stance, zero } = self;
        let values = [contact.contact_on, contact.contact_off, contact.contact_full];
        let is_rule_given = values != [None; 3] || stance.is_given();
        wearer.params.is_some() || wearer.size.is_some() || is_rule_given || zero.zero.is_some()
    }

    /// The contact rule for these parameters. See [`ContactArgs::rule`].
    pub fn rule(&self, parameters: &Parameters) -> Result<ContactRule> {
        self.contact.rule(parameters.identified.as_ref())
    }

    /// Makes the virtual insole of the recording `source`, with the zero of the cells. `path` names the recording in an error.
    pub fn insole(&self, source: &FrameSource, rule: ContactRule, path: &Path) -> Result<VirtualInsole> {
        let stance = self.stance.rule()?;
        let mut insole = study::virtual_insole(source, rule, stance).with_context(|| path.display().to_string())?;
        self.zero.apply(&mut insole)?;
        Ok(insole)
    }
}

#[derive(Args)]
pub struct WearerArgs {
    /// The wearer's tissue parameters, a TOML file (`plantar fit` identifies personal ones).
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Without --params, use typical parameters for this European shoe size, a whole number from 20 to 52 [default: 42]. Typical
    /// parameters are not personal, and those of sizes outside of 35 to 46 are extrapolated.
    #[arg(long, conflicts_with = "params")]
    pub(crate) size: Option<InsoleSize>,
}

impl WearerArgs {
    /// Returns the parameters, and prints notes on stderr if they are not personal in all regions, or extrapolated.
    pub fn parameters(&self) -> Result<Parameters> {
        let parameters = self.parameters_without_note()?;
        note_unless_personal(&parameters);
        // The option conflicts with a parameter file, so the size is that of the parameters.
        note_if_extrapolated(self.size);
        Ok(parameters)
    }

    /// Returns the parameters without the note of [`Self::parameters`], which is superfluous for outputs without results of the
    /// model.
    pub fn parameters_without_note(&self) -> Result<Parameters> {
        Ok(match &self.params {
            Some(path) => Parameters::read(path)?,
            None => Parameters::typical_for(self.size),
        })
    }
}

/// Prints a note on stderr if parameters are not personal in all regions.
pub fn note_unless_personal(parameters: &Parameters) {
    parameters.typical_note().iter().for_each(|note| eprintln!("note: {note}"));
}

/// Prints a note on stderr if the typical parameters of the stated size are extrapolated.
pub fn note_if_extrapolated(size: Option<InsoleSize>) {
    size.and_then(InsoleSize::extrapolation_note).iter().for_each(|note| eprintln!("note: {note}"));
}

/// Prints a note on stderr if typical parameters do not apply to the steps of a region. Without a size, they are those of the
/// default size.
pub fn note_unless_applicable(parameters: &Parameters, size: Option<InsoleSize>, steps: &[Step]) {
    parameters.inapplicable_note(size.unwrap_or_default(), steps).iter().for_each(|note| eprintln!("note: {note}"));
}

/// Options that change a contact rule.
#[derive(Args, Clone, Default)]
pub struct ContactArgs {
    /// A cell comes into contact at this pressure, kPa [default: the value on the insole or in the parameter file, or 10].
    #[arg(long, value_name = "KPA")]
    contact_on: Option<f32>,
    /// A cell loses contact below this pressure, kPa [default: the value on the insole, or the same fraction of --contact-on as
    /// in the parameter file, or 3/4].
    #[arg(long, value_name = "KPA")]
    contact_off: Option<f32>,
    /// Count only the fraction sqrt(p / KPA), at most 1, of the area of a cell in contact, where p is the cell's pressure; 0
    /// counts whole cells, as in the paper [default: the value on the insole or in the parameter file, or 150].
    #[arg(long, value_name = "KPA")]
    contact_full: Option<f32>,
}

impl ContactArgs {
    fn values(&self) -> ContactOptions {
        ContactOptions { on_kpa: self.contact_on, off_kpa: self.contact_off, full_kpa: self.contact_full }
    }

    /// This rule, with the values of the given options.
    pub fn changed(&self, rule: ContactRule) -> ContactRule {
        self.values().changed(rule)
    }

    /// Returns the contact rule: the rule with which the parameters were identified, or else the default, changed by the given
    /// options. Prints notes on stderr if the parameters were identified with another rule, or with a filter other than that of
    /// step records.
    pub fn rule(&self, identified: Option<&Identified>) -> Result<ContactRule> {
        let default = identified.map_or(ContactRule::COVERED, |i| i.contact);
        let rule = self.values().rule(default).context("--contact-on, --contact-off and --contact-full")?;
        if let Some(identified) = identified {
            note_unless_same_rule(&identified.contact, &rule);
            if let Some(reason) = identified.invalid_for_steps() {
                eprintln!("note: {reason}");
            }
        }
        Ok(rule)
    }

    /// The first option that contradicts the rule by which areas were measured, as it was given; `None` if none does.
    pub fn contradiction(&self, measured: &ContactRule) -> Option<String> {
        let options = [
            ("--contact-on", self.contact_on, measured.on_kpa),
            ("--contact-off", self.contact_off, measured.off_kpa),
            ("--contact-full", self.contact_full, measured.full_kpa),
        ];
        let mut given = options.into_iter().filter_map(|(name, given, measured)| Some((name, given?, measured)));
        given.find(|(_, given, measured)| given != measured).map(|(name, given, _)| format!("{name} {given}"))
    }
}

/// The kinds of thresholds of heel strike and toe off; see the option --thresholds.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Thresholds {
    Adaptive,
    Absolute,
}

/// Options that change a stance rule.
#[derive(Args, Clone, Default)]
pub struct StanceArgs {
    /// Thresholds of heel strike and toe off: adaptive ones are proportional to the peaks of the wearer's steps, and apply to the
    /// force above that of the lifted foot; absolute ones are fixed [default: the value on the insole, or adaptive].
    #[arg(long, value_enum)]
    thresholds: Option<Thresholds>,
    /// Heel strike is the frame in which the total force reaches this value, N, up to 1000. If it is below --release, a heel
    /// strike needs the value of --release until the force has fallen below --strike after toe off. If thresholds are adaptive,
    /// the value applies to steps with a peak of 700 N [default: the value on the insole, or 35].
    #[arg(long, value_name = "N")]
    strike: Option<f32>,
    /// Toe off is the frame in which the total force falls below this value, N, up to 1000. If thresholds are adaptive, the value
    /// applies to steps with a peak of 700 N [default: the value on the insole, or 70].
    #[arg(long, value_name = "N")]
    release: Option<f32>,
    /// A contact that is shorter than this time, ms, is not a step [default: the value on the insole, or 90].
    #[arg(long, value_name = "MS")]
    min_stance: Option<u16>,
    /// A gap that is shorter than this time, ms, does not end a stance [default: the value on the insole, or 50].
    #[arg(long, value_name = "MS")]
    min_swing: Option<u16>,
    /// A contact that is longer than this time, ms, is not a step [default: the value on the insole, or 2500].
    #[arg(long, value_name = "MS")]
    max_stance: Option<u16>,
}

impl StanceArgs {
    /// The names of the options, for messages.
    pub const NAMES: &str = "--thresholds, --strike, --release, --min-stance, --min-swing and --max-stance";

    fn values(&self) -> StanceOptions {
        StanceOptions {
            is_adaptive: self.thresholds.map(|thresholds| thresholds == Thresholds::Adaptive),
            strike_n: self.strike,
            release_n: self.release,
            min_stance_ms: self.min_stance,
            min_swing_ms: self.min_swing,
            max_stance_ms: self.max_stance,
        }
    }

    /// True if an option is given.
    pub fn is_given(&self) -> bool {
        self.values() != StanceOptions::default()
    }

    /// This rule, with the values of the given options.
    pub fn changed(&self, rule: StanceRule) -> StanceRule {
        self.values().changed(rule)
    }

    /// The default rule, with the values of the given options.
    pub fn rule(&self) -> Result<StanceRule> {
        self.values().rule().context(Self::NAMES)
    }
}

/// Prints a note on stderr if parameters were identified from the other foot only.
pub fn note_unless_same_foot(identified: Option<&Identified>, side: Side) {
    let note = identified.and_then(|identified| identified.other_foot_note(side));
    note.iter().for_each(|note| eprintln!("note: {note}"));
}

/// Prints a note on stderr if parameters were identified with another contact rule than the rule in use.
pub fn note_unless_same_rule(identified: &ContactRule, in_use: &ContactRule) {
    if identified != in_use {
        eprintln!(
            "note: the parameters were identified with the contact rule {}, but the rule in use is {}: model force and \
             deformation are not valid",
            rule_in_words(identified),
            rule_in_words(in_use)
        );
    }
}

/// A contact rule in words, with the name of its areas.
pub fn rule_in_words(rule: &ContactRule) -> String {
    let counted =
        if rule.full_kpa > 0.0 { format!("fraction sqrt(p / {} kPa)", rule.full_kpa) } else { "whole cells".into() };
    let area = recording::area_title(rule);
    format!("{area}, {counted}, on at {} kPa, off below {} kPa", rule.on_kpa, rule.off_kpa)
}

#[derive(Args, Default)]
pub struct ZeroArgs {
    /// The zero file from `plantar zero`. The zero of each cell is subtracted from its readings.
    #[arg(long, value_name = "FILE")]
    pub(crate) zero: Option<PathBuf>,
}

impl ZeroArgs {
    /// Lets the insole subtract the zeros in the zero file, if the option is given.
    pub fn apply(&self, insole: &mut VirtualInsole) -> Result<()> {
        if let Some(path) = &self.zero {
            Zero::read(path)?.apply_to(insole, &path.display().to_string())?;
        }
        Ok(())
    }
}

/// The names of the options in notes on contacts.
pub const OPTION_NAMES: OptionNames = OptionNames {
    strike: "--strike",
    release: "--release",
    min_stance: "--min-stance",
    max_stance: "--max-stance",
    zero: "--zero",
};

/// Reads the time of an option, s. It can be negative.
pub fn time(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|t_s: &f64| t_s.is_finite()).ok_or_else(|| "give a time in seconds".into())
}

#[cfg(test)]
mod tests {
    use super::{ContactArgs, ContactRule};

    #[test]
    fn a_contact_rule_remains_exactly_the_same_without_options() {
        for (on_kpa, off_kpa) in (1..=40u8).flat_map(|on| (1..=on).map(move |off| (on.into(), off.into()))) {
            let rule = ContactRule { on_kpa, off_kpa, full_kpa: 150.0 };
            assert_eq!(ContactArgs::default().values().rule(rule).expect("a valid rule"), rule);
        }
    }
}
