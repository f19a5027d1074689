//! The participants of a study: one folder per person, with recordings and, optionally, a file `participant.toml`.

use crate::fit::{Search, print_notes};
use crate::paths::resolved;
use crate::setup::{ContactArgs, StanceArgs};
use anyhow::{Context, Result, bail};
use parameters::Participant;
use std::path::{Path, PathBuf};
use std::{fs, io};
use study::table::partition;
use study::{Person, SETTINGS_FILE};

/// The names of the participants' folders in the folder of a study, sorted. Hidden folders and recordings in parts are omitted,
/// and so are folders of results: the folder `out` of the output, and folders that contain it or the table of an earlier run,
/// unless they also contain recordings or settings of a participant.
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
        let is_omitted = name.as_encoded_bytes().starts_with(b".") || recording::is_parquet(&path);
        if path.is_dir() && !is_omitted && !has_only_results(&path, out.as_deref()) {
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
    let holds_results = |path: &PathBuf| is_partition(path) || path.is_dir() && has_only_results(path, None);
    out.is_some_and(|out| out.starts_with(&resolved)) || entries.iter().any(holds_results)
}

/// True for the folder of a participant in a table.
fn is_partition(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&partition("")))
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
        files.extend(named_by_settings(&folder));
        files
    };
    names.iter().flat_map(of_participant).collect()
}

/// The files that the settings in a participant's folder name; none if the settings cannot be read.
fn named_by_settings(folder: &Path) -> Vec<PathBuf> {
    let path = folder.join(SETTINGS_FILE);
    let settings = fs::read_to_string(&path).ok().and_then(|text| Participant::parse(&text, &path).ok());
    settings.into_iter().flat_map(|settings| [settings.zero, settings.tissue]).flatten().collect()
}

/// The reasons why files that may be recordings are not used: files outside of the participants' folders, files with an ending
/// that differs from `.parquet` in case, and files in sub-folders of a participant. A sub-folder with the ending `.parquet` is a
/// recording in parts. Hidden files, files that the settings name, and folders of results are omitted. `out` is the folder of the
/// output.
pub fn unused(study: &Path, names: &[String], out: Option<&Path>) -> Vec<String> {
    let out = out.map(resolved);
    let mut reasons: Vec<String> = sorted_entries(study)
        .iter()
        .filter(|path| {
            let has_parts = || recording::is_parquet(path) && !has_only_results(path, out.as_deref());
            may_be_recording(path) && (!path.is_dir() || has_parts())
        })
        .map(|path| format!("{}: not in the folder of a participant: move it there", path.display()))
        .collect();
    for name in names {
        let folder = study.join(name);
        let named: Vec<PathBuf> = named_by_settings(&folder).iter().map(|path| resolved(path)).collect();
        for path in sorted_entries(&folder) {
            if recording::is_parquet(&path) || named.contains(&resolved(&path)) {
                continue;
            }
            if may_be_recording(&path) {
                reasons.push(format!(
                    "{}: the name of a recording must end in .parquet, in lower case: rename it",
                    path.display()
                ));
                continue;
            }
            let count = recordings_below(&path, out.as_deref(), &named);
            if count > 0 {
                reasons.push(format!(
                    "{}: Parquet files in a sub-folder of a participant are not used ({count}): move recordings to {}; the \
                     name of a folder with the parts of one recording must end in .parquet",
                    path.display(),
                    folder.display()
                ));
            }
        }
    }
    reasons
}

/// Number of files in a folder, at any depth, that may be recordings; 0 for a file, and for a hidden folder or one of results.
/// `named` are files that the settings name.
fn recordings_below(folder: &Path, out: Option<&Path>, named: &[PathBuf]) -> usize {
    let is_hidden = folder.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
    if !folder.is_dir() || is_hidden || is_partition(folder) || has_only_results(folder, out) {
        return 0;
    }
    let count = |path: &PathBuf| match path.is_dir() {
        true => recordings_below(path, out, named),
        false => usize::from(may_be_recording(path) && !named.contains(&resolved(path))),
    };
    entries(folder).iter().map(count).sum()
}

/// True for a name that ends in `.parquet`, in upper or lower case, and is not hidden.
fn may_be_recording(path: &Path) -> bool {
    recording::is_parquet(&path.with_extension("parquet"))
        && path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("parquet"))
}

/// The entries of a folder, sorted; none if it cannot be read.
fn sorted_entries(folder: &Path) -> Vec<PathBuf> {
    let mut entries = entries(folder);
    entries.sort();
    entries
}

/// Reads a file that a study names. A study from elsewhere may name a device or a pipe, from which a program reads without end.
///
/// # Errors
/// If the file cannot be read, is not a regular one, or is larger than any file of parameters.
fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    const MAX_BYTES: u64 = 1 << 24;
    let metadata = fs::metadata(path)?;
    if !metadata.is_file() || metadata.len() > MAX_BYTES {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "not a file of zeros or of measurements of the tissue",
        ));
    }
    fs::read(path)
}

/// The participant in a folder, and the paths of the recordings there, sorted by name.
pub fn open(
    folder: &Path,
    search: &Search,
    contact: &ContactArgs,
    stance: &StanceArgs,
) -> Result<(Person, Vec<PathBuf>)> {
    let (contact, stance) = (contact.rule(None)?, stance.rule()?);
    let person = Person::open(folder, &search.of_study(), contact, stance, &read_file)?;
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
