//! `plantar cohort`: many participants, each step fitted separately.

mod summary;
mod table;

use crate::fit::{Search, write};
use crate::paths::{check_folders, check_written};
use crate::people;
use crate::print_note;
use crate::repeat::{copies, output};
use crate::replay::progress;
use crate::setup::{ContactArgs, StanceArgs, rule_in_words};
use crate::summary::counted;
use anyhow::{Context, Result, bail};
use clap::Args;
use fit::agreement::repeatability;
use fit::{NotFitted, cohort};
use plantar::Region;
use rayon::prelude::*;
use recording::RecordingReader;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;
use study::table::{STEPS_FILE, partition};
use study::{Person, fits};

/// Fits each step of many participants separately, as the paper does, and computes means by insole size, and the repeatability.
///
/// FOLDER contains one folder per participant with that person's recordings
/// (*.parquet, files or folders with parts): any number of trials, both feet. A
/// participant's folder can also contain a file participant.toml. All of its
/// lines are optional, and its paths are relative to the participant's folder:
///
///   size = 41                    # European shoe size; replaces --size
///   age_years = 24.5             # age, sex, mass, height: columns of the table
///   sex = "female"               # female, male or other
///   mass_kg = 70.5
///   height_cm = 168
///   zero = "zero.toml"           # zero file, from `plantar zero`
///   tissue = "tissue.toml"       # measurements of the tissue; replaces --tissue
///
/// The earlier name of `tissue` in this file, `thickness`, is accepted, too.
///
/// The table is a folder with one file TABLE/participant=NAME/steps.parquet per
/// participant. It has one row per step and region, and DuckDB, Spark and Dask
/// can read it. After an interruption or a change, run the same command again:
/// it processes only participants whose files or options changed, or of whom a
/// recording could not be used before. A new version of the program processes
/// all participants again.
///
/// If two or more participants have two or more recordings of the same foot, the
/// repeatability between these recordings is printed, too. Here the values of a
/// recording are means of the fits of its steps; `plantar repeat` compares fits
/// to all steps of a recording together.
///
/// Exit status: 0 if all participants and recordings were used, 3 if some could
/// not be used or have incomplete results, for example because measurements of
/// the tissue contradict each other (column `defects` of the table), 2 if the
/// arguments are wrong, 1 otherwise, for example if no step of any participant
/// was found.
#[derive(Args)]
#[command(verbatim_doc_comment)]
pub struct Cohort {
    /// The folder that contains the participants' folders.
    #[arg(value_name = "FOLDER")]
    participants: PathBuf,
    /// The folder of the table to write.
    #[arg(long, value_name = "TABLE")]
    out: PathBuf,
    /// Also write the means and standard deviations over the participants of each pair of insole sizes, such as 37-38, to this
    /// CSV file.
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
    /// Write a report with pictures to this HTML file, which can be read without a network.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the pictures of the report to this PNG file.
    #[cfg(feature = "png")]
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    #[command(flatten)]
    search: Search,
    #[command(flatten)]
    contact: ContactArgs,
    #[command(flatten)]
    stance: StanceArgs,
}

/// A processed participant.
struct Processed {
    person: cohort::Person,
    /// True if the rows in the table were already up to date.
    is_cached: bool,
    /// The defects of the fits, with the names of participant, recording and region.
    incomplete: Vec<String>,
}

