//! The tissue parameters of the wearer.

use super::contact::ContactRule;
use super::model::ForceLaw;
use super::region::{Region, Side};
use crate::checksum::crc32;
use core::fmt;
use serde::{Deserialize, Serialize};

/// The force laws of all regions, with an identifier that is derived from their content.
///
/// ```
/// use plantar::pipeline::model::ForceLaw;
/// use plantar::pipeline::tissue::{Tissue, TissueError};
///
/// let law = ForceLaw { ab_m2: 1e-3, c_m: 0.01, stiffness_pa: 3e5, ..ForceLaw::NONE };
/// let mut tissue = Tissue::new([law; 8]);
/// assert_eq!(tissue.check(), Ok(()));
/// tissue.force_laws[2].stiffness_pa = 4e5;
/// assert_eq!(tissue.check(), Err(TissueError::Id));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Tissue {
    /// Identifies the parameters in each hello: the CRC-32 of the force laws; 0 for no parameters.
    pub id: u32,
    /// The force laws in the order of [`Region::ALL`].
    pub force_laws: [ForceLaw<f32>; 8],
}

impl Tissue {
    /// No parameters: areas and measured forces remain valid; deformation and model force are 0.
    pub const NONE: Self = Self { id: 0, force_laws: [ForceLaw::NONE; 8] };

    /// The parameters with these force laws, and their identifier.
    pub fn new(force_laws: [ForceLaw<f32>; 8]) -> Self {
        let mut bytes = [0; 8 * 6 * size_of::<f32>()];
        let numbers =
            force_laws.iter().flat_map(|law| [law.ab_m2, law.c_m, law.stiffness_pa, law.damping_pa_s, law.n, law.m]);
        for (place, number) in bytes.chunks_exact_mut(size_of::<f32>()).zip(numbers) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        // 0 stands for no parameters.
        Self { id: crc32(&bytes).max(1), force_laws }
    }

    /// Checks parameters that were received or loaded.
    ///
    /// # Errors
    /// [`TissueError::Id`] if the parameters are damaged or are [`Tissue::NONE`]; [`TissueError::Region`] if a value is out of
    /// range.
    pub fn check(&self) -> Result<(), TissueError> {
        if self.id != Self::new(self.force_laws).id {
            return Err(TissueError::Id);
        }
        let invalid = Region::ALL.into_iter().zip(&self.force_laws).find(|(_, law)| !law.is_valid());
        invalid.map_or(Ok(()), |(region, _)| Err(TissueError::Region(region)))
    }
}

/// The filters of the contact area; see "The two paths through the model" in docs/architecture.md.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum AreaFilter {
    /// The filter of the step record: the area as measured, and the deformation rate over 20 ms; see [`super::step`].
    Direct,
    /// The filter of the live stream: the mean of three frames, and the deformation rate since the previous frame; see
    /// [`super::live`].
    Live,
}

/// The conditions of the identification of parameters. The parameters are valid only for areas with the same contact
/// rule and the same filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identified {
    /// The contact rule of the areas.
    pub contact: ContactRule,
    /// The filter of the areas.
    pub filter: AreaFilter,
    /// The foot; `None` for both feet.
    pub side: Option<Side>,
    /// Number of steps from which the parameters were identified.
    pub steps: u32,
    /// Bit i: the parameters of region i of [`Region::ALL`] were identified. Those of the other regions are typical values.
    pub regions: u8,
}

impl Identified {
    /// True if the parameters of this region were identified.
    pub fn includes(&self, region: Region) -> bool {
        self.regions & 1 << region as u8 != 0
    }

    /// The regions of which the parameters are typical values or, without knowledge of an identification (`None`), not known to
    /// be the wearer's.
    pub fn typical_regions(identified: Option<Self>) -> impl Iterator<Item = Region> {
        Region::ALL.into_iter().filter(move |&region| identified.is_none_or(|identified| !identified.includes(region)))
    }

    /// The regions with parameters that the insole can follow from step to step ([`super::track`]), with the bits of
    /// [`Identified::regions`]. The tracking compares the forces of steps with those of the filter of the step record, so
    /// parameters of another filter are not tracked.
    pub fn tracked_regions(&self) -> u8 {
        match self.filter {
            AreaFilter::Direct => self.regions,
            AreaFilter::Live => 0,
        }
    }
}

/// The reason why a set of parameters is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TissueError {
    /// The identifier is not the checksum of the values.
    Id,
    /// The parameters of this region are out of range; see [`ForceLaw::is_valid`].
    Region(Region),
}

impl fmt::Display for TissueError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Id => f.write_str("the parameters do not match their identifier"),
            Self::Region(region) => write!(f, "the parameters of {} are out of range", region.name()),
        }
    }
}

impl core::error::Error for TissueError {}
