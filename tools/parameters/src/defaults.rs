//! Typical parameters by insole size. They were not identified from steps of the wearer: they are sufficient for a first view of
//! a live stream, but do not support a statement about a person.

use crate::{DeformationScale, Parameters};
use plantar::pipeline::model::Ellipsoid;
use plantar::protocol::{Step, StepRegion};
use std::fmt;
use std::str::FromStr;

/// European shoe size, a whole number from 20 to 52. Table 1 of the paper (DeBerardinis et al. 2019) has the sizes 35 to 46.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InsoleSize(u8);

impl FromStr for InsoleSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(size @ 20..=52) => Ok(Self(size)),
            _ => Err(format!("{text}: a European shoe size is required, a whole number from 20 to 52")),
        }
    }
}

impl InsoleSize {
    /// The size as a number.
    pub fn eur(self) -> u8 {
        self.0
    }

    /// A note for the user on a size that is not one of the paper: its typical values are proportional to its length, but no data
    /// show that they are. `None` for the sizes of the paper.
    pub fn extrapolation_note(self) -> Option<String> {
        let is_of_paper = (35..=46).contains(&self.0);
        (!is_of_paper).then(|| {
            format!("size {self} is outside of the sizes of the paper (35 to 46): thickness and areas are extrapolated")
        })
    }

    /// Length of the foot relative to that of size 42.
    pub fn scale(self) -> f64 {
        f64::from(self.0) / 42.0
    }

    /// Typical thickness of the unloaded tissue, m, in the order of [`plantar::Region::ALL`]; proportional to the size. Under
    /// the heel and the metatarsals it is within published ranges (docs/identification.md).
    pub fn thickness_m(self) -> [f64; 8] {
        SIZE_42.map(|typical| typical.d0_mm * self.scale() * 1e-3)
    }
}

impl fmt::Display for InsoleSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Default for InsoleSize {
    fn default() -> Self {
        Self(42)
    }
}

/// The typical values of a region.
struct Typical {
    /// A, B and C, mm. C is such that the largest area of all fitted steps, which can be outside of `range`, compresses the
    /// tissue by 45.7 %, as measured under the metatarsal heads (Cavanagh 1999).
    radii_mm: [f64; 3],
    /// Thickness of the unloaded tissue, mm.
    d0_mm: f64,
    /// K in kPa, G in kPa s, n and m of the force law.
    law: [f64; 4],
    range: TypicalRange,
}

const fn typical(radii_mm: [f64; 3], d0_mm: f64, law: [f64; 4], area_mm2: [f64; 2], pressure_kpa: [f64; 2]) -> Typical {
    Typical { radii_mm, d0_mm, law, range: TypicalRange { area_mm2, pressure_kpa } }
}

/// Size 42, for each region from heel to toes: radii, thickness, force law, and the ranges of area and pressure.
///
/// These are the most probable parameters of 200 steps that ten barefoot walkers took on a plate (SpeedPP2DS, every third step),
/// fitted together by `cargo run --release -p bench --bin typical`. At the same area, the forces of a single walker differ from
/// the forces of these parameters by 12 to 23 % (one standard deviation), at the anterior midfoot by a factor of 1.9. All
/// areas and pressures are those of the contact rule with covered shares
/// ([`plantar::pipeline::contact::ContactRule::COVERED`]).
const SIZE_42: [Typical; 8] = [
    typical([36.4, 44.7, 16.9], 16.0, [685.0, 132.06, -0.56, 1.07], [2033.0, 3418.0], [204.0, 626.0]),
    typical([28.8, 18.5, 9.0], 12.0, [220.0, 3.73, -0.93, 0.24], [25.0, 1356.0], [79.0, 147.0]),
    typical([20.6, 21.5, 6.6], 12.0, [213.0, 0.34, -0.93, 1.87], [21.0, 1318.0], [76.0, 147.0]),
    typical([53.4, 60.9, 44.6], 12.0, [1084.0, 4.37, -0.59, 1.78], [850.0, 2178.0], [162.0, 311.0]),
    typical([46.2, 74.5, 25.7], 10.0, [487.0, 1.95, -0.80, 1.73], [1092.0, 3155.0], [122.0, 253.0]),
    typical([24.3, 22.1, 8.8], 10.0, [706.0, 12.45, -0.56, 2.80], [430.0, 1242.0], [141.0, 541.0]),
    typical([17.6, 18.0, 13.8], 7.0, [408.0, 2.12, -0.83, 1.50], [23.0, 346.0], [86.0, 287.0]),
    typical([13.9, 27.3, 8.6], 7.0, [324.0, 1.02, -0.87, 1.90], [22.0, 548.0], [83.0, 209.0]),
];

