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
/// The folder contains one folder per participant with that person's recordings
/// (*.parquet): any number of trials, both feet. A file participant.toml beside
/// them is optional, as are all of its lines; paths are relative to it:
///
///   size = 41                    # European shoe size, instead of --size
///   mass_kg = 70.5               # a column of the table
///   zero = "zero.toml"           # made by `plantar zero`
///   thickness = "thickness.toml" # instead of --thickness
///
/// The table is a folder with TABLE/participant=NAME/steps.parquet, one row per
/// step and region, which DuckDB, Spark and Dask can read. Run the same command
/// again after an interruption or a change: a participant is processed again
/// only where files, options or the program changed, or where something had
/// been left out.
///
/// Exit status: 0 where nothing had to be left out, 3 where something had to,
/// 1 where no step of any participant was found.
#[derive(Args)]
#[command(verbatim_doc_comment)]
pub struct Cohort {
    /// The participants' folders.
    #[arg(value_name = "FOLDER")]
    participants: PathBuf,
    /// The table to write, a folder.
    #[arg(long, value_name = "TABLE")]
    out: PathBuf,
    /// Write means and standard deviations over the participants of each size to this file: .csv.
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
    /// The rows were in the table already and are up to date.
    is_cached: bool,
    /// The insole size is known.
    has_size: bool,
}

impl Cohort {
    /// Runs the command. Returns true where nothing had to be left out.
    pub fn run(&self) -> Result<bool> {
        let start = Instant::now();
        // Invalid options are reported once, because they would fail for every participant.
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
                // A file of an earlier run would be in the table, but not in the summary.
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

    /// Prints a note on stderr where the table has participants that are not in the folder.
    fn note_others(&self, names: &[String]) -> Result<()> {
        let known: Vec<_> = names.iter().map(|name| table::path(&self.out, name)).collect();
        for entry in fs::read_dir(&self.out)? {
            let path = entry?.path().join("steps.parquet");
            if path.exists() && !known.contains(&path) {
                eprintln!(
                    "note: {} belongs to no participant in the folder: remove it unless you need it",
                    path.display()
                );
            }
        }
        Ok(())
    }

    /// Adds a participant to the table, unless the table is up to date. Adds the reasons for unusable recordings to `left_out`.
    fn participant(&self, name: &str, path: &Path, left_out: &mut Vec<String>) -> Result<Processed> {
        let person = self.person(&self.participants.join(name))?;
        let has_size = person.known.size.is_some();
        let done = |rows: &[_], is_cached| Processed { means: Means::of(rows), is_cached, has_size };
        let made_from = person.made_from()?;
        // A file that cannot be read is written again.
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
        // Recordings that were left out are tried again in the next run.
        let made_from = if left_out.is_empty() { made_from } else { String::new() };
        crate::table::write(path, Some((table::KEY, &made_from)), &rows)?;
        Ok(done(&table::read(path)?.1, false))
    }

    fn person(&self, folder: &Path) -> Result<Person> {
        let file = folder.join("participant.toml");
        let known = if file.exists() { Participant::read(&file)? } else { Participant::default() };
        let mut search = self.search.clone();
        search.size = known.size.unwrap_or(search.size);
        search.thickness = known.thickness.clone().or(search.thickness);
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
            known,
        })
    }

    fn report(&self, done: Vec<Processed>, start: Instant) -> Result<()> {
        let count = |is: fn(&Processed) -> bool| done.iter().filter(|done| is(done)).count();
        let (cached, unknown) = (count(|done| done.is_cached), count(|done| !done.has_size));
        let steps: usize = done.iter().filter(|done| !done.is_cached).map(|done| done.means.steps).sum();
        let means: Vec<Means> = done.into_iter().map(|done| done.means).collect();
        summary::print(&means);
        println!("Contact: {}.", rule_in_words(&self.contact.rule(None)?));
        if unknown > 0 {
            println!("{unknown} participants without a size in participant.toml count as size {}.", self.search.size);
        }
        if let Some(path) = &self.summary {
            summary::write(path, &means)?;
            println!("wrote {}", path.display());
        }
        println!(
            "wrote {}: {steps} steps of {} participants in {:.1} s; {cached} participants were in the table already",
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
    known: Participant,
    /// The participant's size, or the default.
    size: InsoleSize,
    options: Options,
    contact: ContactRule,
}

impl Person {
    /// A description of all inputs of the rows, and of the program's version.
    fn made_from(&self) -> Result<String> {
        let Self { known, size, options, contact, .. } = self;
        let mut text = format!("{} {size} {known:?} {options:?} {contact:?}", env!("PLANTAR_VERSION"));
        for path in self.recordings.iter().chain(&known.zero) {
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
            mass_kg: self.known.mass_kg,
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

    fn steps(&self, recording: &Recording) -> Result<Vec<Step>> {
        let mut insole = setup::insole(recording, self.contact)?;
        ZeroArgs { zero: self.known.zero.clone() }.apply(&mut insole)?;
        let (steps, _) = isolate(recording, &insole, 0, &mut |_| ())?;
        Ok(steps)
    }
}
