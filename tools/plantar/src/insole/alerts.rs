//! The rules of alerts of an insole, and the load of the day.

use crate::carrier::AnyClient;
use crate::summary::{self, REGION_LABELS};
use anyhow::{Result, ensure};
use clap::Args;
use comfy_table::CellAlignment;
use plantar::Region;
use plantar::pipeline::alert::{AlertRules, DailyLoad};

#[derive(Args)]
pub struct AlertArgs {
    /// Raise alerts. If alerts were off, the largest number in a day is set to the recommended value, even if --per-day had set
    /// another one before. Other rules that were never set have their recommended values.
    #[arg(long, conflicts_with_all = ["off", "per_day"])]
    on: bool,
    /// Raise no alerts. The load is still counted.
    #[arg(long, conflicts_with = "per_day")]
    off: bool,
    /// Pressure from which a load counts as sustained, kPa, 1 to 2000.
    #[arg(long, value_name = "KPA")]
    sustained_pressure: Option<f32>,
    /// Length of the time over which sustained load is determined, minutes, 1 to 60.
    #[arg(long, value_name = "MIN", value_parser = clap::value_parser!(u16).range(1..=60))]
    window: Option<u16>,
    /// Sustained load begins when the pressure is at or above --sustained-pressure for this share of the window, percent, up to
    /// 100.
    #[arg(long, value_name = "PERCENT")]
    begins: Option<u8>,
    /// Sustained load ends when the pressure is at or above --sustained-pressure for less than this share of the window, percent,
    /// above 0 and below --begins.
    #[arg(long, value_name = "PERCENT")]
    ends: Option<u8>,
    /// Pressure above which the dose counts, kPa, 1 to 2000.
    #[arg(long, value_name = "KPA")]
    dose_pressure: Option<f32>,
    /// Raise an alert when the dose of a region in a day reaches this value, kPa s, up to 1e7; 0 for no such alert.
    #[arg(long, value_name = "KPA_S")]
    dose: Option<f32>,
    /// Raise alerts for this region only. Repeat the option for several regions; `all` stands for all regions.
    #[arg(long, value_name = "REGION", value_parser = region_bits)]
    region: Vec<u8>,
    /// Raise no alert for this time after another one, minutes, 1 to 720.
    #[arg(long, value_name = "MIN", value_parser = clap::value_parser!(u16).range(1..=720))]
    pause: Option<u16>,
    /// Raise at most this number of alerts in a day.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    per_day: Option<u8>,
    /// Time at which the wearer's day begins, minutes after midnight UTC, below 1440.
    #[arg(long, value_name = "MIN", value_parser = clap::value_parser!(u16).range(..1440))]
    day_start: Option<u16>,
    /// Raise no alerts for at least this time from now, minutes, up to 720; a longer pause or snooze continues. With 0, both end
    /// at once.
    #[arg(long, value_name = "MIN", value_parser = clap::value_parser!(u16).range(0..=720))]
    snooze: Option<u16>,
}

/// The bit of the region with this name in [`AlertRules::regions`], or all bits for `all`.
fn region_bits(name: &str) -> Result<u8, String> {
    if name == "all" {
        return Ok(0xff);
    }
    let names = || Region::ALL.map(Region::name).join(", ");
    let region =
        Region::from_name(name).ok_or_else(|| format!("the regions are {}; all stands for every region", names()))?;
    Ok(1 << region as u8)
}

impl AlertArgs {
    /// Changes the rules by the options and suspends alerts if --snooze is given, then prints the rules and the load of the
    /// day.
    pub fn run(&self, client: &mut AnyClient) -> Result<()> {
        let before = client.alert_rules()?;
        let rules = self.changed(before);
        ensure!(
            rules.is_valid(),
            "rules out of range: pressures must be 1 to 2000 kPa, --ends above 0 % and below --begins, --begins at most 100 %, \
             and --dose 0 to 1e7 kPa s"
        );
        if rules != before {
            client.set_alert_rules(&rules)?;
        }
        let daily = match self.snooze {
            Some(minutes) => client.snooze_alerts(minutes * 60)?,
            None => client.daily_load()?,
        };
        print_rules(&rules);
        print_daily(&daily);
        Ok(())
    }

