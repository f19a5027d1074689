//! `plantar cohort`: many participants, each step fitted separately.

mod summary;
mod table;

use crate::fit::Search;
use crate::replay::progress;
use crate::setup::{self, ContactArgs, ZeroArgs, rule_in_words};
use crate::table::Row;
use anyhow::{Context, Result, bail};
use clap::Args;
use fit::steps::isolate;
use fit::{NotFitted, Options, Step, fit_step};
use parameters::{InsoleSize, Participant};
use plantar::Region;
use plantar::pipeline::contact::ContactRule;
use rayon::prelude::*;
use recording::Recording;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;
use summary::Means;
use table::Origin;

/// Fits each step of many participants separately, as the paper does, and computes means by insole size.
///
/// FOLDER contains one folder per participant with that person's recordings
/// (*.parquet): any number of trials, both feet. A participant's folder can also
/// contain a file participant.toml. All of its lines are optional, and its paths
/// are relative to the participant's folder:
///
///   size = 41                    # European shoe size; replaces --size
///   mass_kg = 70.5               # is copied to a column of the table
///   zero = "zero.toml"           # baseline file, from `plantar zero`
///   thickness = "thickness.toml" # tissue thickness; replaces --thickness
///
/// The table is a folder with one file TABLE/participant=NAME/steps.parquet per
/// participant. It has one row per step and region, and DuckDB, Spark and Dask
/// can read it. After an interruption or a change, run the same command again:
/// it processes only participants whose files or options changed, or of whom a
/// recording could not be used before. A new version of the program processes
/// all participants again.
///
/// Exit status: 0 if all participants and recordings were used, 3 if some could
/// not be used, 1 if no step of any participant was found.
#[derive(Args)]
#[command(verbatim_doc_comment)]
pub struct Cohort {
    /// The participants' folders.
    #[arg(value_name = "FOLDER")]
    participants: PathBuf,
    /// The folder of the table to write.
    #[arg(long, value_name = "TABLE")]
    out: PathBuf,
    /// Also write the means and standard deviations over the participants of each insole size to this CSV file.
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
    #[command(flatten)]
    search: Search,
    #[command(flatten)]
    contact: ContactArgs,
}

/// A processed participant.
struct Processed {
    means: Means,
    /// The rows in the table were already up to date.
    is_cached: bool,
    /// The participant's file states the insole size.
    has_size: bool,
}

