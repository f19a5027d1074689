//! Identifies a person's viscoelastic ellipsoids from recorded steps (the paper's section 2.5), without any I/O.
//!
//! [`steps::isolate`] takes steps out of recordings with the insole's own code; [`fit`] finds the five parameters that force
//! can tell in every region ([`identify`]), pins the other three of the paper's eight ([`pins`]), and says how sure
//! ([`interval`]) and how good ([`quality`]) they are. [`paper`] is the paper's own search, for comparison.

pub mod identify;
pub mod interval;
pub mod law;
pub mod paper;
pub mod pins;
pub mod quality;
pub mod steps;
pub mod study;
pub mod synthetic;

mod bounded;
mod region;
mod samples;
mod screen;
mod verdict;

pub use identify::Bounds;
pub use quality::Quality;
pub use region::{RegionFit, fit_step};
pub use samples::Samples;
pub use screen::{LEAST_FORCE_N, LEAST_SAMPLES, Unfit};
pub use steps::{Filter, RegionCurves, Step};
pub use study::Study;

use plantar::Region;
use rayon::prelude::*;

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Five parameters, variable projection, no random start.
    Projection,
    /// The paper's: eight variables, ten starts.
    Paper,
}

impl Method {
    /// In a word, for files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Projection => "projection",
            Self::Paper => "paper",
        }
    }
}

/// What to fit through and within.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The filter that the device will run.
    pub filter: Filter,
    /// How to search.
    pub method: Method,
    /// Within what; not used by [`Method::Paper`].
    pub bounds: Bounds,
    /// Per region, in the order of [`Region::ALL`]: thickness of the unloaded tissue, m.
    pub thickness_m: [f64; 8],
    /// Largest deformation over thickness.
    pub compression: f64,
    /// How often steps are resampled for the second kind of interval; 0 for not at all, [`interval::RESAMPLES`] for good.
    pub resamples: u64,
}

impl Options {
    /// The usual ones, without resampling.
    pub const fn usual(thickness_m: [f64; 8]) -> Self {
        Self {
            filter: Filter::Step,
            method: Method::Projection,
            bounds: Bounds::USUAL,
            thickness_m,
            compression: pins::COMPRESSION,
            resamples: 0,
        }
    }
}

/// Recordings that predict each other this much worse than themselves in [`MIXED_REGIONS`] regions are of two people: so it
/// is for two thirds of all pairs of the ten walkers of SpeedPP2DS, and for none of their own halves.
const MIXED_RATIO: f64 = 1.8;
/// See [`MIXED_RATIO`].
const MIXED_REGIONS: usize = 2;

/// Fits every region, in the order of [`Region::ALL`]. `progress` is told the regions that are done, in any order.
pub fn fit(steps: &[Step], options: &Options, progress: &(dyn Fn(Region) + Sync)) -> [Result<RegionFit, Unfit>; 8] {
    let mut fits: Vec<_> = (0..8)
        .into_par_iter()
        .map(|region| {
            let fit = region::fit_region(steps, region, options);
            progress(Region::ALL[region]);
            fit
        })
        .collect();
    let differs = |fit: &RegionFit| fit.recordings_ratio.filter(|ratio| *ratio > MIXED_RATIO);
    if fits.iter().flatten().filter_map(differs).count() >= MIXED_REGIONS {
        for fit in &mut fits {
            if let Some(ratio) = fit.as_ref().ok().and_then(differs) {
                *fit = Err(Unfit::MixedPeople(ratio));
            }
        }
    }
    std::array::from_fn(|_| fits.remove(0))
}
