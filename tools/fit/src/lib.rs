//! Identification of a person's viscoelastic ellipsoids from recorded steps (section 2.5 of the paper), without I/O.
//!
//! "The paper" is DeBerardinis, Dufek, Trabia, "A viscoelastic ellipsoidal model of the mechanics of plantar tissues", J.
//! Biomech. 92 (2019) 137-145. Equation numbers refer to it.
//!
//! [`steps::isolate`] extracts the steps of recordings with the code of the insole, and [`live`] collects them from the messages
//! of an insole. [`fit`] identifies, for each region, the five parameters that a force trace determines ([`identify`]). The other
//! three of the paper's eight parameters follow from other measurements or assumptions ([`fixed`]). The result includes
//! confidence intervals ([`interval`]) and errors ([`quality`]). The module `paper` contains the search of the paper, for
//! comparison.
//!
//! Without its default features, the library runs in a browser: it then has neither recordings nor threads nor the paper's
//! search.

pub mod agreement;
#[cfg(feature = "recordings")]
pub mod calibration;
#[cfg(feature = "results")]
pub mod cohort;
pub mod compare;
#[cfg(feature = "recordings")]
pub mod contacts;
pub mod identify;
pub mod interval;
pub mod law;
pub mod live;
pub mod measures;
#[cfg(feature = "paper")]
pub mod paper;
pub mod fixed;
pub mod prior;
pub mod quality;
pub mod repeat;
#[cfg(feature = "results")]
pub mod results;
pub mod sensitivity;
pub mod smooth;
pub mod steps;
pub mod study;
pub mod synthetic;
pub mod trials;
pub mod variable;

mod bounded;
#[cfg(feature = "recordings")]
mod isolate;
mod many;
mod parallel;
mod region;
mod samples;
mod scale;
mod screen;
mod verdict;

pub use fixed::Measured;
pub use identify::Bounds;
pub use prior::Prior;
pub use quality::Quality;
pub use region::{RegionFit, fit_each_step, fit_force_law};
pub use samples::Samples;
pub use screen::{MIN_FORCE_N, MIN_SAMPLES, NotFitted};
pub use steps::{Filter, RegionCurves, Step};
pub use study::Study;

use plantar::Region;

/// A method of searching the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Searches the five identifiable parameters by variable projection. The result is deterministic.
    Projection,
    /// The method of the paper: searches all eight parameters from ten random starts, and returns the best result.
    #[cfg(feature = "paper")]
    Paper,
}

impl Method {
    /// Name in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Projection => "projection",
            #[cfg(feature = "paper")]
            Self::Paper => "paper",
        }
    }
}

/// The options of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The filter of the contact area. Use the filter with which the insole will evaluate the model with these parameters.
    pub filter: Filter,
    /// The method of search.
    pub method: Method,
    /// Bounds of the parameters; not used by the paper's method.
    pub bounds: Bounds,
    /// The distribution of the parameters among people, in the order of [`Region::ALL`]; `None` for least squares within
    /// `bounds`. Not used by the paper's method.
    pub prior: Option<[Prior; 8]>,
    /// Thickness of the unloaded tissue, m, in the order of [`Region::ALL`].
    pub thickness_m: [f64; 8],
    /// Length of the foot divided by that of a foot of the European size 42. The bounds of the lengths in the paper's method
    /// are multiplied by this factor.
    pub size_scale: f64,
    /// Assumed largest deformation divided by the thickness, 0 to 1, which determines C of regions without a measurement.
    pub compression: f64,
    /// Further measurements of the tissue, in the order of [`Region::ALL`].
    pub measured: [Measured; 8],
    /// Number of bootstrap resamples of the steps; 0 for no bootstrap intervals, [`interval::RESAMPLES`] for accurate ones.
    pub resamples: u64,
}

impl Options {
    /// The default options, without bootstrap intervals.
    pub const fn usual(thickness_m: [f64; 8]) -> Self {
        Self {
            filter: Filter::Direct,
            method: Method::Projection,
            bounds: Bounds::USUAL,
            prior: Some(prior::WALKERS),
            thickness_m,
            size_scale: 1.0,
            compression: fixed::COMPRESSION,
            measured: [Measured::NONE; 8],
            resamples: 0,
        }
    }
}

/// Recordings are assumed to be of several people if [`RegionFit::recordings_ratio`] exceeds this value in at least
/// [`MIXED_REGIONS`] regions. Among the ten walkers of the data set SpeedPP2DS, with two recordings of ten steps each, this
/// recognises two thirds of the pairs of walkers. The two recordings of one walker are never taken for those of two people.
const MIXED_RATIO: f64 = 1.8;
/// Smallest number of regions with a ratio above [`MIXED_RATIO`].
const MIXED_REGIONS: usize = 2;

/// Fits all regions. The results are in the order of [`Region::ALL`]. `progress` receives each region when its fit is complete;
/// regions may complete in any order.
///
/// # Errors
/// The element of a region that could not be fitted contains the reason.
pub fn fit(steps: &[Step], options: &Options, progress: &(dyn Fn(Region) + Sync)) -> [Result<RegionFit, NotFitted>; 8] {
    let mut fits = parallel::map(8, |region| {
        let fit = region::fit_region(steps, region, options);
        progress(Region::ALL[region]);
        fit
    });
    let differs = |fit: &RegionFit| fit.recordings_ratio.filter(|ratio| *ratio > MIXED_RATIO);
    if fits.iter().flatten().filter_map(differs).count() >= MIXED_REGIONS {
        for fit in &mut fits {
            if let Some(ratio) = fit.as_ref().ok().and_then(differs) {
                *fit = Err(NotFitted::MixedPeople(ratio));
            }
        }
    }
    std::array::from_fn(|_| fits.remove(0))
}
