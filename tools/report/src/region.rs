//! The titles of the eight regions in the report, and their fits.

use fit::{RegionFit, Study};

/// Titles in the order of [`plantar::Region::ALL`].
pub const TITLES: [&str; 8] = [
    "Heel",
    "Posterior midfoot",
    "Anterior midfoot",
    "Metatarsals 1–2",
    "Metatarsals 3–5",
    "Hallux",
    "Toe 2",
    "Toes 3–5",
];

/// NRMSE by region in Table 2 of the paper, for the right foot of one participant, %.
pub const PAPER_NRMSE: [f64; 8] = [22.1, 6.1, 8.2, 18.1, 11.7, 24.5, 13.9, 20.9];

/// The CSS class that sets the colour of a region, after Fig. 1 of the paper.
pub fn colour(region: usize) -> String {
    format!("c{region}")
}

/// The fit of a region.
///
/// # Errors
/// The reason why the region was not fitted.
pub fn fit_of(study: &Study, region: usize) -> Result<&RegionFit, String> {
    match study.fits.get(region) {
        Some(Ok(fit)) => Ok(fit),
        Some(Err(reason)) => Err(reason.to_string()),
        None => Err("not fitted yet".into()),
    }
}

/// The fitted regions with their indices.
pub fn fitted(study: &Study) -> impl Iterator<Item = (usize, &RegionFit)> {
    (0..8).filter_map(|region| Some((region, fit_of(study, region).ok()?)))
}
