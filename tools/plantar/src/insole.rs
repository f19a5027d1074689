//! `plantar insole`: identity, settings, alerts and calibration of an insole.

use crate::calibrate::{PLATEAUS_FILE, plateaus_of};
use crate::carrier::{AnyClient, Connection, InsoleLink};
use crate::params::note_unless_of_this_foot;
use crate::summary::{REGION_LABELS, rejected_line};
use anyhow::{Context, Result, bail, ensure};
use clap::{Subcommand, ValueEnum};
use client::ReconnectPolicy;
use plantar::Side;
use plantar::pipeline::baseline::MAX_RESIDUAL_KPA;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::protocol::{Identity, Radio, Serial, Status};
use recording::{Plateaus, output};
use serde::Deserialize;
use std::io::Write as _;
use std::path::{Path, PathBuf};

pub mod alerts;
pub mod settings;
use alerts::AlertArgs;
use settings::{SettingsArgs, print_settings};

#[derive(Subcommand)]
pub enum Insole {
    /// Show the foot, serial number, settings, calibration, number of boots, power use and storage errors of an insole.
    Show {
        #[command(flatten)]
        connection: Connection,
    },
    /// Set the foot and the serial number of an insole. The insole restarts afterwards.
    Name {
        /// The foot that the insole is for [default: unchanged].
        #[arg(long)]
        side: Option<Foot>,
        /// The serial number, up to 16 characters: digits, punctuation marks or letters without accents, but no spaces [default:
        /// unchanged].
        #[arg(long, value_name = "TEXT", value_parser = serial)]
        serial_number: Option<Serial>,
        #[command(flatten)]
        connection: Connection,
    },
    /// Set the rules of contact and stance, the frame rate and the size of an insole. The insole restarts afterwards.
    ///
    /// Values that are not given remain as they are. Parameters that were identified with another contact rule are not used any
    /// more. Those of another size remain in use: identify the wearer again after a change of the size.
    Set {
        #[command(flatten)]
        settings: SettingsArgs,
        #[command(flatten)]
        connection: Connection,
    },
    /// Show and set the rules of alerts, and show the load of the day.
    ///
    /// An alert asks the wearer to unload a region that carried load for too long. Values that are not given remain as they are.
    Alerts {
        #[command(flatten)]
        alerts: AlertArgs,
        #[command(flatten)]
        connection: Connection,
    },
    /// Measure the baselines of all cells: sit down, lift the foot, and hold it still.
    ///
    /// An insole does this by itself at its start and in each swing, where it raises a baseline only to the lower of the
    /// readings of two successive swings. This command makes the insole use the next reading at once. Use it, for example, after
    /// the shoe was laced again. The insole refuses if the foot carries load or moves.
    Zero {
        #[command(flatten)]
        connection: Connection,
    },
    /// Store the calibration of an insole's cells. The insole restarts afterwards.
    ///
    /// The file has the header `cell,offset,gain` and one line for each cell, in the order of the insole's layout. `cell` is the
    /// cell's number from 0, `offset` the code of the unloaded cell, and `gain` the factor that corrects its pressure, 0.1 to 10.
    /// `plantar calibrate` determines it; its file is refused for another insole.
    Calibrate {
        /// The CSV file with the calibration.
        file: PathBuf,
        #[command(flatten)]
        connection: Connection,
    },
    /// Erase everything about the wearer from an insole, for example before another person wears it. The insole restarts
    /// afterwards.
    ///
    /// Erases parameters, rules of alerts, load of the day, bonds, and all steps, load bouts and alerts that no host has
    /// received. Foot, serial number, calibration and settings remain.
    Erase {
        /// Confirms that the data are to be erased.
        #[arg(long, required = true)]
        yes: bool,
        #[command(flatten)]
        connection: Connection,
    },
    /// Restart an insole.
    Restart {
        #[command(flatten)]
        connection: Connection,
    },
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Foot {
    Left,
    Right,
}

/// Parses a serial number.
fn serial(text: &str) -> Result<Serial, String> {
    Serial::new(text).ok_or_else(|| {
        "a serial number has up to 16 characters: digits, punctuation marks or letters without accents, but no spaces"
            .into()
    })
}

impl Insole {
    pub fn run(&self) -> Result<()> {
        match self {
            Self::Show { connection } => show(connection),
            Self::Name { side, serial_number, connection } => {
                ensure!(
                    side.is_some() || serial_number.is_some(),
                    "nothing to change: give --side, --serial-number or both"
                );
                let mut insole = connection.open(ReconnectPolicy::RESTART)?;
                let client = insole.client();
                let before = client.identity()?;
                let side = match side {
                    Some(Foot::Left) => Side::Left,
                    Some(Foot::Right) => Side::Right,
                    None => before.side,
                };
                let identity = client.set_identity(side, serial_number.unwrap_or(before.serial))?;
                restart(&mut insole)?;
                print_identity(&identity);
                note_unless_of_this_foot(&mut insole);
                Ok(())
            }
            Self::Set { settings, connection } => {
                let mut insole = connection.open(ReconnectPolicy::RESTART)?;
                let client = insole.client();
                if client.settings()?.is_none() && !settings::are_used(client)? {
                    // The restart after the settings of a host were removed has failed: those in use would be stored again.
                    restart(&mut insole)?;
                }
                settings.set(insole.client())?;
                restart(&mut insole)?;
                print_settings(insole.client())
            }
            Self::Alerts { alerts, connection } => alerts.run(connection.open(ReconnectPolicy::RESTART)?.client()),
            Self::Zero { connection } => zero(connection.open(ReconnectPolicy::RESTART)?.client()),
            Self::Calibrate { file, connection } => {
                let cells = read_calibration(file)?;
                let mut insole = connection.open(ReconnectPolicy::RESTART)?;
                let client = insole.client();
                let count = client.hello().cells;
                if cells.len() != usize::from(count) {
                    bail!(
                        "{}: {} cells, but the insole has {count}: the file must have one line for each cell",
                        file.display(),
                        cells.len()
                    );
                }
                ensure_same_insole(file, client)?;
                let identity = client.calibrate(&cells)?;
                restart(&mut insole)?;
                print_identity(&identity);
                Ok(())
            }
            Self::Erase { yes: _, connection } => {
                let mut insole = connection.open(ReconnectPolicy::RESTART)?;
                insole.client().erase_wearer()?;
                println!(
                    "the data of the wearer are erased, and the insole restarts: switch it off for some seconds and on \
                     again, then pair phones and computers within a minute"
                );
                Ok(())
            }
            Self::Restart { connection } => restart(&mut connection.open(ReconnectPolicy::RESTART)?),
        }
    }
}

/// Prints the identity and the condition of an insole.
fn show(connection: &Connection) -> Result<()> {
    let mut insole = connection.open(ReconnectPolicy::RESTART)?;
    let client = insole.client();
    let identity = client.identity()?;
    let status = client.status()?;
    let contents = status.contents;
    let hello = client.hello();
    println!("{} insole, firmware {}, {} cells", hello.board, hello.firmware, hello.cells);
    print_identity(&identity);
    print_settings(client)?;
    let hello = client.hello();
    println!(
        "boot number {}; reset reason: {}; steps, load bouts and alerts so far: {}",
        contents.start,
        hello.reset.name(),
        contents.next_record
    );
    if let Some(line) = rejected_line(&status.rejected) {
        println!("since the last start, {line}");
    }
    print_power(&status);
    if let Some(fault) = &hello.fault {
        println!("note: the insole reports a failure: {fault}");
    }
    let warnings = [
        (
            status.not_stored > 0,
            "the insole could not store some data since its start, because its supply was too low (charge its battery) or its \
             flash chip is failing; a restart loses unstored settings",
        ),
        (
            contents.newer_kinds > 0,
            "the insole stores records of a newer firmware, which are not changed: update its firmware to use them",
        ),
        (
            contents.newer_records > 0,
            "the insole's log has entries of a newer firmware, which remain until the log is full: update the firmware to receive \
             them",
        ),
        (
            contents.erased > 0,
            "a part of the insole's flash chip was damaged and had to be erased, so its contents are lost",
        ),
        (
            contents.contradictions > 0,
            "successive readings of the insole's flash chip at its start differed, so its supply voltage may rise too slowly: \
             if data are not stored, switch the insole off and on",
        ),
        (
            !status.is_clock_set,
            "the insole's clock has not been set since its last start: steps have no time of day until a host streams from it",
        ),
        (
            status.records_dropped > 0,
            "steps, load bouts and alerts were dropped, because the insole's log was full, or because they could not be stored",
        ),
    ];
    for (_, warning) in warnings.iter().filter(|(applies, _)| *applies) {
        println!("warning: {warning}");
    }
    match status.radio {
        Radio::Silent | Radio::Answers => {}
        Radio::NoFirmware => println!(
            "warning: no Bluetooth, because the firmware of the insole's radio is missing: install it as docs/hardware.md states"
        ),
        Radio::Failed(code) => println!(
            "warning: no Bluetooth, because the insole's radio does not start (code {code}): switch the insole off and on; the \
             log of a debug probe has more"
        ),
    }
    Ok(())
}

/// Prints the shares of time in which the insole was not worn, scanned, and evaluated frames: they determine how long the
/// battery lasts. Then prints the supply voltage.
fn print_power(status: &Status) {
    let share = |ms: u32| 100.0 * f64::from(ms) * 1000.0 / status.uptime_us.max(1) as f64;
    let unworn = 100.0 * f64::from(status.frames_skipped) / f64::from(status.frame_times().max(1));
    let worn = if status.is_worn { "worn" } else { "not worn: it scans twice a second until it is loaded" };
    println!("the insole is {worn}; since its start it was not worn {unworn:.0} % of the time");
    println!(
        "scanning {:.1} %, evaluating frames {:.1} % of the time{}",
        share(status.scanning_ms),
        share(status.processing_ms),
        status.supply_mv.map_or(String::new(), |mv| format!("; supply {:.2} V", f64::from(mv) / 1000.0))
    );
}

/// Measures the baselines, and prints the result.
fn zero(client: &mut AnyClient) -> Result<()> {
    let result = client.zero()?;
    let forces = REGION_LABELS.iter().zip(result.residual_dn).filter(|(_, dn)| *dn > 0);
    let forces: Vec<_> = forces.map(|(name, dn)| format!("{name} {:.1} N", f64::from(dn) / 10.0)).collect();
    println!("the baselines of {} cells have changed", result.changed);
    println!("force that is subtracted: {}", if forces.is_empty() { "none".into() } else { forces.join(", ") });
    for (name, cells) in REGION_LABELS.iter().zip(result.with_former_baseline).filter(|(_, cells)| *cells > 0) {
        println!(
            "warning: {cells} cells of {name} read more than {MAX_RESIDUAL_KPA} kPa, so their former baselines remain: loosen the \
             shoe, or check these cells"
        );
    }
    Ok(())
}

/// Prints foot, serial number and calibration.
fn print_identity(identity: &Identity) {
    let serial = Some(identity.serial.as_str()).filter(|serial| !serial.is_empty());
    println!("{} foot, serial number {}", identity.side.name(), serial.unwrap_or("none"));
    match identity.calibration_id {
        0 => println!("calibration: none stored; the insole uses the one in its firmware"),
        id => println!("calibration {id:08x}"),
    }
}

/// Restarts an insole and waits until it answers again.
pub fn restart(insole: &mut InsoleLink) -> Result<()> {
    insole.restart().context("the insole did not restart, or did not answer afterwards: switch it off and on")?;
    Ok(())
}

/// A line of a calibration file.
#[derive(Deserialize)]
struct CalibrationLine {
    cell: u16,
    offset: u16,
    gain: f32,
}

/// Refuses a calibration of another insole or of another sensor law, as the plateaus of `plantar calibrate` beside the file show.
/// A file without plateaus states no insole.
fn ensure_same_insole(file: &Path, client: &mut AnyClient) -> Result<()> {
    let plateaus = file.with_file_name(PLATEAUS_FILE);
    if !plateaus.exists() {
        return Ok(());
    }
    let of = Plateaus::read(&plateaus)?;
    let insole = plateaus_of(client)?;
    ensure!(
        of.is_of_same_insole(&insole),
        "{}: the calibration is that of the {} insole {}, not of this one, the {} insole {}: connect the right insole",
        file.display(),
        of.side.name(),
        of.serial_number,
        insole.side.name(),
        insole.serial_number
    );
    ensure!(
        of.law == insole.law,
        "{}: the firmware of this insole has another sensor law: determine the gains for it with `plantar calibrate measure`, as \
         docs/calibration.md describes",
        file.display()
    );
    Ok(())
}

/// Writes a calibration file. The file appears only once it is complete, because an incomplete one could be sent to an insole.
pub fn write_calibration(path: &Path, cells: &[CellCalibration]) -> Result<()> {
    let lines = cells.iter().enumerate().map(|(i, cell)| format!("{i},{},{}\n", cell.offset, cell.gain));
    let text: String = std::iter::once("cell,offset,gain\n".to_string()).chain(lines).collect();
    Ok(output::file(path, |to| to.write_all(text.as_bytes()))?)
}

/// Reads and checks a calibration file.
pub fn read_calibration(path: &Path) -> Result<Vec<CellCalibration>> {
    let mut lines = csv::Reader::from_path(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut cells = Vec::new();
    for (number, line) in lines.deserialize().enumerate() {
        let place = || format!("{}, cell {number}", path.display());
        let CalibrationLine { cell, offset, gain } = line.with_context(place)?;
        ensure!(
            usize::from(cell) == number,
            "{}: the line is for cell {cell}, but cells must be in order, from 0",
            place()
        );
        let calibration = CellCalibration { offset, gain };
        ensure!(
            calibration.is_valid(),
            "{}: offset {offset}, gain {gain}: the offset must be below half of full scale, the gain 0.1 to 10",
            place()
        );
        cells.push(calibration);
    }
    Ok(cells)
}
