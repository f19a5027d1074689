//! The export of a vendor's program: the recordings are consistent, or the file is refused. The first byte of an input selects
//! the format (or its recognition from the content) and the foot; the export follows.

use crate::check_recording;
use plantar::Side;
use recording::{Format, Options, footprint};
use std::path::Path;

/// Checks one input.
pub fn check(data: &[u8]) {
    let Some((&selector, bytes)) = data.split_first() else { return };
    let path = Path::new("export");
    // Each format, and the recognition of the format from the content.
    let choices = Format::ALL.len() + 1;
    let format = match Format::ALL.get(usize::from(selector) % choices) {
        Some(format) => *format,
        None => match Format::recognise(bytes, path) {
            Ok(format) => format,
            Err(_) => return,
        },
    };
    let side = [None, Some(Side::Left), Some(Side::Right)][usize::from(selector) / choices % 3];
    let Ok(export) = format.parse(bytes, path, Options { side, ..Options::default() }) else { return };
    for recording in &export.feet {
        check_recording(recording);
        footprint::warnings(recording);
    }
}
