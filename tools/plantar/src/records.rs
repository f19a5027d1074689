//! The steps, load bouts and alerts of a session.

use crate::summary;
use anyhow::Result;
use comfy_table::CellAlignment;
use parameters::DeformationScale;
use plantar::pipeline::bout::BoutKind;
use plantar::protocol::{Alert, Bout, LoadRecord, Step};
use recording::output;
use serde::Serializer;
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Steps, load bouts and alerts, each in the order of their numbers.
#[derive(Default)]
pub struct Records {
    pub steps: Vec<Step>,
    /// The heel strike of each step on the clock of a recording, s; empty for steps of an insole.
    pub step_starts_s: Vec<f64>,
    pub bouts: Vec<Bout>,
    pub alerts: Vec<Alert>,
}

impl Records {
    /// Adds a record to the list of its kind.
    pub fn push(&mut self, record: &LoadRecord) {
        match record {
            LoadRecord::Step(step) => self.steps.push(*step),
            LoadRecord::Bout(bout) => self.bouts.push(*bout),
            LoadRecord::Alert(alert) => self.alerts.push(*alert),
        }
    }

    /// Prints the tables of the steps, a table of the load bouts, and the alerts. `scales` states for each region whether the
    /// scale of its deformation was measured or assumed.
    pub fn print(&self, scales: &[DeformationScale; 8]) {
        summary::print(&self.steps, &self.step_starts_s, scales);
        if !self.bouts.is_empty() {
            self.print_bouts();
        }
        self.alerts.iter().for_each(|alert| println!("{}", alert_line(alert)));
    }

    fn print_bouts(&self) {
        let mut table = summary::table();
        table.set_header(["load outside steps", "bouts", "time s", "force-time integral N s"]);
        for kind in BoutKind::ALL {
            let bouts: Vec<_> = self.bouts.iter().filter(|bout| bout.kind == kind).collect();
            if !bouts.is_empty() {
                table.add_row([
                    kind.name().to_string(),
                    bouts.len().to_string(),
                    format!("{:.1}", bouts.iter().map(|bout| bout.duration_s()).sum::<f64>()),
                    format!("{:.0}", bouts.iter().map(|bout| integral_n_s(bout)).sum::<f64>()),
                ]);
            }
        }
        summary::align(&mut table);
        if let Some(column) = table.column_mut(0) {
            column.set_cell_alignment(CellAlignment::Left);
        }
        println!("{table}");
    }
}

/// Writes a JSON array, object by object: all objects of a day together would need gigabytes of memory.
pub fn write_json(path: &Path, objects: impl Iterator<Item = Value>) -> Result<()> {
    Ok(output::file(path, |file| {
        serde_json::Serializer::pretty(&mut *file).collect_seq(objects)?;
        file.write_all(b"\n")
    })?)
}

/// Force-time integral of the foot in a bout, N s.
fn integral_n_s(bout: &Bout) -> f64 {
    bout.regions.iter().map(|region| region.measured_force_integral_n_s()).sum()
}

/// An alert in one line.
pub fn alert_line(alert: &Alert) -> String {
    let boot = if alert.boots_since > 0 { " of an earlier start of the insole" } else { "" };
    format!("alert {} at {:.0} s{boot}: {}", alert.number, alert.start_s(), client::alert_advice(alert))
}

/// A load bout in one line.
pub fn bout_line(bout: &Bout) -> String {
    format!(
        "load bout {}, {}, from {:.2} s for {:.2} s: {:.0} N s",
        bout.number,
        bout.kind.name(),
        bout.start_s(),
        bout.duration_s(),
        integral_n_s(bout)
    )
}
