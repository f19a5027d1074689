//! Writes the files of the reference board to the folder `hardware`: bill of materials, schematic, nets and circuit from the
//! netlist, the figures from data sheets, and plots and figures from the simulation of its front end. Fails if a figure misses
//! its limit.

use anyhow::{Context, Result, bail};
use clap::Parser;
use hardware::figures::simulate;
use hardware::files::{figures_table, files};
use hardware::netlist::Netlist;
use hardware::plots::plots;
use serde_json::Map;
use std::fs;
use std::path::{Path, PathBuf};

/// Simulate the front end of the reference board in ngspice, and write its files to the folder `hardware`.
#[derive(Parser)]
struct Arguments {
    /// Also write the figures to this file, as one JSON object with a number for each key.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    // This package is in the folder tools/hardware of the repository.
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../hardware");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let write =
        |path: &Path, text: &str| fs::write(path, text).with_context(|| format!("cannot write {}", path.display()));

    let board = Netlist::reference();
    for (name, text) in files(&board)? {
        write(&folder.join(name), &text)?;
    }
    let results = simulate(&board)?;
    for (name, text) in plots(&results) {
        write(&folder.join(name), &text)?;
    }
    write(&folder.join("figures.md"), &figures_table(&results.figures))?;
    for figure in &results.figures {
        let (value, limit) = (figure.value_text(), figure.limit_text());
        println!("{:<36} {value:>8}  {limit:<16} {}", figure.key, figure.meaning);
    }
    if let Some(path) = &arguments.json {
        let figures: Map<_, _> =
            results.figures.iter().map(|figure| (figure.key.to_string(), figure.value.into())).collect();
        write(path, &(serde_json::to_string_pretty(&figures)? + "\n"))?;
    }
    let missed: Vec<_> = results.figures.iter().filter(|figure| figure.is_missed()).map(|figure| figure.key).collect();
    if !missed.is_empty() {
        bail!(
            "figures that miss their limit: {}: change the parts in tools/hardware/src/parts.rs or netlist.rs, and run \
             `cargo xtask hardware` again",
            missed.join(", ")
        );
    }
    Ok(())
}
