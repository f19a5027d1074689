//! `plantar calibrate`: the gain of each cell and the sensor law, from known pressures that act on the whole insole.

use crate::carrier::{Connection, InsoleLink};
use crate::cells::start_slowly;
use crate::insole::write_calibration;
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Subcommand};
use client::{Event, ReconnectPolicy, SessionStart};
use fit::calibration::{Calibration, Check};
use plantar::pipeline::calibrate::{CellCalibration, Curve};
use plantar::protocol::{CellFrame, ToHost};
use recording::{MAX_PLATEAU_KPA, Plateau, Plateaus, output};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use std::time::{Duration, Instant};

/// Time of the measurement of a plateau.
const HOLD: Duration = Duration::from_secs(3);
/// Frames of cells per second during a measurement, unless the connection is too slow for this rate.
const HOLD_HZ: f64 = 20.0;
/// Smallest number of frames of a plateau.
const LEAST_FRAMES: usize = 10;
/// A plateau is measured again if the median reading changes by more than this part of it and by more than [`UNSTEADY_KPA`].
const UNSTEADY: f64 = 0.03;
/// See [`UNSTEADY`].
const UNSTEADY_KPA: f64 = 0.3;

#[derive(Subcommand)]
pub enum Calibrate {
    /// Measure the codes of all cells at known pressures, and determine the calibration.
    ///
    /// The command asks for each pressure: set it, wait until it is steady, and press Enter. Begin and end with 0, the insole
    /// without load, and apply the pressures first in increasing and then in decreasing order: the difference is the hysteresis
    /// of the sheet. Each plateau is stored in FOLDER/plateaus.json at once; after an interruption, the same command continues
    /// with the next one. The last plateau is followed by what `plantar calibrate evaluate` does.
    Measure {
        /// The pressures in the order of measurement, kPa, separated by commas: at least one of 0 and two different ones above
        /// 0.
        #[arg(long, value_name = "KPA", value_delimiter = ',', required = true, value_parser = pressure_kpa)]
        pressures: Vec<f64>,
        #[command(flatten)]
        folder: Folder,
        #[command(flatten)]
        connection: Connection,
    },
    /// Determine the calibration from plateaus that were measured.
    ///
    /// Writes FOLDER/calibration.csv, which `plantar insole calibrate` stores on the insole, and FOLDER/calibration.html, a
    /// report. The gains are those for the sensor law of the insole's firmware. If the plateaus show another law, the command
    /// prints it; it has to be built into the firmware. Afterwards, `plantar calibrate measure` with the same pressures and
    /// folder determines the gains for the new law, without another measurement.
    Evaluate {
        #[command(flatten)]
        folder: Folder,
    },
}

/// The folder of a calibration.
#[derive(Args)]
pub struct Folder {
    /// The folder of the calibration.
    #[arg(long = "out", value_name = "FOLDER")]
    path: PathBuf,
}

/// Parses a pressure, kPa.
fn pressure_kpa(text: &str) -> Result<f64, String> {
    let kpa = text.trim().parse().ok().filter(|kpa| (0.0..=MAX_PLATEAU_KPA).contains(kpa));
    kpa.ok_or_else(|| format!("expected a pressure in kPa, 0 to {MAX_PLATEAU_KPA}"))
}

impl Calibrate {
    pub fn run(&self) -> Result<()> {
        match self {
            Self::Measure { pressures, folder, connection } => {
                folder.measure(pressures, connection)?;
                folder.evaluate()?;
                println!("store it with `plantar insole calibrate {} ...`", folder.calibration_file().display());
                println!(
                    "the insole has recorded the pressures as load of a wearer: delete it with `plantar insole erase --yes ...`"
                );
                Ok(())
            }
            Self::Evaluate { folder } => folder.evaluate(),
        }
    }
}

impl Folder {
    fn plateaus_file(&self) -> PathBuf {
        self.path.join("plateaus.json")
    }

    fn calibration_file(&self) -> PathBuf {
        self.path.join("calibration.csv")
    }

