//! `plantar repeat`: how well measured and identified values repeat between trials of the same people.

pub mod output;

use crate::fit::{Search, note_unless_same_sensor, print_notes, write};
use crate::paths::{check_folders, check_written};
use crate::people;
use crate::print_note;
use crate::replay::progress;
use crate::setup::{ContactArgs, StanceArgs, rule_in_words};
use crate::tables::check_json;
use anyhow::{Context, Result, bail};
use clap::Args;
use fit::agreement::{self, repeatability};
use fit::trials::Trial;
use parameters::Participant;
use plantar::Side;
use rayon::prelude::*;
use recording::{RecordingReader, is_parquet};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use study::{Person, SETTINGS_FILE, fits};

/// Compares the values that are measured in and identified from repeated trials of the same people.
///
/// A trial is one recording of one foot. Each region of each trial is fitted to
/// all of its steps, as by `plantar fit`. The measured loads (peak force, peak
/// pressure, their time integrals, contact area and time), the mechanical
/// quantities and the eight parameters of the trials are compared: intraclass
/// correlation coefficient ICC(2,1), standard error of measurement (SEM) and
/// minimal detectable change (MDC). The two feet are compared separately.
///
/// Give a FOLDER with one folder per participant, as for `plantar cohort`, or the
/// recordings of one person. For one person there is no ICC.
///
/// If people have different numbers of trials of a foot, the first trials of
/// each, in the order of the names of the recordings, are used.
///
/// Incomplete results of fitted regions are named, with recording and region. A
/// region that was not fitted has only the measured loads of this trial and is not
/// named, and a measurement of the tissue that is out of range is a note; neither
/// changes the exit status. `plantar fit` of the recording states why a region was
/// not fitted.
///
/// Exit status: 0 if all participants and recordings can be used, 3 if some
/// cannot, or if the result of a fitted region of a trial is incomplete, 2 if the
/// arguments are wrong, and 1 after another error, for example if there are too
/// few trials to compare.
#[derive(Args)]
#[command(verbatim_doc_comment)]
pub struct Repeat {
    /// The folder of the participants' folders, or the recordings of one person.
    #[arg(required = true, value_name = "FOLDER|RECORDING")]
    inputs: Vec<PathBuf>,
    /// Write all values to this JSON file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write all values to this CSV file, with one row for each foot, variable and region.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// The zero file of one person's recordings, from `plantar zero`. In a folder of participants, each
    /// participant.toml names the zero file of its participant.
    #[arg(long, value_name = "FILE")]
    zero: Option<PathBuf>,
    #[command(flatten)]
    search: Search,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    stance: StanceArgs,
}

/// The trials of a person, and the reasons why recordings or the whole person cannot be used.
struct Trials {
    name: String,
    trials: Vec<Trial>,
    left_out: Vec<String>,
    /// The defects of the fits, with the names of person, recording and region.
    incomplete: Vec<String>,
}

impl Trials {
    /// Without trials, for this reason.
    fn none(name: &str, reason: String) -> Self {
        Self { name: name.into(), trials: Vec::new(), left_out: vec![reason], incomplete: Vec::new() }
    }

    /// The name of the person, and the trials.
    fn named(&self) -> (&str, &[Trial]) {
        (&self.name, &self.trials)
    }
}

