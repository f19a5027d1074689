//! `plantar calibrate`: the gain of each cell and the sensor law, from known pressures that act on the whole insole.

use crate::carrier::{AnyClient, Connection, InsoleLink, link_problem};
use crate::cells::start_slowly;
use crate::insole::write_calibration;
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Subcommand};
use client::{Error, Event, ReconnectPolicy, SessionStart, StartedCells};
use fit::calibration::{Calibration, Check, Failure, Verdict, quantile};
use plantar::pipeline::calibrate::Curve;
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::protocol::{CellFrame, ToHost};
use recording::{MAX_PLATEAU_KPA, MAX_PLATEAUS, MIN_PLATEAU_KPA, Plateau, Plateaus, is_plateau_kpa, output};
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The file with the plateaus in the folder of a calibration.
pub const PLATEAUS_FILE: &str = "plateaus.json";
/// Time of the measurement of a plateau.
const HOLD: Duration = Duration::from_secs(3);
/// Frames of cells per second during a measurement, unless the connection is too slow for this rate.
const HOLD_HZ: f64 = 20.0;
/// Smallest number of frames of a plateau.
const LEAST_FRAMES: usize = 10;
/// A plateau is measured again if the median reading changes by more than this part of it and by more than [`UNSTEADY_KPA`].
const UNSTEADY: f64 = 0.01;
/// See [`UNSTEADY`].
const UNSTEADY_KPA: f64 = 0.3;
/// A warning is printed if the median reading without load exceeds this, kPa.
const UNLOADED_KPA: f64 = 5.0;
/// A warning is printed if the mean error at a plateau exceeds this part of the pressure.
const LARGE_ERROR: f64 = 0.2;
/// A warning is printed if the zero changes by more than this part of the code at the lowest pressure.
const LARGE_ZERO_CHANGE: f64 = 0.02;
/// A warning is printed if the median gain, or its reciprocal, exceeds this.
const LARGE_GAIN: f64 = 2.0;

#[derive(Subcommand)]
pub enum Calibrate {
    /// Measure the codes of all cells at known pressures, and determine the calibration.
    ///
    /// The command asks for each pressure: set it, wait until it is steady, and press Enter, or type the reading of the gauge in
    /// kPa if it differs; `r` repeats the plateau before. Begin and end with 0, the insole without load, and apply the pressures
    /// first in increasing and then in decreasing order: the difference is the hysteresis of the sheet. Each plateau is stored
    /// in FOLDER/plateaus.json at once; after an interruption, the same command continues with the next one. The last plateau is
    /// followed by what `plantar calibrate evaluate` does.
    ///
    /// The insole records the pressures as load of a wearer. `plantar insole erase` deletes this, but also parameters, bonds and
    /// all steps on the insole: receive and save those of a wearer before.
    Measure {
        /// The pressures in the order of measurement, kPa above that of the atmosphere, separated by commas: at least one of 0
        /// and two different ones above 0.
        #[arg(long, value_name = "KPA", value_delimiter = ',', required = true, value_parser = pressure_kpa)]
        pressures: Vec<f64>,
        /// A remark that is stored, such as gauge and temperature [default: unchanged].
        #[arg(long, value_name = "TEXT")]
        note: Option<String>,
        #[command(flatten)]
        folder: Folder,
        #[command(flatten)]
        connection: Connection,
    },
    /// Determine the calibration from plateaus that were measured.
    ///
    /// Writes FOLDER/calibration.csv, which `plantar insole calibrate` stores on the insole, and FOLDER/calibration.html, a
    /// report. The gains are those for the sensor law of the insole's firmware. If the plateaus show another law, the command
    /// prints it, with exit status 3; it has to be built into the firmware. Afterwards, `plantar calibrate measure` with the
    /// same pressures and folder determines the gains for the new law, without another measurement. Cells that fail are named,
    /// also with exit status 3.
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
    let kpa = text.trim().parse().ok().filter(|kpa| is_plateau_kpa(*kpa));
    kpa.ok_or_else(|| format!("expected a pressure in kPa: 0, or {MIN_PLATEAU_KPA} to {MAX_PLATEAU_KPA}"))
}