    /// Measures the plateaus that the folder does not contain yet.
    fn measure(&self, pressures_kpa: &[f64], connection: &Connection) -> Result<()> {
        let mut loaded: Vec<f64> = pressures_kpa.iter().copied().filter(|kpa| *kpa > 0.0).collect();
        loaded.sort_by(f64::total_cmp);
        loaded.dedup();
        ensure!(
            loaded.len() >= 2 && pressures_kpa.contains(&0.0),
            "--pressures: give 0 kPa, the insole without load, and at least two different pressures above 0"
        );
        std::fs::create_dir_all(&self.path).with_context(|| format!("cannot create {}", self.path.display()))?;
        let file = self.plateaus_file();
        let stored = if file.exists() { Some(Plateaus::read(&file)?) } else { None };
        let mut insole = connection.open(ReconnectPolicy::STREAM)?;
        let mut plateaus = plateaus_of(&mut insole)?;
        if let Some(stored) = stored {
            continue_with(&mut plateaus, stored, pressures_kpa, &self.path)?;
        }
        // The firmware may have another sensor law than in the previous session.
        plateaus.write(&file)?;
        let enter = lines_of_stdin();
        for (number, &pressure_kpa) in pressures_kpa.iter().enumerate().skip(plateaus.plateaus.len()) {
            let place = format!("plateau {} of {}", number + 1, pressures_kpa.len());
            let set = match pressure_kpa {
                0.0 => "remove all load from the insole".to_string(),
                kpa => format!("set {kpa} kPa, and wait until the pressure is steady"),
            };
            let plateau = loop {
                println!("{place}: {set}, then press Enter");
                wait_for_enter(&mut insole, &enter).with_context(|| {
                    format!("{place}: the plateaus before it are stored; give the same command again to continue")
                })?;
                match measure_plateau(&mut insole, pressure_kpa, &plateaus)? {
                    Ok(plateau) => break plateau,
                    Err(problem) => println!("  {problem}"),
                }
            };
            plateaus.plateaus.push(plateau);
            plateaus.write(&file)?;
        }
        Ok(())
    }

    /// Determines the calibration, prints it, and writes it with its report.
    fn evaluate(&self) -> Result<()> {
        let file = self.plateaus_file();
        let plateaus = Plateaus::read(&file)?;
        let calibration = Calibration::of(&plateaus).with_context(|| file.display().to_string())?;
        print(&plateaus, &calibration);
        write_calibration(&self.calibration_file(), &calibration.cells)?;
        let report = self.path.join("calibration.html");
        let html = report::calibration_html(&plateaus, &calibration);
        output::file(&report, |to| to.write_all(html.as_bytes()))?;
        println!("wrote {} and {}", self.calibration_file().display(), report.display());
        Ok(())
    }
}

/// No plateaus yet, of the connected insole.
fn plateaus_of(insole: &mut InsoleLink) -> Result<Plateaus> {
    let client = insole.client();
    let (setup, cells) = (client.setup()?, client.setup_cells()?);
    let serial = client.identity()?.serial;
    let hello = client.hello();
    println!(
        "{} insole {}, {} {}, {} cells",
        hello.side.name(),
        serial.as_str(),
        hello.board,
        hello.firmware,
        hello.cells
    );
    Ok(Plateaus::new(&setup, &cells, serial.as_str().into()))
}

/// Adds the plateaus of an earlier session with the same insole.
fn continue_with(present: &mut Plateaus, stored: Plateaus, pressures_kpa: &[f64], folder: &Path) -> Result<()> {
    let other = "give another folder for another calibration";
    let identity = |plateaus: &Plateaus| (plateaus.side, plateaus.serial_number.clone(), plateaus.cells.clone());
    ensure!(
        identity(present) == identity(&stored),
        "{}: the plateaus are of another insole (the {} one, serial number \"{}\"): {other}",
        folder.display(),
        stored.side.name(),
        stored.serial_number
    );
    let measured: Vec<f64> = stored.plateaus.iter().map(|plateau| plateau.pressure_kpa).collect();
    ensure!(
        pressures_kpa.starts_with(&measured),
        "{}: the measured plateaus are those of {measured:?} kPa, with which --pressures must begin: {other}",
        folder.display()
    );
    if !measured.is_empty() {
        println!("{} of {} plateaus are measured already", measured.len(), pressures_kpa.len());
    }
    present.plateaus = stored.plateaus;
    Ok(())
}

