//! A recording in parts: a folder of files, each of which continues the one before it.

use crate::check::At;
use crate::columns::ColumnFile;
use crate::{Error, Recording, Result};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// True for the name of a Parquet file that is read from a folder. Hidden files are not read: for example, macOS may write
/// `._walk.parquet` beside `walk.parquet`, with other content.
pub fn is_parquet(path: &Path) -> bool {
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    !is_hidden && path.extension().is_some_and(|end| end == "parquet")
}

/// The files of a recording: `path` itself, or the parts in the folder `path` in the order of their names.
///
/// # Errors
/// Fails if the folder cannot be read.
pub fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).map_err(Error::io(path))?;
    let mut parts: Vec<PathBuf> = entries
        .map(|entry| entry.map(|entry| entry.path()).map_err(Error::io(path)))
        // Errors pass this filter, and end the collection.
        .filter(|part| !part.as_ref().is_ok_and(|part| !is_parquet(part)))
        .collect::<Result<_>>()?;
    parts.sort();
    Ok(parts)
}

/// Opens the parts in a folder, in the order of their first times, and returns them with the description of the joined recording.
///
/// # Errors
/// Fails if the folder cannot be read, or in the cases of [`join`].
pub fn open(folder: &Path) -> Result<(Recording, Vec<ColumnFile>)> {
    let mut parts = Vec::new();
    for path in files(folder)? {
        let part = ColumnFile::open(&path)?;
        // A part without frames has no times: it is sorted before the others.
        parts.push((part.1.first_s()?, part));
    }
    // The names of ten or more numbered parts are not in the order of time.
    parts.sort_by(|(a, _), (b, _)| a.partial_cmp(b).unwrap_or(Ordering::Equal));
    join(folder, parts.into_iter().map(|(_, part)| Ok(part)))
}

/// Joins the parts of a recording, which are in the order of time, and returns them with the description of the joined
/// recording. `folder` is their folder, for messages.
///
/// # Errors
/// Fails if a part could not be opened, if there is none, or if a part does not continue the one before it: it must be of the
/// same foot, layout and rate, and begin one frame later, to within a tenth of a frame.
pub fn join(
    folder: &Path,
    parts: impl IntoIterator<Item = Result<(Recording, ColumnFile)>>,
) -> Result<(Recording, Vec<ColumnFile>)> {
    let mut parts = parts.into_iter();
    let Some(first) = parts.next() else {
        return Err(Error::content(
            folder.display().to_string(),
            "the folder has no .parquet file",
            "name a recording, or a folder with the parts of one",
        ));
    };
    let (mut head, first) = first?;
    let mut files = vec![first];
    let mut sources = vec![head.source];
    let mut last_s = files[0].last_s()?;
    for part in parts {
        let (part, file) = part?;
        let is_same_sensor = (part.side, part.rate_hz, &part.layout) == (head.side, head.rate_hz, &head.layout);
        // A part without frames has no times.
        let gap_s = file.first_s()?.zip(last_s).map(|(next_s, last_s)| next_s - last_s);
        if !is_same_sensor || gap_s.is_some_and(|gap_s| (gap_s * head.rate_hz - 1.0).abs() > 0.1) {
            return Err(Error::content(
                file.place(At::Whole),
                "this part does not continue the one before it: another foot, layout or rate, or a gap in time",
                "move it to a folder of its own",
            ));
        }
        if !sources.contains(&part.source) {
            sources.push(part.source);
        }
        last_s = file.last_s()?.or(last_s);
        files.push(file);
    }
    head.source = sources.join(" ");
    Ok((head, files))
}
