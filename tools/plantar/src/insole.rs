//! `plantar insole`.

use crate::carrier::{ANSWER, Carrier, Session};
use anyhow::{Context, Result, bail, ensure};
use clap::{Subcommand, ValueEnum};
use plantar::Side;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::protocol::{Identity, Serial};
use serde::Deserialize;
use std::path::{Path, PathBuf};

#[derive(Subcommand)]
pub enum Insole {
    /// Show what an insole keeps: its name, its calibration, how often it started, what it could not keep.
    Show {
        #[command(flatten)]
        carrier: Carrier,
    },
    /// Name an insole: foot and serial number. It restarts.
    Name {
        /// The foot it is for.
        #[arg(long)]
        side: Option<Foot>,
        /// Up to 16 letters, digits or signs.
        #[arg(long, value_name = "TEXT", value_parser = serial)]
        serial_number: Option<Serial>,
        #[command(flatten)]
        carrier: Carrier,
    },
    /// Give an insole its cells' calibration. It restarts.
    ///
    /// The file has a line `cell,offset,gain` for each cell in the order of the insole's layout: the code that the unloaded
    /// cell reads, and what its pressure is multiplied by, 0.1 to 10.
    Calibrate {
        /// The calibration, CSV.
        file: PathBuf,
        #[command(flatten)]
        carrier: Carrier,
    },
    /// Restart an insole.
    Restart {
        #[command(flatten)]
        carrier: Carrier,
    },
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Foot {
    Left,
    Right,
}

fn serial(text: &str) -> Result<Serial, String> {
    Serial::new(text).ok_or_else(|| "a serial number has up to 16 letters, digits or signs, without spaces".into())
}

impl Insole {
    pub fn run(&self) -> Result<()> {
        match self {
            Self::Show { carrier } => show(carrier),
            Self::Name { side, serial_number, carrier } => {
                ensure!(
                    side.is_some() || serial_number.is_some(),
                    "nothing to change: give --side, --serial-number or both"
                );
                let mut client = carrier.connect()?;
                let before = client.identity()?;
                let side = match side {
                    Some(Foot::Left) => Side::Left,
                    Some(Foot::Right) => Side::Right,
                    None => before.side,
                };
                let identity = client.set_identity(side, serial_number.unwrap_or(before.serial))?;
                restart(carrier, client)?;
                print(&identity);
                Ok(())
            }
            Self::Calibrate { file, carrier } => {
                let cells = read(file)?;
                let mut client = carrier.connect()?;
                let wanted = client.hello().cells;
                if cells.len() != usize::from(wanted) {
                    bail!(
                        "{}: {} cells, the insole has {wanted}: one line a cell is needed",
                        file.display(),
                        cells.len()
                    );
                }
                let identity = client.calibrate(&cells)?;
                restart(carrier, client)?;
                print(&identity);
                Ok(())
            }
            Self::Restart { carrier } => restart(carrier, carrier.connect()?),
        }
    }
}

fn show(carrier: &Carrier) -> Result<()> {
    let mut client = carrier.connect()?;
    let identity = client.identity()?;
    let status = client.status()?;
    let contents = status.contents;
    let hello = client.hello();
    println!("{} insole, firmware {}, {} cells", hello.board, hello.firmware, hello.cells);
    print(&identity);
    println!("start number {} (reason: {}), steps so far {}", contents.start, hello.reset.name(), contents.next_step);
    if let Some(last) = &hello.last_panic {
        println!("note: {last}");
    }
    let warnings = [
        (
            status.not_stored > 0,
            "it could not keep something: its flash chip fails, and what was sent holds until it restarts",
        ),
        (
            contents.newer_kinds > 0,
            "it holds records of a newer firmware, which are left alone: update its firmware to use them",
        ),
        (
            contents.newer_steps > 0,
            "it holds steps of a newer firmware, which are left alone: update its firmware to get them",
        ),
        (contents.erased > 0, "part of its flash chip was damaged beyond repair and had to be erased"),
        (status.steps_dropped > 0, "its log was full: the oldest steps had to make room"),
    ];
    for (_, warning) in warnings.iter().filter(|(holds, _)| *holds) {
        println!("warning: {warning}");
    }
    Ok(())
}

fn print(identity: &Identity) {
    let serial = Some(identity.serial.as_str()).filter(|serial| !serial.is_empty());
    println!("{} foot, serial number {}", identity.side.name(), serial.unwrap_or("none"));
    match identity.calibration_id {
        0 => println!("calibration built in"),
        id => println!("calibration {id:08x}"),
    }
}

fn restart(carrier: &Carrier, mut client: Session) -> Result<()> {
    // A cable stays, Bluetooth goes with the insole.
    if client.restart(ANSWER).is_err() {
        carrier.reconnect(&mut client).context("the insole was told to restart and did not come back")?;
    }
    Ok(())
}

#[derive(Deserialize)]
struct Line {
    cell: u16,
    offset: u16,
    gain: f32,
}

fn read(path: &Path) -> Result<Vec<CellCalibration>> {
    let mut lines = csv::Reader::from_path(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut cells = Vec::new();
    for (number, line) in lines.deserialize().enumerate() {
        let place = || format!("{}, cell {number}", path.display());
        let Line { cell, offset, gain } = line.with_context(place)?;
        ensure!(usize::from(cell) == number, "{}: this is cell {cell}: cells are in order, from 0", place());
        let calibration = CellCalibration { offset, gain };
        ensure!(
            calibration.is_valid(),
            "{}: offset {offset}, gain {gain}: the offset is below half of the scale, the gain 0.1 to 10",
            place()
        );
        cells.push(calibration);
    }
    Ok(cells)
}