impl Calibrate {
    /// Returns whether the calibration is complete: no cell fails, and the law of the firmware is not wrong.
    pub fn run(&self) -> Result<bool> {
        match self {
            Self::Measure { pressures, note, folder, connection } => {
                folder.measure(pressures, note.as_deref(), connection)?;
                folder.evaluate()
            }
            Self::Evaluate { folder } => folder.evaluate(),
        }
    }
}

/// What the person answers when a pressure is asked for.
enum Answer {
    /// The pressure is set; the reading of the gauge, kPa.
    Set(f64),
    /// The plateau before has to be repeated.
    Repeat,
}

impl Folder {
    fn plateaus_file(&self) -> PathBuf {
        self.path.join(PLATEAUS_FILE)
    }

    /// Measures the plateaus that the folder does not contain yet.
    fn measure(&self, nominal_kpa: &[f64], note: Option<&str>, connection: &Connection) -> Result<()> {
        let mut loaded: Vec<f64> = nominal_kpa.iter().copied().filter(|kpa| *kpa > 0.0).collect();
        loaded.sort_by(f64::total_cmp);
        loaded.dedup();
        ensure!(
            loaded.len() >= 2 && nominal_kpa.contains(&0.0) && nominal_kpa.len() <= MAX_PLATEAUS,
            "--pressures: give 0 kPa, the insole without load, and at least two different pressures above 0; at most \
             {MAX_PLATEAUS} in all"
        );
        std::fs::create_dir_all(&self.path).with_context(|| format!("cannot create {}", self.path.display()))?;
        let file = self.plateaus_file();
        let stored = if file.exists() { Some(Plateaus::read(&file)?) } else { None };
        let mut insole = connection.open(ReconnectPolicy::STREAM)?;
        let mut plateaus = plateaus_of(insole.client())?;
        println!(
            "{} insole {}, firmware {}, {} cells",
            plateaus.side.name(),
            plateaus.serial_number,
            plateaus.firmware,
            plateaus.cells.len()
        );
        ensure!(
            !plateaus.serial_number.is_empty(),
            "the insole has no serial number, so its calibration could be confused with that of another one: name it with `plantar \
             insole name --serial-number`"
        );
        if let Some(stored) = stored {
            continue_with(&mut plateaus, stored, nominal_kpa, &self.path)?;
        }
        if let Some(note) = note {
            plateaus.note = note.into();
        }
        // The firmware may have another sensor law than in the previous session.
        plateaus.write(&file)?;
        let lines = lines_of_stdin();
        while let Some(&nominal_kpa_now) = nominal_kpa.get(plateaus.plateaus.len()) {
            let place = format!("plateau {} of {}", plateaus.plateaus.len() + 1, nominal_kpa.len());
            // A line from before the question is not an answer to it: the pressure is still the former one.
            while lines.try_recv().is_ok() {}
            match nominal_kpa_now {
                0.0 => println!("{place}: remove all load from the insole, then press Enter"),
                kpa => println!(
                    "{place}: set {kpa} kPa, wait until it is steady, then press Enter, or type the gauge's reading"
                ),
            }
            let answer = answer(&mut insole, &lines, nominal_kpa_now).with_context(|| {
                format!("{place}: the plateaus before it are stored; give the same command again, in a terminal, to continue")
            })?;
            match answer {
                Answer::Repeat => {
                    plateaus.plateaus.pop();
                }
                Answer::Set(pressure_kpa) => {
                    match measure_plateau(&mut insole, nominal_kpa_now, pressure_kpa, &plateaus)? {
                        Ok(plateau) => plateaus.plateaus.push(plateau),
                        Err(problem) => println!("  {problem}"),
                    }
                }
            }
            plateaus.write(&file)?;
        }
        Ok(())
    }

    /// Determines the calibration, prints it, and writes it with its report. Returns whether it is complete.
    fn evaluate(&self) -> Result<bool> {
        let file = self.plateaus_file();
        let plateaus = Plateaus::read(&file)?;
        let calibration = Calibration::of(&plateaus).with_context(|| file.display().to_string())?;
        print(&plateaus, &calibration);
        let [csv, html] = ["calibration.csv", "calibration.html"].map(|name| self.path.join(name));
        write_calibration(&csv, &calibration.cells)?;
        let page = report::calibration_html(&plateaus, &calibration);
        output::file(&html, |to| to.write_all(page.as_bytes()))?;
        println!("wrote {} and {}", csv.display(), html.display());
        let is_law_wrong = calibration.law.is_some_and(|law| law.verdict == Verdict::DoesNotFit);
        if !is_law_wrong {
            println!("store it with `plantar insole calibrate {} ...`", csv.display());
        }
        Ok(!is_law_wrong && calibration.failures.iter().all(Option::is_none))
    }
}

