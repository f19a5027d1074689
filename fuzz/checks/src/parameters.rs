//! The TOML files of parameters, tissue measurements, participants and zeros (readings of the unloaded cells): each is refused or
//! has valid values. Parameters and zeros that were read can be written. After reading again, the zeros are the same, and so are
//! the subject of the parameters and the conditions of their identification.

use parameters::{Parameters, Participant, TissueMeasurements};
use recording::Zero;
use std::path::Path;

/// Checks one input; bytes that are not UTF-8 are ignored, because TOML files are read as text.
pub fn check(data: &[u8]) {
    let Ok(text) = str::from_utf8(data) else { return };
    let path = Path::new("fuzz.toml");
    if let Ok(parameters) = Parameters::parse(text, path) {
        assert!(parameters.tissue().check().is_ok());
        let again = Parameters::parse(&parameters.to_toml(), path).expect("a written file can be read");
        assert_eq!((again.subject, again.identified), (parameters.subject, parameters.identified));
    }
    let _ = Participant::parse(text, path);
    if let Ok(TissueMeasurements(regions)) = TissueMeasurements::parse(text, path) {
        for region in regions {
            assert!(region.thickness_m.is_none_or(|m| (0.002..=0.04).contains(&m)), "{region:?}");
            assert!(region.peak_strain.is_none_or(|strain| (0.05..=0.95).contains(&strain)), "{region:?}");
        }
    }
    if let Ok(zero) = Zero::parse(text, path) {
        assert_eq!(Zero::parse(&zero.to_toml(), path).expect("a written file can be read"), zero);
    }
}
