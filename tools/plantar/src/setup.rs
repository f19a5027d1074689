//! Options that several commands share: the wearer's parameters, the contact rule and the cells' zero.

use anyhow::{Result, bail};
use clap::Args;
use parameters::{InsoleSize, Parameters};
use plantar::contact::ContactRule;
use plantar::insole::PERIOD_US;
use recording::{Recording, VirtualInsole, Zero};
use std::path::PathBuf;

#[derive(Args)]
pub struct Wearer {
    /// The wearer's tissue parameters, a TOML file (`plantar params typical` writes one to start from).
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
    /// A cell comes into contact at this pressure, kPa.
    #[arg(long, value_name = "KPA", default_value_t = ContactRule::COUNTED.on_kpa)]
    contact_on: f32,
    /// and leaves it below this one, kPa.
    #[arg(long, value_name = "KPA", default_value_t = ContactRule::COUNTED.off_kpa)]
    contact_off: f32,
    /// Count a cell in contact by the share sqrt(p / KPA), at most whole (150 is a good value); without it every cell in
    /// contact counts whole.
    #[arg(long, value_name = "KPA", default_value_t = ContactRule::COUNTED.full_kpa, hide_default_value = true)]
    contact_full: f32,
}

impl Contact {
    /// The insole that feels `recording` under this rule.
    pub fn insole(&self, recording: &Recording) -> Result<VirtualInsole> {
        let rule = ContactRule { on_kpa: self.contact_on, off_kpa: self.contact_off, full_kpa: self.contact_full };
        let worn = VirtualInsole::new(recording, rule, plantar::stance::StanceRule::WALKING);
        if !PERIOD_US.contains(&worn.setup.period_us) {
            bail!(
                "{:.2} frames a second: 20 to 500 are understood; import the recording again with --rate 100",
                recording.rate_hz
            );
        }
        Ok(worn)
    }
}

#[derive(Args)]
pub struct Zeroed {
    /// What the unloaded cells read, a TOML file that `plantar zero` wrote: the insole subtracts it.
    #[arg(long, value_name = "FILE")]
    zero: Option<PathBuf>,
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
