//! Runs ngspice.

use anyhow::{Context, Result, bail};
use std::fs;
use std::process::{Command, Stdio};

/// Messages of ngspice on an analysis without a solution.
const FAILURES: [&str; 4] =
    ["source stepping failed", "singular matrix", "Timestep too small", "simulation(s) aborted"];

/// A table that ngspice wrote: its rows, each with the scale (time or frequency) first.
pub type Table = Vec<Vec<f64>>;

/// Analyses of a circuit. Tables are numbered in the order in which they were requested.
pub struct Run {
    circuit: String,
    control: String,
    table_count: usize,
}

impl Run {
    /// A run of this circuit without analyses.
    pub fn of(circuit: String) -> Self {
        let control = "set wr_singlescale\nset numdgt=12\nset noaskquit\n".into();
        Self { circuit, control, table_count: 0 }
    }

    /// Adds a command.
    pub fn command(mut self, command: &str) -> Self {
        self.control += command;
        self.control.push('\n');
        self
    }

    /// Adds an analysis, and a table of these vectors over its scale.
    pub fn table(mut self, analysis: &str, vectors: &str) -> Self {
        let write = format!("wrdata table{}.txt {vectors}", self.table_count);
        self.table_count += 1;
        self.command(analysis).command(&write)
    }

    /// Runs ngspice, and returns the tables.
    ///
    /// # Errors
    /// If ngspice is not installed, or an analysis fails.
    pub fn tables(self) -> Result<Vec<Table>> {
        let folder = tempfile::tempdir()?;
        let text = format!("{}.control\n{}quit 0\n.endc\n.end\n", self.circuit, self.control);
        fs::write(folder.path().join("circuit.cir"), text)?;
        let output = Command::new("ngspice")
            .args(["--no-spiceinit", "--batch", "circuit.cir"])
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .output()
            .context("cannot run ngspice: install it with `cargo xtask setup`")?;
        let log = String::from_utf8_lossy(&output.stderr) + String::from_utf8_lossy(&output.stdout);
        // After such a message, ngspice still writes the values of its last attempt, and ends with success.
        if let Some(line) = log.lines().find(|line| FAILURES.iter().any(|failure| line.contains(failure))) {
            bail!("ngspice found no solution: {line}");
        }
        let table = |i: usize| -> Result<Table> {
            let text = fs::read_to_string(folder.path().join(format!("table{i}.txt")))
                .with_context(|| format!("ngspice did not complete analysis {i}: {log}"))?;
            let row = |line: &str| line.split_whitespace().map(|number| Ok(number.parse()?)).collect();
            text.lines().map(row).collect::<Result<_>>().with_context(|| format!("cannot read table {i} of ngspice"))
        };
        let tables = (0..self.table_count).map(table).collect::<Result<Vec<_>>>()?;
        if !output.status.success() || tables.iter().any(Vec::is_empty) {
            bail!("ngspice failed: {log}");
        }
        Ok(tables)
    }
}