/// No plateaus yet, of the connected insole.
pub fn plateaus_of(client: &mut AnyClient) -> Result<Plateaus, Error> {
    let (setup, cells) = (client.setup()?, client.setup_cells()?);
    plateaus_with(client, &setup, &cells)
}

/// No plateaus yet, of the connected insole, which has this configuration.
fn plateaus_with(client: &mut AnyClient, setup: &Setup, cells: &[SetupCell]) -> Result<Plateaus, Error> {
    let serial = client.identity()?.serial;
    Ok(Plateaus::new(setup, cells, serial.as_str(), &client.hello().firmware))
}

/// Adds the plateaus of an earlier session with the same insole.
fn continue_with(present: &mut Plateaus, stored: Plateaus, nominal_kpa: &[f64], folder: &Path) -> Result<()> {
    let other = "give another folder for another calibration";
    ensure!(
        present.is_of_same_insole(&stored),
        "{}: the plateaus are those of the {} insole {}: {other}",
        folder.display(),
        stored.side.name(),
        stored.serial_number
    );
    let measured: Vec<f64> = stored.plateaus.iter().map(|plateau| plateau.nominal_kpa).collect();
    ensure!(
        nominal_kpa.starts_with(&measured),
        "{}: the measured plateaus are those of {measured:?} kPa, with which --pressures must begin: {other}",
        folder.display()
    );
    if !measured.is_empty() {
        println!("{} of {} plateaus are measured already", measured.len(), nominal_kpa.len());
    }
    (present.plateaus, present.note) = (stored.plateaus, stored.note);
    Ok(())
}

/// Reports each line of the standard input, until its end.
fn lines_of_stdin() -> Receiver<String> {
    let (sender, lines) = mpsc::channel();
    // The thread ends with the program: it cannot be waited for, because nobody may type another line.
    thread::spawn(move || {
        for line in io::stdin().lines() {
            if line.map_or(true, |line| sender.send(line).is_err()) {
                return;
            }
        }
    });
    lines
}

/// Waits for the person's answer. Meanwhile, the session with the insole continues.
fn answer(insole: &mut InsoleLink, lines: &Receiver<String>, nominal_kpa: f64) -> Result<Answer> {
    loop {
        match lines.try_recv() {
            Ok(line) if line.trim().is_empty() => return Ok(Answer::Set(nominal_kpa)),
            Ok(line) if line.trim() == "r" => return Ok(Answer::Repeat),
            Ok(line) => match pressure_kpa(&line) {
                Ok(kpa) if (kpa == 0.0) == (nominal_kpa == 0.0) => return Ok(Answer::Set(kpa)),
                _ => println!("  press Enter, type the gauge's reading in kPa, or type r to repeat the plateau before"),
            },
            Err(TryRecvError::Disconnected) => bail!("the standard input has ended"),
            Err(TryRecvError::Empty) => {}
        }
        if let Some(problem) = receive(insole, |_| {})? {
            println!("  {problem}");
        }
    }
}

/// Waits for the next message of an insole, and passes a frame of cells to `use_cells`. Returns the reason if the link was lost
/// or opened again, so that a stream of cells has ended.
fn receive(insole: &mut InsoleLink, use_cells: impl FnOnce(&CellFrame)) -> Result<Option<String>> {
    match insole.next_event()? {
        Event::Message(ToHost::Cells(frame)) => use_cells(&frame),
        Event::Message(_) | Event::Timeout | Event::Started(SessionStart::Connected) => {}
        Event::Started(_) => return Ok(Some("connected again".into())),
        Event::Lost(error) if error.is_link_failure() => return Ok(Some(link_problem(&error))),
        Event::Lost(error) => return Err(error.into()),
    }
    Ok(None)
}

