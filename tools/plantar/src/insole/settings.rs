//! The settings of an insole: rules, frame rate and size.

use crate::carrier::AnyClient;
use crate::setup::{ContactArgs, StanceArgs, rule_in_words};
use anyhow::{Context, Result, ensure};
use clap::Args;
use parameters::InsoleSize;
use plantar::pipeline::setup::Setup;
use plantar::protocol::{Refusal, SCALE, Settings};

/// The European shoe size of the reference layout, to which [`Settings::scale`] is relative.
const REFERENCE_SIZE: f32 = 42.0;

/// The scale of the layout for a size.
fn scale_of(size: InsoleSize) -> f32 {
    f32::from(size.eur()) / REFERENCE_SIZE
}

/// Parses a size to which an insole can scale its layout.
fn layout_size(text: &str) -> Result<InsoleSize, String> {
    let size = text.parse().ok().filter(|size| SCALE.contains(&scale_of(*size)));
    size.ok_or_else(|| {
        "give a European shoe size, a whole number from 32 to 52: an insole cannot scale its layout to others".into()
    })
}

#[derive(Args)]
pub struct SettingsArgs {
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    stance: StanceArgs,
    /// Frames per second, 50 to 400. The board `wb55` supports at most 333, the board `nrf52840` at most 105; at higher rates,
    /// they miss frames.
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(50..=400))]
    rate: Option<u32>,
    /// European shoe size, a whole number from 32 to 52. The positions and areas of the cells are those of the layout of size 42,
    /// scaled to this size.
    #[arg(long, value_name = "SIZE", value_parser = layout_size)]
    size: Option<InsoleSize>,
    /// Remove all settings: the configuration in the insole's firmware is in force again.
    #[arg(long, conflicts_with_all = [
        "contact_on", "contact_off", "contact_full", "thresholds", "strike", "release", "min_stance", "min_swing",
        "max_stance", "rate", "size",
    ])]
    reset: bool,
}

impl SettingsArgs {
    /// Stores the settings on an insole. Prints a note on stderr if the insole has parameters, and its size changes.
    pub fn set(&self, client: &mut AnyClient) -> Result<()> {
        let before = stored_or_in_use(client)?;
        let settings = if self.reset { None } else { Some(self.checked(client, before.context(NO_LAYOUT)?)?) };
        client.set_settings(settings)?;
        // Without settings of a host, the layout is not scaled.
        let [scale_before, scale] = [before, settings].map(|settings| settings.map_or(1.0, |settings| settings.scale));
        if scale != scale_before && client.hello().tissue_id != 0 {
            eprintln!(
                "note: the size has changed, and the parameters on the insole remain in use. If they are not those of the new \
                 size, identify the wearer again, or send typical parameters of the new size (`plantar params typical --size`, \
                 `plantar params push`)"
            );
        }
        Ok(())
    }

    /// The settings `before`, changed by the options. Returns an error if nothing changes.
    fn checked(&self, client: &mut AnyClient, before: Settings) -> Result<Settings> {
        let settings = self.changed(before);
        // If the restart after an earlier change failed, the stored settings are not in force yet: the insole restarts now.
        let is_change = settings != before || !are_used(client)?;
        ensure!(is_change, "nothing to change: these settings are in force, or no option was given");
        Ok(settings)
    }

    /// These settings, changed by the options.
    fn changed(&self, mut settings: Settings) -> Settings {
        let Settings { contact, stance, period_us, scale } = &mut settings;
        *contact = self.contact.changed(*contact);
        *stance = self.stance.changed(*stance);
        *scale = self.size.map_or(*scale, scale_of);
        *period_us = self.rate.map_or(*period_us, |rate| 1_000_000 / rate);
        settings
    }
}

/// The reason why settings cannot be changed.
pub const NO_LAYOUT: &str = "the insole has no valid layout: `plantar insole show` prints the reason";

/// The set-up that an insole uses since its last start; `None` for an insole without a valid layout, which does not measure.
fn setup_in_use(client: &mut AnyClient) -> Result<Option<Setup>> {
    match client.setup() {
        Err(client::Error::Refused(Refusal::NoLayout)) => Ok(None),
        setup => Ok(Some(setup?)),
    }
}

/// True if the settings for the next start (the stored ones or, without them, those of the firmware) are those in use, which the
/// hello identifies. Also true for an insole without a valid layout.
pub fn are_used(client: &mut AnyClient) -> Result<bool> {
    let Some(Setup { layout_id, .. }) = setup_in_use(client)? else { return Ok(true) };
    let stored_id = client.settings()?.map_or(layout_id, |settings| settings.id(layout_id));
    Ok(client.hello().layout_id == stored_id)
}

/// The settings that a host has stored on an insole or, without them, those in use; `None` for an insole without a valid layout.
/// The insole uses stored settings from its next start on.
pub fn stored_or_in_use(client: &mut AnyClient) -> Result<Option<Settings>> {
    Ok(match client.settings()? {
        Some(settings) => Some(settings),
        None => setup_in_use(client)?.as_ref().map(Settings::of),
    })
}

/// Prints the settings that are stored or, without them, in use, and states if they are in force only after a restart.
pub fn print_settings(client: &mut AnyClient) -> Result<()> {
    let (stored, are_used) = (client.settings()?, are_used(client)?);
    let Some(settings) = stored.or(setup_in_use(client)?.as_ref().map(Settings::of)) else {
        println!("settings: none, because the insole has no valid layout; the note below has the reason");
        return Ok(());
    };
    if stored.is_none() && !are_used {
        println!("settings: those of the firmware, in force once the insole restarts");
        return Ok(());
    }
    let Settings { contact, stance, period_us, scale } = settings;
    let origin = if stored.is_some() { "set by a host" } else { "of the firmware" };
    let since = if are_used { "" } else { ", in force once the insole restarts" };
    println!("settings, {origin}{since}:");
    println!("  contact: {}", rule_in_words(&contact));
    println!(
        "  stance: {} thresholds, from {} N until below {} N, {} to {} ms, gaps of less than {} ms are bridged",
        if stance.is_adaptive { "adaptive" } else { "absolute" },
        stance.strike_n,
        stance.release_n,
        stance.min_stance_ms,
        stance.max_stance_ms,
        stance.min_swing_ms
    );
    println!("  {:.0} frames/s, {:.1} % of the layout's size", 1e6 / f64::from(period_us), 100.0 * scale);
    Ok(())
}
