//! The eight regions as the report names them, and what became of each.

use fit::{RegionFit, Study};

/// In the order of [`plantar::Region::ALL`].
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

/// The paper's Table 2: NRMSE, %, of one participant's right foot.
pub const PAPER_NRMSE: [f64; 8] = [22.1, 6.1, 8.2, 18.1, 11.7, 24.5, 13.9, 20.9];

/// The class that sets a region's colour, as the paper's Fig. 1 names them.
pub fn colour(region: usize) -> String {
    format!("c{region}")
}

/// A region's fit, or why there is none.
pub fn fit_of(study: &Study, region: usize) -> Result<&RegionFit, String> {
    match study.fits.get(region) {
        Some(Ok(fit)) => Ok(fit),
        Some(Err(unfit)) => Err(unfit.to_string()),
        None => Err("not fitted yet".into()),
    }
}

/// The regions that were fitted.
pub fn fitted(study: &Study) -> impl Iterator<Item = (usize, &RegionFit)> {
    (0..8).filter_map(|region| Some((region, fit_of(study, region).ok()?)))
}