/// Reports each line of the standard input, until its end.
fn lines_of_stdin() -> Receiver<()> {
    let (sender, enter) = mpsc::channel();
    // The thread ends with the program: a line that nobody types cannot be waited for.
    thread::spawn(move || {
        for line in io::stdin().lines() {
            if line.is_err() || sender.send(()).is_err() {
                return;
            }
        }
    });
    enter
}

/// Waits for a line of the standard input. Meanwhile, the session with the insole continues.
fn wait_for_enter(insole: &mut InsoleLink, enter: &Receiver<()>) -> Result<()> {
    loop {
        match enter.try_recv() {
            Ok(()) => return Ok(()),
            Err(TryRecvError::Disconnected) => bail!("the standard input has ended"),
            Err(TryRecvError::Empty) => {}
        }
        receive(insole, |_| {})?;
    }
}

/// Waits for the next message of an insole, and passes a frame of cells to `use_cells`. Returns false, and prints it, if the link
/// was lost or opened again, so that a stream of cells has ended.
fn receive(insole: &mut InsoleLink, use_cells: impl FnOnce(&CellFrame)) -> Result<bool> {
    match insole.next_event()? {
        Event::Message(ToHost::Cells(frame)) => use_cells(&frame),
        Event::Message(_) | Event::Timeout | Event::Started(SessionStart::Connected) => {}
        Event::Started(_) => {
            println!("  connected again");
            return Ok(false);
        }
        Event::Lost(error) if error.is_link_failure() => {
            println!("  connection lost ({error}): come closer, or check the cable");
            return Ok(false);
        }
        Event::Lost(error) => return Err(error.into()),
    }
    Ok(true)
}

/// Measures a plateau, and prints the reading. The inner error states why the plateau has to be measured again.
fn measure_plateau(insole: &mut InsoleLink, pressure_kpa: f64, of: &Plateaus) -> Result<Result<Plateau, String>> {
    let lost = || Ok(Err("the connection was lost: the plateau has to be measured again".into()));
    let mut started = match start_slowly(insole.client(), HOLD_HZ) {
        Ok((started, _)) => started,
        Err(error) if error.is_link_failure() => {
            insole.recover(error)?;
            return lost();
        }
        Err(error) => return Err(error.into()),
    };
    let is_same = Plateaus::new(&started.setup, &started.cells, String::new()).cells == of.cells;
    ensure!(is_same && started.setup.side == of.side, "another insole answers: connect the first one again");
    let start = Instant::now();
    let mut frames: Vec<Vec<u16>> = Vec::new();
    while start.elapsed() < HOLD {
        let receiver = &mut started.receiver;
        let store = |frame: &CellFrame| {
            if receiver.frame(frame) {
                frames.push(receiver.codes().to_vec());
            }
        };
        if !receive(insole, store)? {
            return lost();
        }
    }
    // If the link is lost, the stream has ended already, and the error is ignored.
    let _ = insole.client().stream_cells(None);
    let plateau = Plateau::of(pressure_kpa, &frames).filter(|_| frames.len() >= LEAST_FRAMES);
    let Some(plateau) = plateau else {
        return Ok(Err(format!("only {} frames arrived: check the connection", frames.len())));
    };
    let mut curve = Curve::new();
    curve.set(&of.law);
    let calibrations: Vec<CellCalibration> = started.cells.iter().map(|cell| cell.calibration).collect();
    // The mean codes at the middle of the first third and of the last one, from which the middle one differs by half the change.
    let [first_kpa, mean_kpa, last_kpa] =
        [-0.5, 0.0, 0.5].map(|share| median_kpa(&plateau, share, &calibrations, &curve));
    let change_kpa = last_kpa - first_kpa;
    if change_kpa.abs() > (UNSTEADY * mean_kpa).max(UNSTEADY_KPA) {
        return Ok(Err(format!(
            "the reading changed by {change_kpa:+.1} kPa to {last_kpa:.1} kPa: wait until the pressure is steady"
        )));
    }
    println!(
        "  {} frames; the median of the cells reads {mean_kpa:.1} kPa with the present calibration",
        plateau.frames
    );
    Ok(Ok(plateau))
}