/// The range of steps, per region, within which typical parameters hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TypicalRange {
    /// Largest area of a step, mm2: the range of 98 % of the steps.
    pub area_mm2: [f64; 2],
    /// Peak force divided by the largest area, kPa: the range of 98 % of the steps.
    pub pressure_kpa: [f64; 2],
}

impl TypicalRange {
    /// The ranges for a size, in the order of [`plantar::Region::ALL`].
    pub fn of(size: InsoleSize) -> [Self; 8] {
        let scale = size.scale() * size.scale();
        SIZE_42.map(|Typical { range, .. }| Self { area_mm2: range.area_mm2.map(|mm2| mm2 * scale), ..range })
    }

    /// True if area and pressure are within their ranges, each extended by the factor [`MARGIN`] at both ends.
    pub fn includes(&self, area_mm2: f64, pressure_kpa: f64) -> bool {
        let within = |value: f64, [least, most]: [f64; 2]| (least / MARGIN..=most * MARGIN).contains(&value);
        within(area_mm2, self.area_mm2) && within(pressure_kpa, self.pressure_kpa)
    }
}

/// Factor by which a range is extended at both ends: feet of one size differ, and the sizes of the walkers are not known.
const MARGIN: f64 = 1.3;

impl Parameters {
    /// Typical values for the size that the user has stated. Without one, those of the default size, and the subject states that
    /// this size is assumed.
    pub fn typical_for(stated: Option<InsoleSize>) -> Self {
        let mut parameters = Self::typical(stated.unwrap_or_default());
        if stated.is_none() {
            parameters.subject.push_str(" assumed");
        }
        parameters
    }

    /// Typical values for a size: lengths are proportional to the size, K, G, n and m are the same for all sizes.
    pub fn typical(size: InsoleSize) -> Self {
        let scale = size.scale();
        let regions = SIZE_42.map(|typical| {
            let [a_mm, b_mm, c_mm] = typical.radii_mm;
            let [stiffness_kpa, damping_kpa_s, n, m] = typical.law;
            let d0_m = typical.d0_mm * scale * 1e-3;
            let c_m = c_mm * scale * 1e-3;
            Ellipsoid {
                a_m: a_mm * scale * 1e-3,
                b_m: b_mm * scale * 1e-3,
                c_m,
                d0_m,
                // K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m, solved for k and c.
                k: stiffness_kpa * 1e3 * d0_m.powf(n) / c_m.powf(n + 1.0),
                n,
                c: damping_kpa_s * 1e3 * d0_m.powf(m) / c_m.powf(m + 1.0),
                m,
            }
        });
        Self {
            subject: format!("typical, size {size}"),
            personal: false,
            identified: None,
            regions,
            deformation: DeformationScale::ALL_ASSUMED,
        }
    }