/// Measures a plateau, and prints the reading. The inner error states why the plateau has to be measured again.
fn measure_plateau(
    insole: &mut InsoleLink,
    nominal_kpa: f64,
    pressure_kpa: f64,
    of: &Plateaus,
) -> Result<Result<Plateau, String>> {
    println!("  measuring for {} s: hold the pressure", HOLD.as_secs());
    let start = |client: &mut AnyClient| {
        let (started, _) = start_slowly(client, HOLD_HZ)?;
        Ok((plateaus_with(client, &started.setup, &started.cells)?, started))
    };
    let (present, mut started): (Plateaus, StartedCells) = match start(insole.client()) {
        Ok(started) => started,
        Err(error) => {
            let problem = link_problem(&error);
            insole.recover(error)?;
            return Ok(Err(problem));
        }
    };
    ensure!(present.is_of_same_insole(of), "another insole answers: connect the insole {} again", of.serial_number);
    let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let start = Instant::now();
    let mut frames: Vec<Vec<u16>> = Vec::new();
    while start.elapsed() < HOLD {
        let receiver = &mut started.receiver;
        let store = |frame: &CellFrame| {
            if receiver.frame(frame) {
                frames.push(receiver.codes().to_vec());
            }
        };
        if let Some(problem) = receive(insole, store)? {
            return Ok(Err(problem));
        }
    }
    // If the link is lost, the stream has ended already, and the error is ignored.
    let _ = insole.client().stream_cells(None);
    let plateau = Plateau::of(nominal_kpa, pressure_kpa, unix_s, &frames).filter(|_| frames.len() >= LEAST_FRAMES);
    let Some(plateau) = plateau else {
        return Ok(Err(format!("only {} frames arrived: check the connection", frames.len())));
    };
    // The mean codes at the middle of the first third and of the last one, from which that of all frames differs by half of the
    // change.
    let mut curve = Curve::new();
    curve.set(&of.law);
    let [first_kpa, mean_kpa, last_kpa] =
        [-0.5, 0.0, 0.5].map(|part| median_kpa(&plateau, part, &started.cells, of, &curve));
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
    if nominal_kpa == 0.0 && mean_kpa > UNLOADED_KPA {
        println!(
            "  warning: if this is a pressure that remains in the device, release it, and repeat the plateau with r"
        );
    }
    Ok(Ok(plateau))
}

/// The median of the cells' pressures, kPa, at the mean codes plus this part of their change, with the present gains. The zero is
/// that of the first plateau without load, or else the present one.
fn median_kpa(plateau: &Plateau, part: f32, cells: &[SetupCell], of: &Plateaus, curve: &Curve) -> f64 {
    let zero = of.plateaus.iter().find(|plateau| plateau.nominal_kpa == 0.0);
    let kpa = |(i, cell): (usize, &SetupCell)| {
        let zero = zero.map_or(f32::from(cell.offset), |plateau| plateau.codes[i]);
        let above_zero = (plateau.codes[i] + part * plateau.changes[i] - zero).clamp(0.0, u16::MAX.into());
        f64::from(cell.gain) * curve.pressure_kpa::<f64>(above_zero.round() as i32)
    };
    let mut all: Vec<f64> = cells.iter().enumerate().map(kpa).collect();
    quantile(&mut all, 0.5).unwrap_or(0.0)
}

/// Prints the result.
fn print(plateaus: &Plateaus, calibration: &Calibration) {
    let cells = plateaus.cells.len();
    println!("{} insole {}, {cells} cells; in % of the pressure:", plateaus.side.name(), plateaus.serial_number);
    println!(
        "      kPa  frames   change   mean error   95 % of cells within ±   left out: mean   95 % of cells within ±"
    );
    for check in &calibration.checks {
        println!("{}", line(check));
    }
    if let [least, .., most] = calibration.gains[..] {
        println!("gains: {least:.3} to {most:.3}, median {:.3}", calibration.median_gain());
    }
    if let Some(hysteresis) = calibration.hysteresis {
        let percent = 100.0 * hysteresis.difference;
        println!(
            "hysteresis: at {} kPa, the reading after higher pressures differs by {percent:+.1} %",
            hysteresis.nominal_kpa
        );
    }
    if let Some(change) = calibration.zero_change {
        println!(
            "zero: changed by {:+.0} codes from the first to the last plateau without load, {:+.1} % of the codes at the lowest \
             pressure",
            change.codes,
            100.0 * change.share
        );
    }
    for warning in warnings(plateaus, calibration) {
        println!("warning: {warning}");
    }
    print_law(plateaus, calibration);
}

