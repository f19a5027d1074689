//! The layout file of a CSV import, with two unloaded frames, the smallest number in a recording: the recording is consistent,
//! or the file is refused.

use crate::check_recording;
use plantar::Side;
use recording::csv;

/// Checks one input.
pub fn check(data: &[u8]) {
    let cells =
        data.split(|&byte| byte == b'\n').filter(|line| !line.trim_ascii().is_empty()).count().saturating_sub(1);
    let header = (0..cells).map(|cell| format!(",c{cell}")).collect::<String>();
    let zeros = ",0".repeat(cells);
    let frames = format!("t_s{header}\n0{zeros}\n0.01{zeros}\n");
    if let Ok(recording) = csv::parse(data, frames.as_bytes(), Side::Left) {
        check_recording(&recording);
    }
}
