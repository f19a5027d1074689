//! `plantar identify`: a guided session that identifies the tissue parameters of the wearer of one insole or two, and sends them
//! to the insoles.

mod foot;
mod screen;

use crate::carrier::{Connection, Ports};
use crate::fit::{Fit, Search, live};
use crate::params;
use crate::setup::rule_in_words;
use crate::summary;
use crate::zero::GRAVITY_M_S2;
use ::fit::Study;
use anyhow::{Result, anyhow, bail, ensure};
use clap::Args;
use client::ReconnectPolicy;
#[cfg(feature = "ble")]
use client::ble::Selector;
use foot::{Foot, StandingResult, Trial};
use parameters::Parameters;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::Step;
use plantar::{Region, Side};
use screen::{Input, Progress, Screen, has_keyboard};
use std::path::{Path, PathBuf};
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Identifies the tissue parameters of a person who wears one insole or two, in a guided session.
///
/// Nobody should take part with an open wound on a foot, with a cast, or against the advice not to walk. A rail or a companion
/// helps. If stdin is a terminal, Enter begins the session and each standing trial; q ends the session at any time.
///
/// The session has these parts: a standing trial determines the zero of the cells; a walk provides the steps; the parameters are
/// identified and sent to the insoles, with their contact rule; further steps verify that the insoles' model is as accurate as
/// the identification predicted. The folder then contains recordings, parameters and reports. A session that was interrupted
/// continues when the command is given again with the same folder.
///
/// Exit status: 0 if all regions were identified with complete results, as by `plantar fit`, and none was found to be worse than
/// predicted; 3 if the session was completed otherwise; 2 if the arguments are wrong; 1 if it was not completed.
#[derive(Args)]
pub struct Identify {
    #[command(flatten)]
    ports: Ports,
    /// Connect over Bluetooth to the insole of this foot, left or right, or with this address. Give the option once for each
    /// foot.
    #[cfg(feature = "ble")]
    #[arg(long, value_name = "FOOT")]
    ble: Vec<Selector>,
    /// The folder of the session.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Number of good steps of each foot: those that the identification can use.
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u16).range(5..=500))]
    steps: u16,
    /// Number of steps of each foot that verify the result.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=100))]
    verify: u16,
    /// Count only the fraction sqrt(p / KPA), at most 1, of the area of a cell in contact, where p is the cell's pressure; 0
    /// counts whole cells. The insoles are set to this contact rule.
    #[arg(long, value_name = "KPA", default_value_t = ContactRule::COVERED.full_kpa)]
    contact_full: f32,
    /// The wearer's mass, kg. With both feet, the force of the insoles is scaled to the body weight.
    #[arg(long, value_name = "KG", value_parser = mass)]
    mass: Option<f64>,
    /// Omit the standing trial: use the zeros that are stored on the insoles.
    #[arg(long, conflicts_with = "mass")]
    no_standing: bool,
    #[command(flatten)]
    search: Search,
}

/// What the wearer must know before the session.
const BEFORE: &str = "Do not take part with an open wound on a foot, with a cast, or if you were advised not to walk. A rail or a \
                      companion at your side helps. You may stop at any time.";
/// The phases of the standing trial: instruction and duration, s. The times are those of the paper (section 2.4: 5, 10
/// and 5 s), with one second more for each change of posture at the beginning or end of the phase.
const STANDING: [(&str, u64); 3] = [
    ("Sit down and lift both feet off the floor", 6),
    ("Stand up and stand still", 12),
    ("Sit down and lift both feet again", 6),
];
/// Largest factor by which forces are scaled to the body weight; its reciprocal is the smallest one. A factor beyond these limits
/// indicates a wrong calibration or mass.
const MAX_FORCE_SCALE: f64 = 2.0;
/// A region is verified if the model's error is at most this multiple of the predicted error plus [`TOLERANCE_PERCENT`].
const TOLERANCE_FACTOR: f64 = 1.3;
/// Percentage points that are added to the product with [`TOLERANCE_FACTOR`], for small predicted errors: if an error of 1 % is
/// predicted, the error of a few steps can differ from 1 % by more than a third.
const TOLERANCE_PERCENT: f64 = 1.0;

