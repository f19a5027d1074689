//! A recording in parts: a folder of files, each of which continues the one before it.

use crate::{Error, Recording, Result, file};
use std::path::{Path, PathBuf};

/// Reads the files of a folder in the order of their names, and joins them.
///
/// # Errors
/// Where the folder has no recording, or where a part does not continue the one before it.
pub fn read(folder: &Path) -> Result<Recording> {
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.map(|entry| entry.path()).map_err(Error::io(folder)))
        .filter(|path| path.as_ref().is_ok_and(|path| path.extension().is_some_and(|end| end == "parquet")))
        .collect::<Result<_>>()?;
    paths.sort();
    let mut parts = paths.iter();
    let Some(first) = parts.next() else {
        return Err(Error::content(
            folder.display().to_string(),
            "the folder has no .parquet file",
            "name a recording",
        ));
    };
    let mut whole = file::read(first)?;
    for path in parts {
        let part = file::read(path)?;
        let is_continued = (part.side, part.rate_hz, &part.layout) == (whole.side, whole.rate_hz, &whole.layout);
        let gap_s = part.t_s.first().zip(whole.t_s.last()).map_or(f64::NAN, |(next_s, last_s)| next_s - last_s);
        if !is_continued || (gap_s * whole.rate_hz - 1.0).abs() > 0.1 {
            return Err(Error::content(
                path.display().to_string(),
                "this part does not continue the one before it: another foot, layout or rate, or a gap in time",
                "move it to a folder of its own",
            ));
        }
        if part.source != whole.source {
            whole.source = format!("{} {}", whole.source, part.source);
        }
        whole.t_s.extend(part.t_s);
        whole.pressure_kpa.extend(part.pressure_kpa);
    }
    Ok(whole)
}
