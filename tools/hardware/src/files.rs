//! The files that need no simulation: bill of materials, list of nets, figures from data sheets, schematic, and circuit for
//! ngspice. Also the table of the simulated figures.

use crate::data_sheet::FIGURES;
use crate::figures::Figure;
use crate::netlist::Netlist;
use crate::parts::PartType;
use crate::schematic::Schematic;
use crate::spice::{Conditions, circuit};
use anyhow::{Result, anyhow};
use std::fmt::Write;

/// A file: its name in the folder `hardware`, and its content.
pub type File = (&'static str, String);

/// The files that need no simulation: bill of materials, list of nets, figures from data sheets, schematic, and circuit for
/// ngspice.
///
/// # Errors
/// If the schematic contradicts the netlist.
pub fn files(board: &Netlist) -> Result<Vec<File>> {
    let schematic = Schematic::of(board);
    schematic.check().map_err(|error| anyhow!("the schematic contradicts the netlist: {error}"))?;
    Ok(vec![
        ("bill-of-materials.csv", bill_of_materials(board)?),
        ("nets.csv", nets(board)?),
        ("data-sheet-figures.csv", data_sheet_figures()?),
        ("schematic.svg", schematic.svg()),
        ("front-end.cir", circuit(board, &Conditions::idle())),
    ])
}

/// The text of a CSV file.
fn table(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header)?;
    rows.into_iter().try_for_each(|row| writer.write_record(row))?;
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// The bill of materials: a row for each type of part.
fn bill_of_materials(board: &Netlist) -> Result<String> {
    let mut kinds: Vec<(&PartType, Vec<&str>)> = Vec::new();
    for part in &board.parts {
        match kinds.iter_mut().find(|(kind, _)| kind.number == part.kind.number) {
            Some((_, designators)) => designators.push(&part.designator),
            None => kinds.push((part.kind, vec![&part.designator])),
        }
    }
    let rows = kinds.into_iter().map(|(kind, designators)| {
        vec![
            designators.join(" "),
            designators.len().to_string(),
            kind.number.into(),
            kind.manufacturer.into(),
            kind.alternatives.join("; "),
            kind.value.into(),
            kind.package.into(),
            kind.purpose.into(),
        ]
    });
    let header =
        ["designators", "quantity", "part number", "manufacturer", "alternatives", "value", "package", "purpose"];
    table(&header, rows)
}

/// The nets, each with its pins as designator and number, for the layout of a board.
fn nets(board: &Netlist) -> Result<String> {
    let texts =
        |pins: Vec<(&str, &str)>| pins.iter().map(|(part, number)| format!("{part}.{number}")).collect::<Vec<_>>();
    table(&["net", "pins"], board.nets().into_iter().map(|(net, pins)| vec![net.into(), texts(pins).join(" ")]))
}

/// The figures from data sheets, with their sources.
fn data_sheet_figures() -> Result<String> {
    let rows = FIGURES.iter().map(|figure| {
        vec![
            figure.part.into(),
            figure.quantity.into(),
            format!("{:e}", figure.value),
            figure.unit.into(),
            figure.source.into(),
            figure.status.text().into(),
        ]
    });
    table(&["part", "quantity", "value", "unit", "source", "status"], rows)
}

/// The table of the simulated figures, as a Markdown file.
pub fn figures_table(figures: &[Figure]) -> String {
    let mut text = String::from(
        "# Figures of the simulated front end\n\n`cargo xtask hardware` writes this file. \
         [docs/hardware.md](../docs/hardware.md) explains the figures.\n\
         A cell at full load has 3.4 kohm, at 855 kPa. A step is the least significant bit of the 12-bit converter,\n\
         16 codes. The largest offset is 1.6 mV, with opposite signs in the measured column and in all others.\n\
         Differences are stated without their sign.\n\n\
         | Figure | Value | Limit | Meaning |\n|---|---|---|---|\n",
    );
    for figure in figures {
        // Writing to a String does not fail.
        let _ = writeln!(
            text,
            "| `{}` | {} | {} | {} |",
            figure.key,
            figure.value_text(),
            figure.limit_text(),
            figure.meaning
        );
    }
    text
}