fn mass(text: &str) -> Result<f64, String> {
    let kg = text.parse().ok().filter(|kg| (10.0..=300.0).contains(kg));
    kg.ok_or_else(|| "expected the person's mass in kg, 10 to 300".into())
}

impl Identify {
    pub fn run(&self) -> Result<bool> {
        // Options that cannot be used are refused before the wearer stands and walks.
        let options = self.search.options(0)?;
        ensure!(
            options.filter == ::fit::Filter::Direct,
            "the steps that verify the parameters are evaluated without smoothing and without the filter of live frames: \
             use --filter direct"
        );
        let mut feet = self.connect()?;
        let rule = ContactRule { full_kpa: self.contact_full, ..ContactRule::COUNTED };
        ensure!(rule.is_valid(), "--contact-full {}: expected 0, or 10 to 2000 kPa", self.contact_full);
        // The stream files of earlier sessions are read before the insoles are changed, and before the screen opens, which would
        // hide the notes about them.
        let earlier = feet.iter_mut().map(|foot| anyhow::Ok((foot.side, earlier_good_steps(foot, &rule)?)));
        let earlier = earlier.collect::<Result<Vec<_>>>()?;
        feet.iter_mut().try_for_each(|foot| foot.set_rule(rule))?;
        if has_keyboard() {
            wait_for_key(&mut feet, format!("{BEFORE} Press Enter to begin."))?;
        } else {
            println!("{BEFORE}");
        }
        if !self.no_standing {
            self.stand(&mut feet)?;
        }
        self.walk(&mut feet, &earlier)?;
        let mut is_good = true;
        let mut studies = Vec::new();
        for foot in &mut feet {
            let study = self.identify(foot)?;
            is_good &= study.is_complete();
            studies.push(study);
        }
        let verified = self.verify(&mut feet)?;
        for ((foot, steps), study) in feet.iter().zip(&verified).zip(&studies) {
            is_good &= print_verification(foot, steps, study);
        }
        println!("\nThe session is complete. Recordings, parameters and reports are in {}.", self.out.display());
        Ok(is_good)
    }

    fn connections(&self) -> Vec<Connection> {
        let serial = self.ports.serial.iter().map(|port| Connection::serial(port, self.ports.baud));
        let wired = serial.chain(self.ports.tcp.iter().map(|address| Connection::tcp(address)));
        #[cfg(feature = "ble")]
        return wired.chain(self.ble.iter().map(Connection::ble)).collect();
        #[cfg(not(feature = "ble"))]
        return wired.collect();
    }

    /// Connects to the insoles, and creates the folders.
    fn connect(&self) -> Result<Vec<Foot>> {
        let connections = self.connections();
        ensure!((1..=2).contains(&connections.len()), "give one or two of --serial, --tcp or --ble, one for each foot");
        let open = |connection: &Connection| Foot::new(connection.open(ReconnectPolicy::STREAM)?, &self.out);
        let feet = connections.iter().map(open).collect::<Result<Vec<_>>>()?;
        if let [one, other] = &feet[..] {
            ensure!(
                one.side != other.side,
                "both insoles are for the {} foot: connect one for each foot",
                one.side.name()
            );
        }
        Ok(feet)
    }