impl Cohort {
    /// Runs the command. Returns true if all participants and recordings were used, and no result has a defect.
    pub fn run(&self) -> Result<bool> {
        let start = Instant::now();
        self.search.check()?;
        self.contact.rule(None)?;
        self.stance.rule()?;
        let names = people::names(&self.participants, Some(&self.out))?;
        let mut read = people::files(&self.participants, &names);
        read.push(self.participants.clone());
        read.extend(self.search.tissue.clone());
        let written = [
            Some(self.out.as_path()),
            self.summary.as_deref(),
            self.report.as_deref(),
            #[cfg(feature = "png")]
            self.png.as_deref(),
        ];
        check_written(&read, &written)?;
        fs::create_dir_all(&self.out).with_context(|| format!("cannot write {}", self.out.display()))?;
        // Some of the files may be in the folder that was just created.
        check_folders(&written)?;
        let bar = progress(names.len() as u64, "participants");
        let results = names.par_iter().with_max_len(1).map(|name| {
            let mut left_out = Vec::new();
            let path = self.file_of(name);
            let done = self.participant(name, &path, &mut left_out).map_err(|error| {
                left_out.push(format!("{error:#}"));
                // Otherwise a file of an earlier run would remain in the table, without being part of the summary.
                let _ = fs::remove_file(path);
            });
            bar.inc(1);
            (done.ok(), left_out)
        });
        let (done, left_out): (Vec<_>, Vec<_>) = results.collect();
        bar.finish_and_clear();

        self.note_files_without_participant(&names)?;
        let mut left_out = left_out.concat();
        left_out.extend(people::unused(&self.participants, &names, Some(&self.out)));
        left_out.iter().for_each(|reason| print_note(&format!("left out: {reason}")));
        let done: Vec<Processed> = done.into_iter().flatten().collect();
        if done.is_empty() {
            bail!("{}: no step of any participant was found, for the reasons above", self.participants.display());
        }
        let incomplete: Vec<String> = done.iter().flat_map(|done| done.incomplete.clone()).collect();
        incomplete.iter().for_each(|defect| print_note(&format!("incomplete: {defect}")));
        self.report(done, &incomplete, start)?;
        Ok(left_out.is_empty() && incomplete.is_empty())
    }

    /// The path of a participant's file in the table.
    fn file_of(&self, participant: &str) -> PathBuf {
        self.out.join(partition(participant)).join(STEPS_FILE)
    }

    /// Prints a note on stderr for each file in the table whose participant has no folder. `names` are the participants with
    /// folders.
    fn note_files_without_participant(&self, names: &[String]) -> Result<()> {
        let known: Vec<_> = names.iter().map(|name| self.file_of(name)).collect();
        let error = || format!("cannot read {}", self.out.display());
        for entry in fs::read_dir(&self.out).with_context(error)? {
            let path = entry.with_context(error)?.path().join(STEPS_FILE);
            if path.exists() && !known.contains(&path) {
                print_note(&format!(
                    "note: the table has {}, but this participant has no folder: remove the file unless you need it",
                    path.display()
                ));
            }
        }
        Ok(())
    }

    /// Writes the participant's rows to the file `path` of the table, unless that file is up to date. For each recording that
    /// cannot be used, appends the reason to `left_out`.
    fn participant(&self, name: &str, path: &Path, left_out: &mut Vec<String>) -> Result<Processed> {
        let folder = self.participants.join(name);
        let (person, recordings) = people::open(&folder, &self.search, &self.contact, &self.stance)?;
        let processed = |rows: &[_], is_cached| Processed {
            person: cohort::Person {
                name: name.into(),
                size_eur: person.size.eur(),
                settings: person.settings.clone(),
                steps: rows.len() / Region::ALL.len(),
                trials: table::trials(rows),
            },
            is_cached,
            incomplete: table::defects(rows).iter().map(|defect| format!("{name}, {defect}")).collect(),
        };
        let made_from = made_from(&person, &recordings)?;
        // A file that cannot be read counts as out of date and is replaced.
        if let Ok((before, rows)) = table::read(path)
            && before == made_from
        {
            return Ok(processed(&rows, true));
        }
        let mut rows = Vec::new();
        for recording in &recordings {
            let reader = RecordingReader::open(recording).map_err(Into::into);
            match reader.and_then(|reader| fits::rows(&person, reader, recording)) {
                Ok(new) if new.is_empty() => left_out.push(format!("{}: {}", recording.display(), NotFitted::NoSteps)),
                Ok(new) => rows.extend(new),
                Err(error) => left_out.push(format!("{error:#}")),
            }
        }
        if rows.is_empty() {
            let remedy = match recordings.len() {
                0 => "put a recording of a walk of several steps into the folder",
                _ => "the lines above state the reasons",
            };
            bail!(
                "{}: {} (*.parquet), none with a whole step: {remedy}",
                folder.display(),
                counted(recordings.len(), "recording")
            );
        }
        // Without a description of its inputs the file is out of date, so the next run tries the unusable recordings again.
        let made_from = if left_out.is_empty() { made_from } else { String::new() };
        study::table::write(path, Some((table::MADE_FROM_KEY, &made_from)), &rows)?;
        Ok(processed(&table::read(path)?.1, false))
    }

