//! Measurements of the tissue of a person, by ultrasound, fluoroscopy or a foot scan.

use crate::{Error, line_of, message, region_names};
use plantar::Region;
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Accepted thickness of the unloaded tissue under a foot, mm.
const THICKNESS_MM: [f64; 2] = [2.0, 40.0];
/// Accepted peak strain: largest deformation divided by thickness.
const PEAK_STRAIN: [f64; 2] = [0.05, 0.95];
/// Accepted radius of curvature of the unloaded sole, mm.
const CURVATURE_MM: [f64; 2] = [5.0, 500.0];

/// The measurements of one region. A value that is out of range is not adopted, but listed in [`Measurements::rejected`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurements {
    /// Thickness of the unloaded tissue, m.
    pub thickness_m: Option<f64>,
    /// Largest deformation in walking, divided by the thickness.
    pub peak_strain: Option<f64>,
    /// Radii of curvature of the unloaded sole, m: in the medial-lateral and in the heel-toe direction.
    pub curvature_m: [Option<f64>; 2],
    /// The values that were not adopted.
    pub rejected: Vec<OutOfRange>,
}

/// A value that is not in the accepted range.
#[derive(Clone, Debug, PartialEq)]
pub struct OutOfRange {
    /// Name of the entry, with its unit.
    name: &'static str,
    value: f64,
    range: [f64; 2],
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, value, range: [least, most] } = self;
        write!(
            f,
            "{name} = {value} is out of range and was not used: expected {least} to {most}; correct the value in the file of \
             tissue measurements, or remove it"
        )
    }
}

/// The measurements of some or all regions, from a TOML file. The array is in the order of [`Region::ALL`]; the file may have any
/// order. In the file, a region has either a line with the thickness in mm, such as `heel = 17.5`, or a table:
///
/// ```toml
/// [heel]
/// thickness_mm = 17.5     # of the unloaded tissue, 2 to 40
/// peak_strain = 0.45      # largest deformation divided by the thickness, 0.05 to 0.95
/// curvature_mm = [35, 60] # radii of the unloaded sole, medial-lateral and heel-toe, 5 to 500
/// ```
///
/// All entries are optional. If only one radius is known, the entry is `curvature_mm = { medial_lateral = 35 }` or
/// `curvature_mm = { heel_toe = 60 }`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TissueMeasurements(pub [Measurements; 8]);

impl TissueMeasurements {
    /// Reads a file.
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML of this form, or names an unknown region. A value out of range is no error: see
    /// [`Measurements::rejected`].
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::Io(path.into(), e))?;
        Self::parse(&text, path)
    }

    /// As [`TissueMeasurements::read`], from text; messages name `path`.
    ///
    /// # Errors
    /// As [`TissueMeasurements::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let form = |problem: String| Error::Form { file: path.into(), problem };
        let entries: BTreeMap<String, toml::Spanned<Entry>> = toml::from_str(text).map_err(|e| form(message(&e)))?;
        let mut all = Self::default();
        for (name, entry) in entries {
            let Some(region) = Region::from_name(&name) else {
                let line = line_of(text, entry.span().start);
                return Err(form(format!(
                    "line {line}: {} is not a region; the regions are {}",
                    name.escape_debug(),
                    region_names()
                )));
            };
            all.0[region as usize] = entry.into_inner().0.checked();
        }
        Ok(all)
    }
}

/// The table of a region.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    thickness_mm: Option<f64>,
    peak_strain: Option<f64>,
    curvature_mm: Option<Radii>,
}

impl Table {
    fn checked(self) -> Measurements {
        let mut rejected = Vec::new();
        let mut in_range = |name, value: Option<f64>, range: [f64; 2]| {
            let value = value?;
            let is_valid = (range[0]..=range[1]).contains(&value);
            if !is_valid {
                rejected.push(OutOfRange { name, value, range });
            }
            is_valid.then_some(value)
        };
        let radii = self.curvature_mm.unwrap_or_default();
        let thickness_mm = in_range("thickness_mm", self.thickness_mm, THICKNESS_MM);
        let peak_strain = in_range("peak_strain", self.peak_strain, PEAK_STRAIN);
        let medial_lateral_mm = in_range("curvature_mm (medial-lateral)", radii.medial_lateral, CURVATURE_MM);
        let heel_toe_mm = in_range("curvature_mm (heel-toe)", radii.heel_toe, CURVATURE_MM);
        Measurements {
            thickness_m: thickness_mm.map(|mm| mm * 1e-3),
            peak_strain,
            curvature_m: [medial_lateral_mm, heel_toe_mm].map(|mm| mm.map(|mm| mm * 1e-3)),
            rejected,
        }
    }
}

/// The entry of a region: a thickness or a table.
struct Entry(Table);