    /// Performs the standing trial, and repeats it until it succeeds. The wearer begins each trial with a key, if there are keys:
    /// getting up can make a person dizzy, who must be able to rest. If the folder has calibrations of all feet from an earlier
    /// trial, sends these instead.
    fn stand(&self, feet: &mut [Foot]) -> Result<()> {
        let earlier = feet.iter().map(|foot| earlier_calibration(&foot.calibration_file()));
        if let Some(calibrations) = earlier.collect::<Result<Option<Vec<_>>>>()? {
            return send_calibrations(feet, &calibrations);
        }
        let duration = Duration::from_secs(STANDING.iter().map(|(_, s)| s).sum());
        let (mut prefix, mut before) = ("", "");
        loop {
            if has_keyboard() {
                let trial = format!(
                    "{before}This trial takes {} s: sit with both feet lifted, stand for {} s, and sit with both feet lifted. \
                     Press Enter to start it.",
                    duration.as_secs(),
                    STANDING[1].1
                );
                wait_for_key(feet, trial)?;
            }
            let instruction = |elapsed: Duration| {
                let mut rest_s = elapsed.as_secs();
                for (text, s) in STANDING {
                    if rest_s < s {
                        return format!("{prefix}{text}: {} s", s - rest_s);
                    }
                    rest_s -= s;
                }
                "The trial is complete: wait a moment".into()
            };
            let is_lost = AtomicBool::new(false);
            let trials = run_part(feet, instruction, |foot, stop| foot.stand(stop, duration, &is_lost))?;
            let evaluate = |(foot, trial): (&Foot, &Option<Trial>)| match trial {
                Some(trial) => foot.evaluate(trial),
                None => Ok(Err(anyhow!("the connection was lost: the trial has to be repeated"))),
            };
            let results = feet.iter().zip(&trials).map(evaluate).collect::<Result<Vec<_>>>()?;
            for (foot, result) in feet.iter().zip(&results) {
                foot.remark(result.as_ref().err().map_or(String::new(), |error| format!("{error:#}")));
            }
            match results.into_iter().collect::<Result<Vec<_>>>() {
                Ok(results) => return self.calibrate(feet, results),
                Err(_) => {
                    prefix = "The trial failed; it begins again. ";
                    before = "The trial failed. Rest as long as you like. ";
                }
            }
        }
    }

    /// Stores and sends the calibrations. With both feet and a known mass, the gains are scaled to the body weight.
    fn calibrate(&self, feet: &mut [Foot], mut results: Vec<StandingResult>) -> Result<()> {
        let total_n: f64 = results.iter().map(|result| result.standing_n).sum();
        match self.mass.map(|kg| kg * GRAVITY_M_S2) {
            Some(weight_n) if feet.len() == 2 => {
                let scale = weight_n / total_n;
                ensure!(
                    (1.0 / MAX_FORCE_SCALE..=MAX_FORCE_SCALE).contains(&scale),
                    "the insoles measure {total_n:.0} N of a body weight of {weight_n:.0} N: check --mass, and calibrate the sensors"
                );
                println!("standing: {total_n:.0} N of {weight_n:.0} N; forces are scaled by {scale:.3}");
                for cell in results.iter_mut().flat_map(|result| &mut result.cells) {
                    cell.gain *= scale as f32;
                }
                ensure!(
                    results.iter().flat_map(|result| &result.cells).all(CellCalibration::is_valid),
                    "with the scale {scale:.3}, the gain of a cell is outside of 0.1 to 10: check --mass, and calibrate the \
                     sensors"
                );
            }
            Some(_) => println!(
                "standing: {total_n:.0} N on this foot; forces are scaled to the body weight only with both feet"
            ),
            None => {
                println!("standing: {total_n:.0} N; with --mass and both feet, forces are scaled to the body weight")
            }
        }
        // All are stored before the first one is sent. If one cannot be sent, the next session sends all of them, without
        // another trial, which would scale the forces again for the insoles that have already received their calibration.
        feet.iter().zip(&results).try_for_each(|(foot, result)| foot.store_calibration(&result.cells))?;
        let calibrations: Vec<_> = results.into_iter().map(|result| result.cells).collect();
        send_calibrations(feet, &calibrations)
    }

    /// Records the walk until each foot has enough good steps, together with those of earlier sessions; `earlier` has their
    /// numbers.
    fn walk(&self, feet: &mut [Foot], earlier: &[(Side, usize)]) -> Result<()> {
        let needed = usize::from(self.steps);
        let instruction = |_| {
            "Walk at your usual speed; only complete steps count. Turn and rest where you like: the steps so far count."
                .to_string()
        };
        run_part(feet, instruction, |foot, stop| {
            let earlier = earlier.iter().find(|(side, _)| *side == foot.side).map_or(0, |(_, steps)| *steps);
            if earlier < needed { foot.walk(stop, earlier, needed) } else { Ok(()) }
        })?;
        Ok(())
    }

