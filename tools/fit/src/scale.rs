//! The scale of the deformation: what determines C, the vertical radius of the ellipsoid.
//!
//! The force does not depend on C, so C follows from one of three other sources: a measured peak strain of the tissue, a measured
//! curvature of the unloaded sole, or, without a measurement, an assumed compression. Near its lowest point, an ellipsoid has the
//! radii of curvature A^2/C and B^2/C. The force determines A B, and the contact ellipse determines A/B, so each of the two radii
//! determines C: with Eq. 14, in which the depth delta and the radius a of the contact of a sphere of radius R are related by
//! delta = a^2/(2R), as for a Winkler foundation. For an elastic half-space, delta is a^2/R (Hertz).

use plantar::pipeline::model::ForceLaw;
use std::fmt;

/// Two measurements contradict each other if they yield values of C that differ by more than this factor.
const CONTRADICTION: f64 = 1.5;
/// Range of the largest deformation, divided by the thickness, that tissue can have.
const POSSIBLE_STRAIN: [f64; 2] = [0.05, 0.95];
/// The name of [`Measured::peak_strain`].
const STRAIN: &str = "peak strain";
/// The names of the radii of curvature, in the order of [`Measured::curvature_m`].
const DIRECTIONS: [&str; 2] = ["medial-lateral curvature", "heel-toe curvature"];

/// Measurements of the tissue of one region. The ranges of the values are not checked here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// True if the thickness was measured; otherwise it is typical for the shoe size.
    pub has_thickness: bool,
    /// Largest deformation in walking divided by the thickness, 0.05 to 0.95.
    pub peak_strain: Option<f64>,
    /// Radii of curvature of the unloaded sole, m, 0.005 to 0.5: medial-lateral and heel-toe.
    pub curvature_m: [Option<f64>; 2],
}

/// What determines C of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// An assumed largest deformation divided by the thickness, 0 to 1.
    Assumed(f64),
    /// A measured largest deformation divided by the thickness, 0 to 1.
    PeakStrain(f64),
    /// A measured curvature of the unloaded sole: the geometric mean of the medial-lateral and the heel-toe radius, m.
    Curvature(f64),
    /// The search of the paper. The force does not determine C, so the C that it finds is arbitrary. The number is the largest
    /// deformation divided by the thickness.
    Searched(f64),
}

impl Measured {
    /// Nothing was measured.
    pub const NONE: Self = Self { has_thickness: false, peak_strain: None, curvature_m: [None; 2] };

    /// The scale from the measurements, which must not contradict each other ([`FittedRegion::contradiction`]); `None` if there
    /// are none. If the thickness was measured, a peak strain takes precedence over a curvature, because it states the
    /// deformation itself; otherwise a curvature does, because it does not depend on the thickness. `aspect` is A divided by B.
    pub(crate) fn scale(&self, aspect: f64) -> Option<Scale> {
        let curvature = match self.curvature_m {
            [Some(medial_lateral_m), Some(heel_toe_m)] => Some((medial_lateral_m * heel_toe_m).sqrt()),
            _ => self.mean_radii_m(aspect).into_iter().flatten().next(),
        };
        let strain = self.peak_strain.filter(|_| self.has_thickness || curvature.is_none());
        strain.map(Scale::PeakStrain).or(curvature.map(Scale::Curvature))
    }

    /// The geometric mean of the two radii of curvature, m, that follows from each of them and from A divided by B, `aspect`: the
    /// radii are A^2/C and B^2/C, and the mean is A B/C.
    fn mean_radii_m(&self, aspect: f64) -> [Option<f64>; 2] {
        let [medial_lateral_m, heel_toe_m] = self.curvature_m;
        [medial_lateral_m.map(|r| r / aspect), heel_toe_m.map(|r| r * aspect)]
    }
}