impl<'de> Deserialize<'de> for Entry {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct ThicknessOrTable;
        impl<'de> Visitor<'de> for ThicknessOrTable {
            type Value = Table;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a thickness in mm, or a table with any of thickness_mm, peak_strain and curvature_mm")
            }

            fn visit_i64<E: de::Error>(self, mm: i64) -> Result<Table, E> {
                self.visit_f64(mm as f64)
            }

            fn visit_f64<E: de::Error>(self, mm: f64) -> Result<Table, E> {
                Ok(Table { thickness_mm: Some(mm), ..Table::default() })
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Table, A::Error> {
                Table::deserialize(MapAccessDeserializer::new(map))
            }
        }
        from.deserialize_any(ThicknessOrTable).map(Self)
    }
}

/// The radii of curvature, mm.
#[derive(Default)]
struct Radii {
    medial_lateral: Option<f64>,
    heel_toe: Option<f64>,
}

impl<'de> Deserialize<'de> for Radii {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Named {
            medial_lateral: Option<f64>,
            heel_toe: Option<f64>,
        }
        #[derive(Deserialize)]
        #[serde(
            untagged,
            expecting = "expected two radii in mm, [medial-lateral, heel-toe], or one of them as \
            { medial_lateral = mm } or { heel_toe = mm }"
        )]
        enum Form {
            Both([f64; 2]),
            Named(Named),
        }
        Ok(match Form::deserialize(from)? {
            Form::Both([medial_lateral, heel_toe]) => {
                Self { medial_lateral: Some(medial_lateral), heel_toe: Some(heel_toe) }
            }
            Form::Named(Named { medial_lateral, heel_toe }) => Self { medial_lateral, heel_toe },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<TissueMeasurements, String> {
        TissueMeasurements::parse(text, Path::new("tissue.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn a_line_and_a_table_are_read() {
        let all = parse(
            "heel = 17.5\ntoe_2 = 6\n[hallux]\nthickness_mm = 11\npeak_strain = 0.4\n\
             [metatarsals_12]\ncurvature_mm = [35, 60]\n[metatarsals_35]\ncurvature_mm = { heel_toe = 50.0 }\n",
        );
        let TissueMeasurements(all) = all.expect("a valid form");
        assert_eq!(all[Region::Heel as usize].thickness_m, Some(0.0175));
        assert_eq!(all[Region::Toe2 as usize].thickness_m, Some(0.006));
        let hallux = &all[Region::Hallux as usize];
        assert_eq!((hallux.thickness_m, hallux.peak_strain), (Some(0.011), Some(0.4)));
        assert_eq!(all[Region::Metatarsals12 as usize].curvature_m, [Some(0.035), Some(0.06)]);
        assert_eq!(all[Region::Metatarsals35 as usize].curvature_m, [None, Some(0.05)]);
        assert!(all.iter().all(|region| region.rejected.is_empty()));
        assert_eq!(all[Region::AnteriorMidfoot as usize], Measurements::default());
    }

    #[test]
    fn values_out_of_range_are_rejected_one_by_one() {
        let TissueMeasurements(all) =
            parse("heel = 1.9\n[hallux]\nthickness_mm = 40\npeak_strain = 0.96\ncurvature_mm = [4.9, 500]\n")
                .expect("a valid form");
        assert_eq!((all[0].thickness_m, all[0].rejected.len()), (None, 1));
        let hallux = &all[Region::Hallux as usize];
        assert_eq!((hallux.thickness_m, hallux.peak_strain), (Some(0.04), None));
        assert_eq!(hallux.curvature_m, [None, Some(0.5)]);
        let messages: Vec<_> = hallux.rejected.iter().map(ToString::to_string).collect();
        assert!(messages[0].contains("peak_strain = 0.96") && messages[0].contains("0.05 to 0.95"), "{messages:?}");
        assert!(messages[1].contains("medial-lateral) = 4.9") && messages[1].contains("5 to 500"), "{messages:?}");
        assert!(parse("heel = nan\n").expect("a valid form").0[0].thickness_m.is_none());
    }

    #[test]
    fn files_of_another_form_are_refused_with_the_place() {
        for (text, words) in [
            ("heel = 9\nheal = 12\n", ["line 2: heal is not a region", "heel"]),
            ("heel = \"thick\"\n", ["line 1", "a thickness in mm"]),
            ("[heel]\nstrain = 0.4\n", ["line 2", "peak_strain"]),
            ("[heel]\ncurvature_mm = 35\n", ["line 2", "medial_lateral"]),
            ("[heel]\ncurvature_mm = [1, 2, 3]\n", ["line 2", "two radii"]),
        ] {
            let problem = parse(text).expect_err("refused");
            words.iter().for_each(|word| assert!(problem.contains(word), "{text}: no {word} in {problem}"));
        }
    }
}
