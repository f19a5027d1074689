//! The geometry of pedar insoles and an export, separated by a zero byte: the recordings of both feet are consistent, or the
//! files are refused.

use crate::check_recording;
use plantar::Side;
use recording::pedar;

/// Checks one input.
pub fn check(data: &[u8]) {
    let mut parts = data.splitn(2, |&byte| byte == 0);
    let (Some(geometry), Some(asc)) = (parts.next(), parts.next()) else { return };
    for side in [Side::Left, Side::Right] {
        if let Ok(recording) = pedar::parse(asc, geometry, side) {
            check_recording(&recording);
        }
    }
}