    /// Identifies the parameters of a foot, writes them and their report, and sends them to the insole.
    fn identify(&self, foot: &mut Foot) -> Result<Study> {
        println!("\n{} foot", foot.side.name());
        let fit = Fit::of_streams(foot.stream_files()?, folder_name(&self.out), &foot.folder, self.search.clone());
        let study = fit.study()?;
        fit.write(&study)?;
        let parameters = Parameters::read(&foot.folder.join("params.toml"))?;
        send_parameters(foot, &parameters)?;
        println!(
            "the {} insole uses and stores these parameters, with the rule {}",
            foot.side.name(),
            rule_in_words(&study.contact)
        );
        Ok(study)
    }

    /// Receives further steps of each foot.
    fn verify(&self, feet: &mut [Foot]) -> Result<Vec<Vec<Step>>> {
        let instruction = |_| {
            "Walk on: these steps verify the result. Turn and rest where you like: the steps so far count.".to_string()
        };
        run_part(feet, instruction, |foot, stop| foot.verify(stop, self.verify.into()))
    }
}

/// Performs a part of the session with all feet at the same time: calls `work` for each foot in a thread of its own, and shows
/// the text that `instruction` returns for the time since the start of the part. `work` ends early once the flag that it
/// receives is set.
///
/// # Errors
/// The first error of a foot, or that the user has interrupted the session.
fn run_part<T: Send>(
    feet: &mut [Foot],
    instruction: impl Fn(Duration) -> String,
    work: impl Fn(&mut Foot, &AtomicBool) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    run_part_with_key(feet, instruction, work, || {})
}

/// Shows the instruction until the user presses the key that begins the next part. Meanwhile, the insoles remain connected.
fn wait_for_key(feet: &mut [Foot], instruction: String) -> Result<()> {
    let begins = AtomicBool::new(false);
    let work = |foot: &mut Foot, stop: &AtomicBool| foot.wait(stop, &begins);
    run_part_with_key(feet, |_| instruction.clone(), work, || begins.store(true, Ordering::Relaxed))?;
    Ok(())
}

/// As [`run_part`]; calls `begin` if the user presses the key that begins a part.
fn run_part_with_key<T: Send>(
    feet: &mut [Foot],
    instruction: impl Fn(Duration) -> String,
    work: impl Fn(&mut Foot, &AtomicBool) -> Result<T> + Sync,
    begin: impl Fn(),
) -> Result<Vec<T>> {
    let shown: Vec<_> = feet.iter().map(|foot| foot.progress.clone()).collect();
    let (stop, start) = (AtomicBool::new(false), Instant::now());
    let mut screen = Screen::open()?;
    let outcomes = at_the_same_time(feet, &stop, work, || {
        let progress = shown.iter().map(|foot| foot.lock().unwrap_or_else(PoisonError::into_inner).clone());
        let input = screen.show(&instruction(start.elapsed()), &progress.collect::<Vec<Progress>>())?;
        if input == Input::Begin {
            begin();
        }
        Ok(input == Input::End)
    });
    drop(screen);
    let outcomes = outcomes?;
    if stop.load(Ordering::Relaxed) {
        bail!("interrupted; everything so far is stored: give the same command again to continue");
    }
    Ok(outcomes)
}

