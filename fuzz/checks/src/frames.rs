//! The frames file of a CSV import, with a fixed layout of two cells: the recording is consistent, or the file is refused.

use crate::check_recording;
use plantar::Side;
use recording::csv;

const LAYOUT: &str = "cell,x_mm,y_mm,area_mm2,region\n0,30,20,400,heel\n1,30,200,400,metatarsals_12\n";

/// Checks one input.
pub fn check(data: &[u8]) {
    if let Ok(recording) = csv::parse(LAYOUT.as_bytes(), data, Side::Right) {
        check_recording(&recording);
    }
}