/// The line of a plateau in the table.
fn line(check: &Check) -> String {
    let start = format!("{:9.1}  {:6}", check.pressure_kpa, check.frames);
    let Some(result) = check.result else {
        return format!("{start}   not used: {} cells are at full scale", check.saturated);
    };
    let [change, mean, most, left_out_mean, left_out_most] =
        [result.change, result.errors.mean, result.errors.most, result.left_out.mean, result.left_out.most]
            .map(|fraction| 100.0 * fraction);
    format!("{start}    {change:+5.1}  {mean:+11.1}  {most:22.1}  {left_out_mean:+14.1}  {left_out_most:22.1}")
}

/// Warnings about cells that fail and about implausible results.
fn warnings(plateaus: &Plateaus, calibration: &Calibration) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut failing: Vec<(Failure, String)> = Vec::new();
    for (cell, failure) in calibration.failures.iter().enumerate() {
        let Some(failure) = failure else { continue };
        let place = plateaus.cells[cell].row_column;
        let name = format!("{cell} (row {}, column {})", place / 16, place % 16);
        match failing.iter_mut().find(|(other, _)| other == failure) {
            // Writing to a String does not fail.
            Some((_, names)) => drop(write!(names, ", {name}")),
            None => failing.push((*failure, name)),
        }
    }
    warnings.extend(
        failing.into_iter().map(|(failure, names)| format!("{failure}: cell {names}; the median gain is used")),
    );
    let gain = calibration.median_gain();
    if !(1.0 / LARGE_GAIN..=LARGE_GAIN).contains(&gain) {
        warnings.push(format!(
            "the pressures are {gain:.2} times those of the built-in law: are they in kPa (1 psi is 6.895 kPa, 1 bar 100 kPa, 1 N/cm2 \
             10 kPa, 100 mmHg 13.3 kPa)?"
        ));
    }
    for check in &calibration.checks {
        let error = check.result.map_or(0.0, |result| result.errors.mean);
        if error.abs() > LARGE_ERROR {
            let percent = 100.0 * error;
            warnings.push(format!(
                "at {} kPa, the cells differ by {percent:+.0} %: was this the pressure?",
                check.pressure_kpa
            ));
        }
    }
    if calibration.zero_change.is_some_and(|change| change.share.abs() > LARGE_ZERO_CHANGE) {
        warnings.push(
            "the zero has changed: wait longer after the first loads of a sheet, and check that no pressure remains"
                .into(),
        );
    }
    warnings
}

/// Prints the sensor law, and what to do if that of the firmware is another one.
fn print_law(plateaus: &Plateaus, calibration: &Calibration) {
    let firmware = plateaus.law.exponent;
    let Some(law) = calibration.law else {
        println!("sensor law: three different pressures that can be used are needed to check the exponent, {firmware}");
        return;
    };
    let [low, high] = law.interval;
    println!(
        "sensor law: exponent {:.3} (95 % confidence interval {low:.3} to {high:.3}); {firmware} in the firmware",
        law.sensor.exponent
    );
    let [worst_firmware, worst] = [law.worst_firmware, law.worst].map(|fraction| 100.0 * fraction);
    match law.verdict {
        Verdict::Fits => {
            println!("the law of the firmware fits this sheet, with mean errors of at most {worst_firmware:.1} %")
        }
        Verdict::Undetermined => println!(
            "note: mean errors reach {worst_firmware:.1} %, but the plateaus scatter too much to determine another law: repeat the \
             measurement with more pressures"
        ),
        Verdict::DoesNotFit => println!(
            "warning: the law of the firmware does not fit, with mean errors of up to {worst_firmware:.1} %; with the exponent {:.3}, \
             they are at most {worst:.1} %. First check the zero of the gauge: an error of {:+.1} kPa would have a similar effect. \
             Otherwise build the firmware with full_kpa {:.0} and exponent {:.3}, and with another LAYOUT_ID (docs/hardware.md); then \
             give `plantar calibrate measure` with the same pressures and folder again, which measures nothing again.",
            law.sensor.exponent, law.gauge_offset_kpa, law.sensor.full_kpa, law.sensor.exponent
        ),
    }
}