impl Cohort {
    /// Runs the command. Returns true if all participants and recordings were used.
    pub fn run(&self) -> Result<bool> {
        let start = Instant::now();
        // Checks the options once, because invalid options would cause an error for every participant.
        self.search.options(0)?;
        self.contact.rule(None)?;
        let names = self.names()?;
        fs::create_dir_all(&self.out).with_context(|| format!("cannot write {}", self.out.display()))?;
        let bar = progress(names.len() as u64, "participants");
        let results = names.par_iter().with_max_len(1).map(|name| {
            let mut left_out = Vec::new();
            let path = table::path(&self.out, name);
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

        self.note_others(&names)?;
        let left_out = left_out.concat();
        left_out.iter().for_each(|reason| eprintln!("left out: {reason}"));
        let done: Vec<Processed> = done.into_iter().flatten().collect();
        if done.is_empty() {
            bail!("{}: no step of any participant was found, for the reasons above", self.participants.display());
        }
        self.report(done, start)?;
        Ok(left_out.is_empty())
    }

    /// The names of the participants' folders.
    fn names(&self) -> Result<Vec<String>> {
        let folder = &self.participants;
        let error = || format!("cannot read {}: it must be a folder with one folder per participant", folder.display());
        let table = self.out.canonicalize().ok();
        let mut names = Vec::new();
        for entry in fs::read_dir(folder).with_context(error)? {
            let path = entry.with_context(error)?.path();
            let name = path.file_name().unwrap_or_default().to_str();
            let name = name.with_context(|| format!("{}: a participant's name must be UTF-8", path.display()))?;
            if path.is_dir() && !name.starts_with('.') && path.canonicalize().ok() != table {
                names.push(name.to_string());
            }
        }
        if names.is_empty() {
            bail!("{}: no participant: it must contain one folder per participant, with recordings", folder.display());
        }
        names.sort();
        Ok(names)
    }

    /// Prints a note on stderr for each participant in the table that has no folder.
    fn note_others(&self, names: &[String]) -> Result<()> {
        let known: Vec<_> = names.iter().map(|name| table::path(&self.out, name)).collect();
        for entry in fs::read_dir(&self.out)? {
            let path = entry?.path().join("steps.parquet");
            if path.exists() && !known.contains(&path) {
                eprintln!(
                    "note: the table has {}, but this participant has no folder: remove the file unless you need it",
                    path.display()
                );
            }
        }
        Ok(())
    }

    /// Writes the participant's rows to the file `path` of the table, unless that file is up to date. For each recording that
    /// cannot be used, appends the reason to `left_out`.
    fn participant(&self, name: &str, path: &Path, left_out: &mut Vec<String>) -> Result<Processed> {
        let person = self.person(&self.participants.join(name))?;
        let has_size = person.settings.size.is_some();
        let done = |rows: &[_], is_cached| Processed { means: Means::of(rows), is_cached, has_size };
        let made_from = person.made_from()?;
        // A file that cannot be read counts as out of date and is replaced.
        if let Ok((before, rows)) = table::read(path)
            && before == made_from
        {
            return Ok(done(&rows, true));
        }
        let mut rows = Vec::new();
        for recording in &person.recordings {
            match person.rows(recording) {
                Ok(more) => rows.extend(more),
                Err(error) => left_out.push(format!("{error:#}")),
            }
        }
        if rows.is_empty() {
            let count = person.recordings.len();
            bail!("{}: {count} recordings (*.parquet), {}", person.folder.display(), NotFitted::NoSteps);
        }
        // Without a description of its inputs the file is out of date, so the next run tries the unusable recordings again.
        let made_from = if left_out.is_empty() { made_from } else { String::new() };
        crate::table::write(path, Some((table::KEY, &made_from)), &rows)?;
        Ok(done(&table::read(path)?.1, false))
    }

    /// Reads a participant's folder.
    fn person(&self, folder: &Path) -> Result<Person> {
        let file = folder.join("participant.toml");
        let settings = if file.exists() { Participant::read(&file)? } else { Participant::default() };
        let mut search = self.search.clone();
        search.size = settings.size.unwrap_or(search.size);
        search.thickness = settings.thickness.clone().or(search.thickness);
        let mut recordings = Vec::new();
        for entry in fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
            recordings.push(entry?.path());
        }
        recordings.retain(|path| path.extension().is_some_and(|ending| ending == "parquet"));
        recordings.sort();
        Ok(Person {
            folder: folder.into(),
            recordings,
            size: search.size,
            options: search.options(0)?,
            contact: self.contact.rule(None)?,
            settings,
        })
    }

    /// Prints the means and the counts of the run, and writes the summary. `start` is the time at which the run began.
    fn report(&self, done: Vec<Processed>, start: Instant) -> Result<()> {
        let count = |is: fn(&Processed) -> bool| done.iter().filter(|done| is(done)).count();
        let (cached, unknown) = (count(|done| done.is_cached), count(|done| !done.has_size));
        let steps: usize = done.iter().filter(|done| !done.is_cached).map(|done| done.means.steps).sum();
        let means: Vec<Means> = done.into_iter().map(|done| done.means).collect();
        summary::print(&means);
        println!("Contact: {}.", rule_in_words(&self.contact.rule(None)?));
        if unknown > 0 {
            println!(
                "{unknown} participants without a size in participant.toml are counted as size {}.",
                self.search.size
            );
        }
        if let Some(path) = &self.summary {
            summary::write(path, &means)?;
            println!("wrote {}", path.display());
        }
        println!(
            "wrote {}: {steps} steps of {} participants in {:.1} s; {cached} participants were already up to date",
            self.out.display(),
            means.len() - cached,
            start.elapsed().as_secs_f64()
        );
        Ok(())
    }
}

/// A participant and the options for this person.
struct Person {
    folder: PathBuf,
    recordings: Vec<PathBuf>,
    /// The values of participant.toml, or none without this file.
    settings: Participant,
    /// The size in participant.toml, or else the option --size.
    size: InsoleSize,
    options: Options,
    contact: ContactRule,
}

impl Person {
    /// Describes everything that determines the rows: the files with their sizes and times, the options and the program's
    /// version.
    fn made_from(&self) -> Result<String> {
        let Self { settings, size, options, contact, .. } = self;
        let mut text = format!("{} {size} {settings:?} {options:?} {contact:?}", env!("PLANTAR_VERSION"));
        for path in self.recordings.iter().chain(&settings.zero) {
            let file = path.metadata().with_context(|| format!("cannot read {}", path.display()))?;
            let name = path.file_name().unwrap_or_default();
            text += &format!("\n{name:?} {} {:?}", file.len(), file.modified()?);
        }
        Ok(text)
    }

    /// The rows of a recording: each region of each step, fitted separately.
    fn rows(&self, path: &Path) -> Result<Vec<Row>> {
        let recording = Recording::read(path)?;
        let steps =
            self.steps(&recording).with_context(|| format!("{}: the recording cannot be evaluated", path.display()))?;
        let origin = Origin {
            size: self.size,
            mass_kg: self.settings.mass_kg,
            recording: &path.file_name().unwrap_or_default().to_string_lossy(),
            contact: self.contact,
            options: self.options,
        };
        let regions = steps.iter().flat_map(|step| Region::ALL.map(|region| (step, region)));
        let row = |(step, region): (&Step, Region)| {
            let fit = fit_step(step, region as usize, &self.options).map(|(fit, _)| fit);
            table::row(&origin, step, region, fit)
        };
        Ok(regions.map(row).collect())
    }

    /// The complete steps of a recording.
    fn steps(&self, recording: &Recording) -> Result<Vec<Step>> {
        let mut insole = setup::insole(recording, self.contact)?;
        ZeroArgs { zero: self.settings.zero.clone() }.apply(&mut insole)?;
        let (steps, _) = isolate(recording, &insole, 0, &mut |_| ())?;
        Ok(steps)
    }
}