    /// A note if, in a region with typical parameters, areas or pressures of the steps are outside of those from which these were
    /// determined, as with another sensor or in a shoe; otherwise `None`. `size` is that of the typical parameters.
    pub fn inapplicable_note(&self, size: InsoleSize, steps: &[Step]) -> Option<String> {
        let ranges = TypicalRange::of(size);
        let outside = self.typical_regions().into_iter().filter_map(|region| {
            let (i, range) = (region as usize, &ranges[region as usize]);
            let median = |of: fn(&StepRegion) -> f64| {
                let mut values: Vec<f64> = steps.iter().map(|step| of(&step.regions[i])).filter(|v| *v > 0.0).collect();
                values.sort_by(f64::total_cmp);
                values.get(values.len() / 2).copied()
            };
            let (area_mm2, force_n) = (median(StepRegion::area_peak_mm2)?, median(StepRegion::measured_force_peak_n)?);
            let pressure_kpa = force_n / area_mm2 * 1e3;
            let is_outside = !range.includes(area_mm2, pressure_kpa);
            is_outside.then(|| format!("{} ({area_mm2:.0} mm2, {pressure_kpa:.0} kPa)", region.name()))
        });
        let outside: Vec<String> = outside.collect();
        (!outside.is_empty()).then(|| {
            format!(
                "the typical parameters are NOT APPLICABLE to {}: area or mean pressure is outside of that of the barefoot steps \
                 from which they were determined, so model force and deformation are not valid there; identify the wearer with \
                 `plantar fit`",
                outside.join(", ")
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{InsoleSize, Parameters, TypicalRange};

    fn size(text: &str) -> Result<InsoleSize, String> {
        text.parse()
    }

    /// Lengths are proportional to the size, and areas to its square (docs/identification.md). The values of size 42 are those of
    /// the table there: a heel of 16 mm, 10 mm under metatarsals 3-5, 7 mm at the lesser toes.
    #[test]
    fn thickness_and_areas_at_both_ends_of_the_sizes_follow_from_those_of_size_42() {
        let of_42 = TypicalRange::of(InsoleSize::default());
        for number in [20u8, 52] {
            let size = size(&number.to_string()).expect("a size");
            let ratio = f64::from(number) / 42.0;
            let thickness_m = size.thickness_m();
            for (region, at_42_mm) in [(0, 16.0), (4, 10.0), (7, 7.0)] {
                assert!((thickness_m[region] - at_42_mm * 1e-3 * ratio).abs() < 1e-9, "{number}: {thickness_m:?}");
            }
            let parameters = Parameters::typical(size);
            assert_eq!(parameters.tissue().check(), Ok(()), "{number}");
            for (region, range) in TypicalRange::of(size).iter().enumerate() {
                let ([least, most], ellipsoid) = (range.area_mm2, &parameters.regions[region]);
                let expected = of_42[region].area_mm2.map(|mm2| mm2 * ratio * ratio);
                assert!((least - expected[0]).abs() < 1e-9 && (most - expected[1]).abs() < 1e-9, "{number}: {range:?}");
                assert!(0.0 < least && least < most && range.pressure_kpa == of_42[region].pressure_kpa, "{number}");
                // The largest area is part of the ellipse of the whole region.
                assert!(most < std::f64::consts::PI * ellipsoid.a_m * ellipsoid.b_m * 1e6, "{number}: {region}");
            }
        }
    }

    #[test]
    fn only_the_sizes_of_the_paper_have_no_note() {
        for number in 0..=60u8 {
            let note = size(&number.to_string()).map(InsoleSize::extrapolation_note);
            match number {
                35..=46 => assert_eq!(note, Ok(None), "{number}"),
                20..=52 => {
                    let note = note.expect("a size").expect("a note");
                    assert!(
                        note.starts_with(&format!("size {number} is outside")) && note.contains("35 to 46"),
                        "{note}"
                    );
                }
                _ => assert!(note.is_err_and(|problem| problem.contains("from 20 to 52")), "{number}"),
            }
        }
    }

    #[test]
    fn the_subject_states_that_a_size_is_assumed() {
        assert_eq!(Parameters::typical_for(None).subject, "typical, size 42 assumed");
        assert_eq!(Parameters::typical_for(size("42").ok()).subject, "typical, size 42");
        assert_eq!(Parameters::typical_for(None).tissue(), Parameters::typical(InsoleSize::default()).tissue());
    }
}
