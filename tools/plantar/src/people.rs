//! The participants of a study: one folder per person, with recordings and, optionally, a file `participant.toml`.

use crate::fit::Search;
use crate::setup::{self, ContactArgs, ZeroArgs};
use anyhow::{Context, Result, bail};
use fit::steps::isolate;
use fit::{Options, Step};
use parameters::{InsoleSize, Participant};
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use recording::RecordingReader;
use std::fs;
use std::path::{Path, PathBuf};

/// A participant and the options for this person.
pub struct Person {
    /// The person's folder.
    pub folder: PathBuf,
    /// The recordings in the folder, sorted by name.
    pub recordings: Vec<PathBuf>,
    /// The values of participant.toml, or none without this file.
    pub settings: Participant,
    /// The size in participant.toml, or else the option --size.
    pub size: InsoleSize,
    /// The options of the fit, for this person's size and tissue thickness.
    pub options: Options,
    /// The contact rule.
    pub contact: ContactRule,
}

/// The names of the participants' folders in the folder of a study, sorted. The folder `except` is not one of them.
pub fn names(study: &Path, except: Option<&Path>) -> Result<Vec<String>> {
    let error = || format!("cannot read {}: it must be a folder with one folder per participant", study.display());
    let except = except.and_then(|path| path.canonicalize().ok());
    let mut names = Vec::new();
    for entry in fs::read_dir(study).with_context(error)? {
        let path = entry.with_context(error)?.path();
        let name = path.file_name().unwrap_or_default().to_str();
        let name = name.with_context(|| format!("{}: a participant's name must be UTF-8", path.display()))?;
        if path.is_dir() && !name.starts_with('.') && (except.is_none() || path.canonicalize().ok() != except) {
            names.push(name.to_string());
        }
    }
    if names.is_empty() {
        bail!("{}: no participant: it must contain one folder per participant, with recordings", study.display());
    }
    names.sort();
    Ok(names)
}

impl Person {
    /// Reads a participant's folder.
    pub fn open(folder: &Path, search: &Search, contact: &ContactArgs) -> Result<Self> {
        let file = folder.join("participant.toml");
        let settings = if file.exists() { Participant::read(&file)? } else { Participant::default() };
        let mut recordings = Vec::new();
        for entry in fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))? {
            recordings.push(entry?.path());
        }
        recordings.retain(|path| path.extension().is_some_and(|ending| ending == "parquet"));
        recordings.sort();
        Self::new(folder, recordings, settings, search, contact)
    }

    /// A participant with these recordings and settings.
    pub fn new(
        folder: &Path,
        recordings: Vec<PathBuf>,
        settings: Participant,
        search: &Search,
        contact: &ContactArgs,
    ) -> Result<Self> {
        let mut search = search.clone();
        search.size = settings.size.unwrap_or(search.size);
        search.thickness = settings.thickness.clone().or(search.thickness);
        Ok(Self {
            folder: folder.into(),
            recordings,
            size: search.size,
            options: search.options(0)?,
            contact: contact.rule(None)?,
            settings,
        })
    }

    /// The foot and the complete steps of a recording.
    pub fn steps(&self, path: &Path) -> Result<(Side, Vec<Step>)> {
        let reader = RecordingReader::open(path)?;
        let side = reader.head.side;
        let isolated = || {
            let mut insole = setup::insole_of(&reader, self.contact)?;
            ZeroArgs { zero: self.settings.zero.clone() }.apply(&mut insole)?;
            Ok(isolate(&insole, insole.scans_of_file(reader), 0, &mut |_| ())?.0)
        };
        let steps: Result<_> = isolated();
        let steps = steps.with_context(|| format!("{}: the recording cannot be evaluated", path.display()))?;
        Ok((side, steps))
    }
}
