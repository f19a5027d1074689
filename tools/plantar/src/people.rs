//! The participants of a study: one folder per person, with recordings and, optionally, a file `participant.toml`.

use crate::fit::{Search, print_notes};
use crate::paths::resolved;
use crate::setup::ContactArgs;
use anyhow::{Context, Result, bail};
use parameters::Participant;
use std::fs;
use std::path::{Path, PathBuf};
use study::table::partition;
use study::{Person, SETTINGS_FILE};

/// The names of the participants' folders in the folder of a study, sorted. Hidden folders and folders of results are omitted:
/// the folder `out` of the output, folders that contain it, and tables of earlier runs.
pub fn names(study: &Path, out: Option<&Path>) -> Result<Vec<String>> {
    let error = || format!("cannot read {}: it must be a folder with one folder per participant", study.display());
    let out = out.map(resolved);
    let root = resolved(study);
    if let Some(folder) = out.as_ref().filter(|out| out.parent() == Some(root.as_path()) && has_person(&entries(out))) {
        bail!("{}: this folder contains recordings or participant.toml: choose another --out", folder.display());
    }
    let mut names = Vec::new();
    for entry in fs::read_dir(study).with_context(error)? {
        let path = entry.with_context(error)?.path();
        let name = path.file_name().unwrap_or_default();
        if path.is_dir() && !name.as_encoded_bytes().starts_with(b".") && !has_only_results(&path, out.as_deref()) {
            let name = name.to_str();
            let name = name.with_context(|| format!("{}: a participant's name must be UTF-8", path.display()))?;
            names.push(name.to_string());
        }
    }
    if names.is_empty() {
        bail!("{}: no participant: it must contain one folder per participant, with recordings", study.display());
    }
    names.sort();
    Ok(names)
}

/// True for the folder `out`, and for a folder that contains it or the table of an earlier run, at any depth, but neither
/// recordings nor settings of a participant.
fn has_only_results(folder: &Path, out: Option<&Path>) -> bool {
    let resolved = resolved(folder);
    if out.is_some_and(|out| out == resolved) {
        return true;
    }
    let entries = entries(folder);
    if has_person(&entries) {
        return false;
    }
    let in_table = |path: &Path| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(&partition("")));
    let holds_results = |path: &PathBuf| in_table(path) || path.is_dir() && has_only_results(path, None);
    out.is_some_and(|out| out.starts_with(&resolved)) || entries.iter().any(holds_results)
}

/// True if the entries of a folder contain recordings or settings of a participant.
fn has_person(entries: &[PathBuf]) -> bool {
    entries.iter().any(|path| recording::is_parquet(path) || path.ends_with(SETTINGS_FILE))
}

/// The entries of a folder; none if it cannot be read.
fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
}

/// The files of these participants, which a command may read: the Parquet and TOML files in their folders, and the files that
/// their settings name. A folder or settings that cannot be read add none; their participant is left out later, with the reason.
pub fn files(study: &Path, names: &[String]) -> Vec<PathBuf> {
    let of_participant = |name| {
        let folder = study.join(name);
        let mut files = entries(&folder);
        files.retain(|path| path.extension().is_some_and(|ending| ending == "parquet" || ending == "toml"));
        let path = folder.join(SETTINGS_FILE);
        let settings = fs::read_to_string(&path).ok().and_then(|text| Participant::parse(&text, &path).ok());
        files.extend(settings.into_iter().flat_map(|settings| [settings.zero, settings.thickness]).flatten());
        files
    };
    names.iter().flat_map(of_participant).collect()
}

/// The participant in a folder, and the paths of the recordings there, sorted by name.
pub fn open(folder: &Path, search: &Search, contact: &ContactArgs) -> Result<(Person, Vec<PathBuf>)> {
    let person = Person::open(folder, &search.of_study(), contact.rule(None)?, &|path| fs::read(path))?;
    print_notes(&person.notes);
    let mut recordings = Vec::new();
    let error = || format!("cannot read {}", folder.display());
    for entry in fs::read_dir(folder).with_context(error)? {
        recordings.push(entry.with_context(error)?.path());
    }
    recordings.retain(|path| recording::is_parquet(path));
    recordings.sort();
    Ok((person, recordings))
}
