//! The HDF5 file of one walker of the data set SpeedPP2DS, from the package `jiku-data`: the recording is consistent, or the
//! file is refused.

use crate::check_recording;
use recording::jiku;

/// Checks one input.
pub fn check(data: &[u8]) {
    if let Ok(recording) = jiku::parse(data, &[0, 1]) {
        check_recording(&recording);
    }
}
