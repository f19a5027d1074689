//! The source of the scale of the deformation of a region: measurements or assumptions.

use plantar::Region;
use std::fmt;

/// The source of C, the scale of the deformation of a region. The largest deformation is the product of the thickness of the
/// tissue and of its largest compression (the peak strain). C follows from measurements alone if both were measured. A measured
/// curvature of the sole determines C without them, but only with an assumption on the compression (docs/identification.md).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeformationScale {
    /// Measurements.
    Measured,
    /// A measured compression of a thickness that is typical for the shoe size.
    AssumedThickness,
    /// An assumed compression of a measured thickness, or a measured curvature, from which the compression follows by Eq. 14.
    AssumedCompression,
    /// An assumed compression of a typical thickness, or an unknown source.
    #[default]
    Assumed,
}

impl DeformationScale {
    /// The scale of all regions if nothing is known about it, as for the parameters on an insole.
    pub const ALL_ASSUMED: [Self; 8] = [Self::Assumed; 8];
    const ALL: [Self; 4] = [Self::Measured, Self::AssumedThickness, Self::AssumedCompression, Self::Assumed];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::AssumedThickness => "assumed_thickness",
            Self::AssumedCompression => "assumed_compression",
            Self::Assumed => "assumed",
        }
    }

    /// The scale with this name in a file, which omits the name if nothing was measured.
    pub(crate) fn of_file(name: Option<&str>) -> Result<Self, String> {
        let Some(name) = name else { return Ok(Self::Assumed) };
        Self::ALL.into_iter().find(|scale| scale.name() == name).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("deformation_scale = {name:?}: expected one of {names}")
        })
    }

    /// The share of assumption, %: how many of the two factors, thickness and compression, are assumed. The deformation is in
    /// proportion to each of them. A deformation that follows from a curvature does not depend on the thickness.
    pub fn assumed_percent(self) -> u32 {
        match self {
            Self::Measured => 0,
            Self::AssumedThickness | Self::AssumedCompression => 50,
            Self::Assumed => 100,
        }
    }
}

/// The title for the deformations of regions with these scales. It states that the deformations are scaled by assumption,
/// unless all scales were measured.
pub fn deformation_title(scales: &[DeformationScale]) -> &'static str {
    match scales.iter().all(|scale| *scale == DeformationScale::Measured) {
        true => "deformation",
        false => "deformation (scaled by assumption)",
    }
}

/// Displays how much of the scale of the deformation is assumed in each of the eight regions: see
/// [`DeformationScale::assumed_percent`].
#[derive(Clone, Copy, Debug)]
pub struct AssumedShare<'s>(pub &'s [DeformationScale; 8]);

impl fmt::Display for AssumedShare<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = self.0.map(DeformationScale::assumed_percent);
        if percent.iter().all(|share| *share == percent[0]) {
            return write!(f, "{} % in all regions", percent[0]);
        }
        let regions: Vec<_> =
            Region::ALL.iter().zip(percent).map(|(region, share)| format!("{} {share} %", region.name())).collect();
        f.write_str(&regions.join(", "))
    }
}