impl Scale {
    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Assumed(_) => "assumed_compression",
            Self::PeakStrain(_) => "peak_strain",
            Self::Curvature(_) => "curvature",
            Self::Searched(_) => "search",
        }
    }

    /// The same scale with its value multiplied by a factor.
    pub fn scaled(self, factor: f64) -> Self {
        match self {
            Self::Assumed(strain) => Self::Assumed(strain * factor),
            Self::PeakStrain(strain) => Self::PeakStrain(strain * factor),
            Self::Curvature(radius_m) => Self::Curvature(radius_m * factor),
            Self::Searched(strain) => Self::Searched(strain * factor),
        }
    }

    /// C, m, of a force law. `area_max_m2` is the largest contact area, and `thickness_m` is d0.
    pub(crate) fn c_m(self, law: &ForceLaw<f64>, area_max_m2: f64, thickness_m: f64) -> f64 {
        match self {
            Self::Assumed(strain) | Self::PeakStrain(strain) | Self::Searched(strain) => {
                strain * thickness_m / law.area_ratio(area_max_m2).normalised_deformation()
            }
            Self::Curvature(radius_m) => law.ab_m2 / radius_m,
        }
    }
}

impl fmt::Display for Scale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Assumed(strain) => write!(f, "an assumed largest compression of {:.1} %", strain * 100.0),
            Self::PeakStrain(strain) => write!(f, "a measured peak strain of {:.1} %", strain * 100.0),
            Self::Curvature(radius_m) => {
                write!(f, "a measured curvature (geometric mean of the radii {:.1} mm)", radius_m * 1e3)
            }
            Self::Searched(_) => f.write_str("the search"),
        }
    }
}

/// The data from which C of a region follows.
pub(crate) struct FittedRegion<'s> {
    /// The force law; its C is not used.
    pub law: &'s ForceLaw<f64>,
    /// Largest contact area, m2.
    pub area_max_m2: f64,
    /// d0, m.
    pub thickness_m: f64,
    /// A divided by B.
    pub aspect: f64,
}

impl FittedRegion<'_> {
    /// The contradiction between the measurements, or between them and the properties of tissue; `None` if there is none.
    pub fn contradiction(&self, measured: &Measured) -> Option<Contradiction> {
        let c_m = |scale: Scale| scale.c_m(self.law, self.area_max_m2, self.thickness_m);
        let typical_m = (!measured.has_thickness).then_some(self.thickness_m);
        let strain = measured.peak_strain.map(|strain| (STRAIN, c_m(Scale::PeakStrain(strain))));
        let radii: Vec<_> = DIRECTIONS
            .into_iter()
            .zip(measured.mean_radii_m(self.aspect))
            .filter_map(|(name, mean)| Some((name, c_m(Scale::Curvature(mean?)))))
            .collect();
        let all: Vec<_> = strain.into_iter().chain(radii.iter().copied()).collect();
        // Radii that contradict each other do so with any thickness. If a peak strain contradicts them, a typical thickness may
        // be the cause.
        for (values, typical_m) in [(&radii, None), (&all, typical_m)] {
            let by_c = |a: &&(&str, f64), b: &&(&str, f64)| a.1.total_cmp(&b.1);
            if let (Some(&least), Some(&most)) = (values.iter().min_by(by_c), values.iter().max_by(by_c))
                && most.1 > CONTRADICTION * least.1
            {
                return Some(Contradiction::Between { least, most, typical_m });
            }
        }
        let scale = measured.scale(self.aspect).filter(|scale| matches!(scale, Scale::Curvature(_)))?;
        let g_max = self.law.area_ratio(self.area_max_m2).normalised_deformation();
        let strain = c_m(scale) * g_max / self.thickness_m;
        let is_possible = (POSSIBLE_STRAIN[0]..=POSSIBLE_STRAIN[1]).contains(&strain);
        (!is_possible).then_some(Contradiction::Strain { scale, strain, typical_m })
    }
}