impl Repeat {
    /// Runs the command. Returns true if all participants and recordings can be used, and no result has a defect.
    pub fn run(&self) -> Result<bool> {
        self.search.check()?;
        let rule = self.contact.rule(None)?;
        self.stance.rule()?;
        let study = self.study_folder();
        let options = self.search.tissue.iter().chain(&self.zero);
        let mut read: Vec<PathBuf> = self.inputs.iter().chain(options).cloned().collect();
        let mut left_out = Vec::new();
        if let Some(folder) = study {
            let names = people::names(folder, None)?;
            read.extend(people::files(folder, &names));
            left_out = people::unused(folder, &names, None);
        }
        check_written(&read, &[self.json.as_deref(), self.csv.as_deref()])?;
        check_folders(&[self.json.as_deref(), self.csv.as_deref()])?;
        check_json(&[self.json.as_deref()], Some("--csv"))?;
        let mut all = match study {
            Some(folder) => self.participants(folder)?,
            None => vec![self.one_person()?],
        };
        // A copy would be a trial without any error of measurement.
        let people: Vec<(&str, &[Trial])> = all.iter().map(Trials::named).collect();
        for CopiedTrial { person, trial, words } in copies(&people).into_iter().rev() {
            all[person].trials.remove(trial);
            all[person].left_out.push(words + ": give each recording once");
        }
        left_out.extend(all.iter().flat_map(|person| person.left_out.clone()));
        let people: Vec<(&str, &[Trial])> = all.iter().map(Trials::named).collect();
        let least_people = if study.is_some() { 2 } else { 1 };
        let (feet, _) = repeatability(&people, least_people);
        left_out.extend(agreement::left_out(&people, least_people));
        left_out.iter().for_each(|reason| print_note(&format!("left out: {reason}")));
        let incomplete: Vec<String> = all.iter().flat_map(|person| person.incomplete.clone()).collect();
        incomplete.iter().for_each(|defect| print_note(&format!("incomplete: {defect}")));
        if feet.is_empty() {
            match study {
                Some(folder) => bail!(
                    "{}: two or more people with two or more usable recordings of the same foot are needed to compare people: \
                     record further trials, or give the recordings of one person as files",
                    folder.display()
                ),
                None => bail!("two or more usable recordings of the same foot are needed: record another trial"),
            }
        }
        output::print(&feet);
        println!("Contact: {}.", rule_in_words(&rule));
        if let Some(path) = &self.csv {
            output::write_csv(path, &feet)?;
            println!("wrote {}", path.display());
        }
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&output::to_json(&feet, &left_out, &incomplete))? + "\n";
            write(path, text.as_bytes())?;
            println!("wrote {}", path.display());
        }
        Ok(left_out.is_empty() && incomplete.is_empty())
    }

    /// The folder of a study, if one was given: a single folder that is not a recording in parts. Such a recording is a folder
    /// that contains only files, and at least one Parquet file among them that is not hidden.
    fn study_folder(&self) -> Option<&Path> {
        let [folder] = &self.inputs[..] else { return None };
        let entries: Vec<PathBuf> = folder.read_dir().ok()?.flatten().map(|entry| entry.path()).collect();
        let is_recording = entries.iter().any(|path| is_parquet(path)) && entries.iter().all(|path| path.is_file());
        (!is_recording).then_some(folder)
    }

    /// The trials of all participants of a study.
    fn participants(&self, study: &Path) -> Result<Vec<Trials>> {
        if let Some(path) = &self.zero {
            bail!(
                "--zero {} is for the recordings of one person: name the zero file of each participant in participant.toml",
                path.display()
            );
        }
        let names = people::names(study, None)?;
        let bar = progress(names.len() as u64, "participants");
        let all = names.par_iter().with_max_len(1).map(|name| {
            let folder = study.join(name);
            let trials = match people::open(&folder, &self.search, &self.contact, &self.stance) {
                Ok((_, recordings)) if recordings.is_empty() => {
                    Trials::none(name, format!("{}: no recordings (*.parquet)", folder.display()))
                }
                Ok((person, recordings)) => trials_of(name, &person, &recordings),
                Err(error) => Trials::none(name, format!("{error:#}")),
            };
            bar.inc(1);
            trials
        });
        let all = all.collect();
        bar.finish_and_clear();
        Ok(all)
    }

    /// The trials of one person, given as recordings.
    fn one_person(&self) -> Result<Trials> {
        if let [folder] = &self.inputs[..]
            && folder.is_dir()
        {
            let remedy = "give the recordings as files, or the folder of the study";
            if folder.join(SETTINGS_FILE).exists() {
                bail!("{} is the folder of a participant, not of a study: {remedy}", folder.display());
            }
            let error = || format!("{} is not one recording in parts: {remedy}", folder.display());
            RecordingReader::open(folder).with_context(error)?;
        }
        let mut known = BTreeSet::new();
        for path in &self.inputs {
            let file = path.canonicalize().with_context(|| format!("cannot read {}", path.display()))?;
            if !known.insert(file) {
                bail!("{} is given twice: give each recording once", path.display());
            }
        }
        let settings = Participant { zero: self.zero.clone(), ..Participant::default() };
        let (contact, stance) = (self.contact.rule(None)?, self.stance.rule()?);
        let person = Person::new(settings, &self.search.of_study(), contact, stance, &|path| fs::read(path))?;
        print_notes(&person.notes);
        Ok(trials_of("the person", &person, &self.inputs))
    }
}

/// Prints a note on stderr for each foot of which the trials of a person are of different sensors. A recording that could not be
/// opened is left out later, with the reason.
fn note_different_sensors(recordings: &[PathBuf], opened: &[recording::Result<RecordingReader>]) {
    let heads = recordings.iter().zip(opened).filter_map(|(path, reader)| Some((path, &reader.as_ref().ok()?.head)));
    let heads: Vec<_> = heads.map(|(path, head)| (path.display().to_string(), head)).collect();
    for side in [Side::Left, Side::Right] {
        let of_side = heads.iter().filter(|(_, head)| head.side == side);
        note_unless_same_sensor(of_side.map(|(name, head)| (name.as_str(), &head.layout)), "trials", "compare");
    }
}

/// Fits each recording of a person.
fn trials_of(name: &str, person: &Person, recordings: &[PathBuf]) -> Trials {
    let opened: Vec<_> = recordings.iter().map(|path| RecordingReader::open(path)).collect();
    note_different_sensors(recordings, &opened);
    let results: Vec<Result<_>> =
        recordings.par_iter().zip(opened).map(|(path, reader)| fits::trial(person, reader?, path)).collect();
    let mut of_person = Trials { name: name.into(), trials: Vec::new(), left_out: Vec::new(), incomplete: Vec::new() };
    for result in results {
        match result {
            Ok((trial, defects)) => {
                let named = |defect: String| format!("{name}, {}, {defect}", trial.name);
                of_person.incomplete.extend(defects.into_iter().map(named));
                of_person.trials.push(trial);
            }
            Err(error) => of_person.left_out.push(format!("{error:#}")),
        }
    }
    of_person
}

/// A trial that is a copy of an earlier trial of the same or of another person.
pub struct CopiedTrial {
    /// Index of the person.
    person: usize,
    /// Index of the trial among those of the person.
    trial: usize,
    /// A sentence that names both recordings.
    pub words: String,
}

/// The copies among the trials of people, in their order.
pub fn copies(people: &[(&str, &[Trial])]) -> Vec<CopiedTrial> {
    let (mut originals, mut copies) = (Vec::<(&str, &Trial)>::new(), Vec::new());
    for (person, &(name, trials)) in people.iter().enumerate() {
        for (index, trial) in trials.iter().enumerate() {
            match originals.iter().find(|(_, earlier)| trial.is_copy_of(earlier)) {
                Some((other, earlier)) => {
                    let words = format!("{name}, {}: the same recording as {other}, {}", trial.name, earlier.name);
                    copies.push(CopiedTrial { person, trial: index, words });
                }
                None => originals.push((name, trial)),
            }
        }
    }
    copies
}