    /// Prints the means and the counts of the run, and writes the summary, the report and its pictures. `incomplete` are the
    /// defects of the fits, and `start` is the time at which the run began.
    fn report(&self, done: Vec<Processed>, incomplete: &[String], start: Instant) -> Result<()> {
        let count = |is: fn(&Processed) -> bool| done.iter().filter(|done| is(done)).count();
        let (cached, of_unknown_size) =
            (count(|done| done.is_cached), count(|done| done.person.settings.size.is_none()));
        let steps: usize = done.iter().filter(|done| !done.is_cached).map(|done| done.person.steps).sum();
        let people: Vec<cohort::Person> = done.into_iter().map(|done| done.person).collect();
        summary::print_participants(&people);
        summary::print(&people);
        let trials: Vec<_> = people.iter().map(|person| (person.name.as_str(), &person.trials[..])).collect();
        for copy in copies(&trials) {
            print_note(&format!("note: {}, so its steps count twice: remove one of them", copy.words));
        }
        let (feet, _) = repeatability(&trials, 2);
        if !feet.is_empty() {
            println!("The values of a recording are the means of the fits of its steps.");
            output::print(&feet);
        }
        println!("Contact: {}.", rule_in_words(&self.contact.rule(None)?));
        if of_unknown_size > 0 {
            println!(
                "Participants without a size in participant.toml, counted as size {}: {of_unknown_size}.",
                self.search.size.unwrap_or_default()
            );
        }
        if let Some(path) = &self.summary {
            summary::write(path, &people)?;
            println!("wrote {}", path.display());
        }
        let cohort = report::Cohort { people: &people, feet: &feet, incomplete, contact: self.contact.rule(None)? };
        if let Some(path) = &self.report {
            write(path, report::cohort_html(&cohort).as_bytes())?;
            println!("wrote {}", path.display());
        }
        #[cfg(feature = "png")]
        if let Some(path) = &self.png {
            write(path, &report::cohort_png(&cohort)?)?;
            println!("wrote {}", path.display());
        }
        println!(
            "wrote {}: {} of {} in {:.1} s; participants already up to date: {cached}",
            self.out.display(),
            counted(steps, "step"),
            counted(people.len() - cached, "participant"),
            start.elapsed().as_secs_f64()
        );
        Ok(())
    }
}

/// Describes everything that determines a participant's rows: the files of the recordings with their sizes and times, the
/// settings and options, and the program's version.
fn made_from(person: &Person, recordings: &[PathBuf]) -> Result<String> {
    let mut text = format!("{} {}", env!("PLANTAR_VERSION"), person.description());
    for recording in recordings {
        text += &format!("\n{:?}", recording.file_name().unwrap_or_default());
        // A change of a part does not change the time of its folder.
        for path in recording::files(recording)? {
            let file = path.metadata().with_context(|| format!("cannot read {}", path.display()))?;
            text += &format!(" {:?} {} {:?}", path.file_name().unwrap_or_default(), file.len(), file.modified()?);
        }
    }
    Ok(text)
}