/// Calls `work` for each foot in a thread of its own, and meanwhile repeats `show`, which returns true if the user ends the
/// session. `stop` is then set, and also after an error of a foot: otherwise, the wearer would complete the other foot's part in
/// vain.
///
/// # Errors
/// The error of `show`, or else the first error of a foot.
fn at_the_same_time<F: Send, T: Send>(
    feet: &mut [F],
    stop: &AtomicBool,
    work: impl Fn(&mut F, &AtomicBool) -> Result<T> + Sync,
    mut show: impl FnMut() -> Result<bool>,
) -> Result<Vec<T>> {
    let end = || stop.store(true, Ordering::Relaxed);
    // The feet also end if `show` panics because the output was closed; otherwise the scope would wait for them.
    let _end = EndIfPanicking(stop);
    let work = |foot| work(foot, stop).inspect_err(|_| end());
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> = feet.iter_mut().map(|foot| scope.spawn(move || work(foot))).collect();
        let mut shown = Ok(());
        while !threads.iter().all(|thread| thread.is_finished()) {
            match show() {
                Ok(false) => {}
                Ok(true) => end(),
                Err(error) => {
                    end();
                    shown = Err(error);
                }
            }
        }
        let joined =
            threads.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        let outcomes: Result<Vec<T>> = joined.collect();
        shown.and(outcomes)
    })
}

/// Sets the flag if the thread panics.
struct EndIfPanicking<'s>(&'s AtomicBool);

impl Drop for EndIfPanicking<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// The name of an existing folder, for display. A path such as `..` does not contain the name.
fn folder_name(path: &Path) -> String {
    let path = if path.file_name().is_some() { Ok(path.into()) } else { path.canonicalize() };
    path.ok()
        .as_deref()
        .and_then(Path::file_name)
        .map_or("the wearer".into(), |name| name.to_string_lossy().into_owned())
}

/// Number of good steps in the stream files of earlier sessions. Prints a note on stderr about each file that cannot be read.
/// Neither such a file nor one without live frames and steps, from a session that was interrupted at once, is used later.
///
/// # Errors
/// If earlier steps have another contact rule than `rule`, that of this session.
fn earlier_good_steps(foot: &mut Foot, rule: &ContactRule) -> Result<usize> {
    let mut good_steps = 0;
    for path in foot.stream_files()? {
        let sources = live::read_stream(&path).unwrap_or_else(|error| {
            eprintln!("note: {error:#}; the steps in this file are not used");
            Vec::new()
        });
        if sources.is_empty() {
            foot.unusable_files.push(path);
        }
        ensure_same_rule(&sources, rule)?;
        good_steps += sources.iter().map(|source| source.steps.collected(0).0.len()).sum::<usize>();
    }
    Ok(good_steps)
}

/// Refuses steps of an earlier session with another contact rule than `rule`, that of this session: the steps of both cannot be
/// fitted together, which the wearer should know before the walk.
fn ensure_same_rule(sources: &[live::LiveSource], rule: &ContactRule) -> Result<()> {
    for source in sources {
        if let Some(earlier) = source.contact_rule()?.filter(|earlier| earlier != rule) {
            bail!(
                "{} has the contact rule {}, but this session has {}: continue with the same --contact-full as before, or name \
                 another folder",
                source.name,
                rule_in_words(&earlier),
                rule_in_words(rule)
            );
        }
    }
    Ok(())
}

/// Sends each foot's calibration to its insole.
fn send_calibrations(feet: &mut [Foot], calibrations: &[Vec<CellCalibration>]) -> Result<()> {
    feet.iter_mut().zip(calibrations).try_for_each(|(foot, cells)| foot.send_calibration(cells))
}

/// Sends the parameters of a foot to its insole. If the link was lost, for example during the search for these parameters, waits
/// until it is opened again.
fn send_parameters(foot: &mut Foot, parameters: &Parameters) -> Result<()> {
    let Err(error) = params::send(&mut foot.link, parameters) else { return Ok(()) };
    foot.recover(error)?;
    let instruction =
        |_| "The parameters could not be sent yet: they will be once the insole is connected again.".into();
    run_part(std::slice::from_mut(foot), instruction, |foot, stop| foot.send_parameters(stop, parameters))?;
    Ok(())
}

/// The calibration of an earlier part of the session; `None` without one.
fn earlier_calibration(path: &Path) -> Result<Option<Vec<CellCalibration>>> {
    if path.exists() { crate::insole::read_calibration(path).map(Some) } else { Ok(None) }
}

