//! The layout file of a CSV import, with two unloaded frames, the smallest number in a recording: the recording is consistent,
//! or the file is refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use plantar::Side;
use plantar_fuzz::check_recording;
use recording::csv;

fuzz_target!(|data: &[u8]| {
    let cells =
        data.split(|&byte| byte == b'\n').filter(|line| !line.trim_ascii().is_empty()).count().saturating_sub(1);
    let header = (0..cells).map(|cell| format!(",c{cell}")).collect::<String>();
    let zeros = ",0".repeat(cells);
    let frames = format!("t_s{header}\n0{zeros}\n0.01{zeros}\n");
    if let Ok(recording) = csv::parse(data, frames.as_bytes(), Side::Left) {
        check_recording(&recording);
    }
});