/// Measurements that cannot all be true. `typical_m` is the typical thickness, m, if it was used because none was measured: the
/// measurements may then be true for another thickness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Contradiction {
    /// The names of two measurements with the C, m, that follow from them. Only that of the peak strain depends on the thickness.
    Between { least: (&'static str, f64), most: (&'static str, f64), typical_m: Option<f64> },
    /// The curvature results in a deformation, divided by the thickness, that is not possible.
    Strain { scale: Scale, strain: f64, typical_m: Option<f64> },
}

impl Contradiction {
    /// The typical thickness, m, if a measured one may resolve the contradiction.
    fn typical_m(&self) -> Option<f64> {
        match self {
            Self::Between { typical_m, .. } | Self::Strain { typical_m, .. } => *typical_m,
        }
    }
}

impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Between { least: (one, least_m), most: (other, most_m), .. } => write!(
                f,
                "measurements contradict each other: C is {:.1} mm by the {one} and {:.1} mm by the {other}, a factor of {:.2} \
                 (at most {CONTRADICTION} is accepted)",
                least_m * 1e3,
                most_m * 1e3,
                most_m / least_m
            ),
            Self::Strain { scale, strain, .. } => write!(
                f,
                "{scale} contradicts the thickness: the tissue would be compressed by {:.1} % of it ({:.0} to {:.0} % are possible)",
                strain * 100.0,
                POSSIBLE_STRAIN[0] * 100.0,
                POSSIBLE_STRAIN[1] * 100.0
            ),
        }?;
        if let Some(typical_m) = self.typical_m() {
            write!(
                f,
                "; the typical thickness of {:.1} mm was used, because none was measured, and may be the cause",
                typical_m * 1e3
            )?;
        }
        let remedy = match self.typical_m() {
            Some(_) => "measure and state `thickness_mm` of this region",
            None => "measure this region again",
        };
        write!(
            f,
            "; neither peak strain nor curvature was used, and C, stiffness, moduli and energies follow from the assumed \
             compression; {remedy}, or remove a value from the file of tissue measurements"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;
    use std::f64::consts::PI;

    const C_M: f64 = 0.012;
    const THICKNESS_M: f64 = 0.016;
    const ASPECT: f64 = 0.8;

    /// The force law and the largest contact area, m2, of a heel whose ellipsoid has a C of 12 mm, and exact measurements of
    /// it: the peak strain, and the radii A^2/C and B^2/C.
    fn heel() -> (ForceLaw<f64>, f64, Measured) {
        let law = synthetic::law(0);
        let area_max_m2 = 0.75 * PI * law.ab_m2;
        let deformation_m = C_M * (1.0 - (1.0f64 - 0.75).sqrt());
        let (a2_m2, b2_m2) = (law.ab_m2 * ASPECT, law.ab_m2 / ASPECT);
        let measured = Measured {
            has_thickness: true,
            peak_strain: Some(deformation_m / THICKNESS_M),
            curvature_m: [Some(a2_m2 / C_M), Some(b2_m2 / C_M)],
        };
        (law, area_max_m2, measured)
    }

    /// The scale that follows from the measurements of the heel, and its C, m.
    fn chosen(measured: &Measured) -> Result<(Scale, f64), Contradiction> {
        let (law, area_max_m2, _) = heel();
        let region = FittedRegion { law: &law, area_max_m2, thickness_m: THICKNESS_M, aspect: ASPECT };
        if let Some(contradiction) = region.contradiction(measured) {
            return Err(contradiction);
        }
        let scale = measured.scale(ASPECT).unwrap_or(Scale::Assumed(0.457));
        Ok((scale, scale.c_m(&law, area_max_m2, THICKNESS_M)))
    }

    #[test]
    fn every_measurement_of_the_same_tissue_results_in_its_c() {
        let (.., all) = heel();
        let [medial_lateral_m, heel_toe_m] = all.curvature_m;
        let none = Measured::NONE;
        for (measured, name) in [
            (all, "peak_strain"),
            (Measured { has_thickness: false, ..all }, "curvature"),
            (Measured { peak_strain: all.peak_strain, ..none }, "peak_strain"),
            (Measured { curvature_m: all.curvature_m, ..none }, "curvature"),
            (Measured { curvature_m: [medial_lateral_m, None], ..none }, "curvature"),
            (Measured { curvature_m: [None, heel_toe_m], ..none }, "curvature"),
        ] {
            let (scale, c_m) = chosen(&measured).expect("no contradiction");
            assert_eq!(scale.name(), name);
            assert!((c_m / C_M - 1.0).abs() < 1e-12, "{measured:?}: {c_m}");
        }
        let (scale, _) = chosen(&none).expect("no contradiction");
        assert_eq!(scale, Scale::Assumed(0.457));
    }

    #[test]
    fn measurements_whose_c_differ_by_a_factor_above_1_5_contradict_each_other() {
        let (.., all) = heel();
        let [medial_lateral_m, heel_toe_m] = all.curvature_m;
        let scaled = |radius_m: Option<f64>, factor: f64| radius_m.map(|m| m * factor);
        // C is inversely proportional to a radius.
        let both =
            |factor| Measured { curvature_m: [scaled(medial_lateral_m, factor), scaled(heel_toe_m, factor)], ..all };
        assert!(chosen(&both(1.45)).is_ok() && chosen(&both(1.0 / 1.45)).is_ok());
        let problem = chosen(&both(1.6)).expect_err("a contradiction").to_string();
        assert!(problem.contains("C is 7.5 mm") && problem.contains("12.0 mm by the peak strain"), "{problem}");
        assert!(chosen(&both(1.0 / 1.6)).is_err());
        // Rounded to one decimal, the factor would equal the limit.
        let problem = chosen(&both(1.53)).expect_err("a contradiction").to_string();
        assert!(problem.contains("a factor of 1.53 (at most 1.5 is accepted)"), "{problem}");
        // The radii contradict the measured A/B.
        let sole = Measured { peak_strain: None, curvature_m: [medial_lateral_m, scaled(heel_toe_m, 1.6)], ..all };
        let problem = chosen(&sole).expect_err("a contradiction").to_string();
        assert!(problem.contains("medial-lateral curvature") && problem.contains("heel-toe curvature"), "{problem}");
    }

    #[test]
    fn a_curvature_that_implies_an_impossible_compression_is_a_contradiction() {
        let small_radius = Measured { curvature_m: [Some(0.005), None], ..Measured::NONE };
        let problem = chosen(&small_radius).expect_err("a contradiction").to_string();
        assert!(problem.contains("contradicts the thickness"), "{problem}");
    }

    #[test]
    fn a_contradiction_with_a_thickness_that_was_not_measured_names_it() {
        let (.., all) = heel();
        let larger_m = all.curvature_m.map(|radius_m| radius_m.map(|m| m * 1.6));
        let larger_radii = Measured { curvature_m: larger_m, ..all };
        let small_radius = Measured { curvature_m: [Some(0.005), None], ..Measured::NONE };
        for measured in [larger_radii, small_radius] {
            for has_thickness in [false, true] {
                let problem = chosen(&Measured { has_thickness, ..measured }).expect_err("a contradiction").to_string();
                assert_eq!(problem.contains("typical thickness of 16.0 mm"), !has_thickness, "{problem}");
                assert_eq!(problem.contains("measure and state `thickness_mm`"), !has_thickness, "{problem}");
                assert_eq!(problem.contains("measure this region again"), has_thickness, "{problem}");
            }
        }
        // The two radii contradict each other with any thickness, also if a peak strain results in a smaller C than both of them.
        for peak_strain in [None, all.peak_strain.map(|strain| 0.5 * strain)] {
            let sole = Measured { peak_strain, curvature_m: [all.curvature_m[0], larger_m[1]], has_thickness: false };
            let problem = chosen(&sole).expect_err("a contradiction").to_string();
            assert!(problem.contains("by the heel-toe curvature") && !problem.contains("thickness"), "{problem}");
            assert!(problem.contains("measure this region again"), "{problem}");
        }
    }
}