/// Prints the error of the model on the insole, and the error that the fit predicted for new steps. Returns true if no region
/// has a larger error than predicted, within [`TOLERANCE_FACTOR`] and [`TOLERANCE_PERCENT`].
fn print_verification(foot: &Foot, steps: &[Step], study: &Study) -> bool {
    println!("\n{} foot: {} further steps, evaluated by the insole", foot.side.name(), steps.len());
    let mut table = summary::table();
    table.set_header(["region", "predicted error %", "error %", ""]);
    let mut is_good = true;
    for (i, (region, fit)) in Region::ALL.iter().zip(&study.fits).enumerate() {
        let predicted = fit.as_ref().ok().and_then(|fit| fit.quality.predicted);
        let found = summary::comparable_error_percent(steps, i);
        let is_within = match (predicted, found) {
            (Some(predicted), Some(found)) => found <= TOLERANCE_FACTOR * predicted * 100.0 + TOLERANCE_PERCENT,
            _ => true,
        };
        is_good &= is_within;
        let percent = |percent: Option<f64>| percent.map_or("-".into(), |percent| format!("{percent:.1}"));
        let remark = match (predicted, found, is_within) {
            (None, ..) if fit.is_ok() => "identified from one step, which predicts no error",
            (None, ..) => "not identified",
            (_, None, _) => "hardly loaded, or saturated",
            (.., true) => "as predicted",
            (.., false) => "WORSE than predicted",
        };
        table.add_row([
            region.name().into(),
            percent(predicted.map(|share| share * 100.0)),
            percent(found),
            remark.into(),
        ]);
    }
    summary::align(&mut table);
    println!("{table}");
    if !is_good {
        println!(
            "If most regions are worse, the wearer walked differently, or the insole has moved in the shoe: repeat the session."
        );
    }
    is_good
}

#[cfg(test)]
mod tests {
    use super::{at_the_same_time, ensure_same_rule, folder_name};
    use crate::fit::live::LiveSource;
    use ::fit::live::LiveSteps;
    use anyhow::anyhow;
    use plantar::pipeline::contact::ContactRule;
    use plantar::protocol::Live;
    use std::path::Path;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn an_error_of_a_foot_ends_the_part_of_the_other_foot() {
        for failing in 0..2 {
            let mut feet = [0, 1];
            let work = |foot: &mut usize, stop: &AtomicBool| {
                if *foot == failing {
                    return Err(anyhow!("the disk is full"));
                }
                while !stop.load(Ordering::Relaxed) {
                    std::thread::yield_now();
                }
                Ok(())
            };
            let outcome = at_the_same_time(&mut feet, &AtomicBool::new(false), work, || Ok(false));
            assert_eq!(outcome.expect_err("a foot has failed").to_string(), "the disk is full");
        }
    }

    #[test]
    fn earlier_steps_with_another_contact_rule_are_refused() {
        let mut steps = LiveSteps::new();
        let step = testkit::step(1);
        steps.frame(&Live { t_us: step.start_us, ..testkit::live(0) });
        steps.step(&step);
        let source = LiveSource {
            name: "walk-000.plantar, left".into(),
            origin: "An earlier session.".into(),
            side: step.side,
            steps,
        };
        let sources = [source];
        assert!(ensure_same_rule(&sources, &step.contact_rule).is_ok());
        let error = ensure_same_rule(&sources, &ContactRule::COUNTED).expect_err("another rule").to_string();
        assert!(error.starts_with("walk-000.plantar") && error.contains("--contact-full"), "{error}");
    }

    #[test]
    fn a_participant_has_the_name_of_the_folder_for_every_form_of_its_path() {
        let folder = tempfile::tempdir().expect("a folder");
        let ann = folder.path().join("ann");
        std::fs::create_dir_all(ann.join("left")).expect("written");
        for path in [&ann, &ann.join("."), &ann.join("left/..")] {
            assert_eq!(folder_name(path), "ann", "{}", path.display());
        }
        let here = std::env::current_dir().expect("a folder");
        assert_eq!(folder_name(Path::new(".")), folder_name(&here));
        assert_eq!(folder_name(Path::new("/")), "the wearer");
    }
}
