//! A recording in parts: a folder of files, each of which continues the one before it.

use crate::columns::ColumnFile;
use crate::{Error, Recording, Result};
use std::path::{Path, PathBuf};

/// True for the name of a Parquet file that is read from a folder. Hidden files are not read: for example, macOS may write
/// `._walk.parquet` beside `walk.parquet`, with other content.
pub fn is_parquet(path: &Path) -> bool {
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    !is_hidden && path.extension().is_some_and(|end| end == "parquet")
}

/// Opens the files of a folder in the order of their names, and returns them with the description of the joined recording.
///
/// # Errors
/// Fails if the folder or a file cannot be read, if the folder has no recording, or if a part does not continue the one before
/// it: it must be of the same foot, layout and rate, and begin one frame later, to within a tenth of a frame.
pub fn open(folder: &Path) -> Result<(Recording, Vec<ColumnFile>)> {
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.map(|entry| entry.path()).map_err(Error::io(folder)))
        // Errors pass this filter, and end the collection.
        .filter(|path| !path.as_ref().is_ok_and(|path| !is_parquet(path)))
        .collect::<Result<_>>()?;
    paths.sort();
    let mut parts = paths.iter();
    let Some(first) = parts.next() else {
        return Err(Error::content(
            folder.display().to_string(),
            "the folder has no .parquet file",
            "name a recording, or a folder with the parts of one",
        ));
    };
    let (mut head, first) = ColumnFile::open(first)?;
    let mut files = vec![first];
    let mut sources = vec![head.source];
    let mut last_s = files[0].last_s()?;
    for path in parts {
        let (part, file) = ColumnFile::open(path)?;
        let is_same_sensor = (part.side, part.rate_hz, &part.layout) == (head.side, head.rate_hz, &head.layout);
        // A part without frames has no times.
        let gap_s = file.first_s()?.zip(last_s).map(|(next_s, last_s)| next_s - last_s);
        if !is_same_sensor || gap_s.is_some_and(|gap_s| (gap_s * head.rate_hz - 1.0).abs() > 0.1) {
            return Err(Error::content(
                path.display().to_string(),
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