/// The median of the cells' pressures, kPa, at the mean codes plus this share of their change.
fn median_kpa(plateau: &Plateau, share: f32, calibrations: &[CellCalibration], curve: &Curve) -> f64 {
    let kpa = |((code, change), calibration): ((&f32, &f32), &CellCalibration)| {
        let above_zero = (code + share * change - f32::from(calibration.offset)).clamp(0.0, u16::MAX.into());
        f64::from(calibration.gain) * curve.pressure_kpa::<f64>(above_zero.round() as i32)
    };
    let mut all: Vec<f64> = plateau.codes.iter().zip(&plateau.changes).zip(calibrations).map(kpa).collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}

/// Prints the result.
fn print(plateaus: &Plateaus, calibration: &Calibration) {
    println!("{} insole, {} cells; errors in % of the pressure:", plateaus.side.name(), plateaus.cells.len());
    println!("      kPa  frames   change   mean   95 % of cells within ±   left out: mean   95 % of cells within ±");
    for check in &calibration.checks {
        println!("{}", line(check));
    }
    let mut gains: Vec<f32> = calibration.cells.iter().map(|cell| cell.gain).collect();
    gains.sort_by(f32::total_cmp);
    if let [least, .., most] = gains[..] {
        println!("gains: {least:.3} to {most:.3}, median {:.3}", gains[gains.len() / 2]);
    }
    if let Some((kpa, difference)) = calibration.hysteresis {
        println!(
            "hysteresis: at {kpa} kPa, the later reading differs by {:+.1} % from the earlier one",
            100.0 * difference
        );
    }
    if let Some(codes) = calibration.zero_change {
        println!("zero: changed by {codes:+.0} codes from the first to the last plateau without load");
    }
    for (cell, reason) in &calibration.failing {
        println!("warning: cell {cell}: {reason}; repair or replace the insole");
    }
    print_law(plateaus, calibration);
}

/// The line of a plateau in the table.
fn line(check: &Check) -> String {
    let start = format!("{:9.1}  {:6}    {:+5.1}", check.pressure_kpa, check.frames, 100.0 * check.change);
    match (check.errors, check.left_out) {
        (Some(errors), Some(left_out)) => {
            let [mean, most, left_out_mean, left_out_most] =
                [errors.mean, errors.most, left_out.mean, left_out.most].map(|share| 100.0 * share);
            format!("{start}  {mean:+5.1}  {most:22.1}  {left_out_mean:+14.1}  {left_out_most:22.1}")
        }
        _ => format!("{start}   not used: {} cells are at full scale", check.saturated),
    }
}

/// Prints the sensor law, and what to do if that of the firmware is another one.
fn print_law(plateaus: &Plateaus, calibration: &Calibration) {
    let firmware = plateaus.law.exponent;
    let Some(law) = calibration.law else {
        println!("sensor law: measure at least three plateaus with load to check the exponent, {firmware}");
        return;
    };
    let [low, high] = law.interval;
    println!(
        "sensor law: exponent {:.3} (95 % confidence interval {low:.3} to {high:.3}); {firmware} in the firmware",
        law.exponent
    );
    if law.is_needed {
        let worst =
            calibration.checks.iter().filter_map(|check| check.fitted_law_mean).fold(0.0, |a: f64, b| a.max(b.abs()));
        println!(
            "warning: the law of the firmware does not fit this sheet. Build the firmware with full_kpa {:.0} and exponent {:.3}, \
             and with another LAYOUT_ID (docs/hardware.md); then give `plantar calibrate measure` with the same pressures and \
             folder again, which measures nothing again. The mean errors are then at most {:.1} %.",
            law.full_kpa,
            law.exponent,
            100.0 * worst
        );
    }
}