    /// These rules, changed by the options.
    fn changed(&self, mut rules: AlertRules) -> AlertRules {
        let limits = &mut rules.limits;
        let set = |field: &mut f32, value: Option<f32>| *field = value.unwrap_or(*field);
        set(&mut limits.sustained_kpa, self.sustained_pressure);
        set(&mut limits.dose_kpa, self.dose_pressure);
        set(&mut rules.dose_kpa_s, self.dose);
        limits.window_s = self.window.map_or(limits.window_s, |minutes| minutes * 60);
        limits.sustained_percent = self.begins.unwrap_or(limits.sustained_percent);
        limits.relieved_percent = self.ends.unwrap_or(limits.relieved_percent);
        rules.pause_s = self.pause.map_or(rules.pause_s, |minutes| minutes * 60);
        if !self.region.is_empty() {
            rules.regions = self.region.iter().fold(0, |all, bit| all | bit);
        }
        rules.day_start_min = self.day_start.unwrap_or(rules.day_start_min);
        rules.per_day = match self.per_day {
            Some(count) => count,
            None if self.off => 0,
            None if self.on && rules.per_day == 0 => AlertRules::RECOMMENDED.per_day,
            None => rules.per_day,
        };
        rules
    }
}

/// Prints the rules of alerts.
fn print_rules(rules: &AlertRules) {
    let limits = &rules.limits;
    if rules.per_day == 0 {
        println!("alerts: off; --on raises them");
    } else {
        let has_alerts = |i: usize| rules.regions >> i & 1 == 1;
        let regions = REGION_LABELS.iter().enumerate().filter(|(i, _)| has_alerts(*i)).map(|(_, name)| *name);
        println!("alerts: at most {} in a day, at least {} minutes apart", rules.per_day, rules.pause_s / 60);
        println!(
            "  regions: {}",
            if rules.regions == 0xff { "all".into() } else { regions.collect::<Vec<_>>().join(", ") }
        );
    }
    println!(
        "  sustained load: at least {} kPa for {} % of {} minutes, until this share is below {} %",
        limits.sustained_kpa,
        limits.sustained_percent,
        limits.window_s / 60,
        limits.relieved_percent
    );
    match rules.dose_kpa_s {
        limit if limit > 0.0 => println!("  dose: {limit} kPa s in a day above {} kPa", limits.dose_kpa),
        _ => println!("  dose: counted above {} kPa, without an alert", limits.dose_kpa),
    }
    println!("  the day begins at {:02}:{:02} UTC", rules.day_start_min / 60, rules.day_start_min % 60);
}

/// Prints the load of the day.
fn print_daily(daily: &DailyLoad) {
    println!(
        "load of the day: {} steps, {} minutes with load, {} alerts",
        daily.totals.steps,
        daily.totals.loaded_s / 60,
        daily.alerts
    );
    if daily.snoozed_s > 0 {
        println!("no alerts for another {} minutes", daily.snoozed_s.div_ceil(60));
    }
    let mut table = summary::table();
    table.set_header(["region", "dose kPa s", "squared pressure kPa2 s", "sustained load min"]);
    for (i, (name, total)) in REGION_LABELS.iter().zip(&daily.totals.regions).enumerate() {
        let is_sustained = daily.sustained >> i & 1 == 1;
        table.add_row([
            (*name).into(),
            format!("{:.0}", f64::from(total.dose_dkpa_s) / 10.0),
            total.squared_kpa2_s.to_string(),
            format!("{:.1}{}", f64::from(total.sustained_s) / 60.0, if is_sustained { " now" } else { "" }),
        ]);
    }
    summary::align(&mut table);
    if let Some(column) = table.column_mut(0) {
        column.set_cell_alignment(CellAlignment::Left);
    }
    println!("{table}");
}
