//! Whether recordings are of one measurement, or of one sensor, by the texts on their origins and the names of their layouts.

use crate::Layout;
use crate::export::{ONE_CONTACT, time_of};

/// The part of the text on the origin of a recording that names the system and the file. An import writes it first, up to a
/// comma or the end of a sentence.
fn measurement(source: &str) -> &str {
    let named = source.split(',').next().unwrap_or_default();
    named.split(". ").next().unwrap_or_default().trim_end_matches('.')
}

/// True if two texts, up to a comma or the end of a sentence, differ at most in the words left and right, and in the letters L
/// and R. Two recordings with such texts on their origins are of the same measurement, for example those of the files
/// `FrasP01L_m.asf` and `FrasP01R_m.asf`.
fn is_same_but_for_the_foot(first: &str, second: &str) -> bool {
    let [first, second] = [first, second].map(|text| {
        let named = measurement(text).to_lowercase();
        named.replace("left", "l").replace("right", "r")
    });
    let is_foot = |letter| letter == 'l' || letter == 'r';
    first.chars().count() == second.chars().count()
        && first.chars().zip(second.chars()).all(|(a, b)| a == b || is_foot(a) && is_foot(b))
}

/// A note if the texts on the origins of the recordings of two feet name different measurements, state different times of
/// measurement, or are of single contacts on a plate; otherwise `None`.
pub fn note_unless_same_walk(first: &str, second: &str) -> Option<String> {
    let [first_named, second_named] = [first, second].map(measurement);
    if [first, second].iter().any(|source| source.contains(ONE_CONTACT)) {
        Some(format!(
            "the recordings ({first_named:?} and {second_named:?}) are not on one clock, because an export of a single contact \
             has times of its own: measures that compare the times of both feet, such as double support, are not valid"
        ))
    } else if !is_same_but_for_the_foot(first, second) {
        Some(format!(
            "the recordings have different origins ({first_named:?} and {second_named:?}): measures of both feet, such as \
             double support and symmetry, are valid only if both feet were recorded in the same walk, on one clock"
        ))
    } else {
        let (first, second) = (time_of(first)?, time_of(second)?);
        (first != second).then(|| {
            format!(
                "the recordings were measured at different times ({first:?} and {second:?}): measures of both feet, such as \
                 double support and symmetry, are valid only if both feet were recorded in the same walk, on one clock"
            )
        })
    }
}

/// A note if recordings, given by name and layout, are of different sensors, or have cells of different sizes; otherwise `None`.
/// `values` are the values that are compared or fitted, and `verb` states which of both.
pub fn note_unless_same_sensor<'r>(
    mut recordings: impl Iterator<Item = (&'r str, &'r Layout)>,
    values: &str,
    verb: &str,
) -> Option<String> {
    let first = recordings.next()?;
    let other = recordings.find(|(_, layout)| !is_same_sensor(first.1, layout))?;
    let sensor =
        |(name, layout): (&str, &Layout)| format!("{}, {:.0} mm2 per cell, in {name}", layout.name, mean_mm2(layout));
    Some(format!(
        "the recordings are of different sensors, or have cells of different sizes ({}; {}): areas and forces depend on \
         the sensor and the size of its cells, so that these differences count as differences between the {values}: import the \
         recordings with the same --cells, or {verb} those of each sensor separately",
        sensor(first),
        sensor(other)
    ))
}

/// Cells of two sensors differ in size if their mean areas differ by more than this factor. Cells of a plate that an import
/// merged differ somewhat from footprint to footprint.
const SAME_SIZE: f64 = 1.25;

/// Mean area of the cells of a layout, mm2.
fn mean_mm2(layout: &Layout) -> f64 {
    layout.cells.iter().map(|cell| cell.area_mm2).sum::<f64>() / layout.cells.len() as f64
}

/// True if the names of two layouts, each up to its first comma, differ at most in the words or letters for left and right, and
/// their cells are of about the same size.
fn is_same_sensor(first: &Layout, second: &Layout) -> bool {
    let ratio = mean_mm2(first) / mean_mm2(second);
    is_same_but_for_the_foot(&first.name, &second.name) && (1.0 / SAME_SIZE..=SAME_SIZE).contains(&ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cell;
    use plantar::Region;

    #[test]
    fn files_of_one_measurement_differ_in_the_foot_only() {
        for (left, right, is_same) in [
            ("pedar measurement a.asc, left insole, geometry g.", "pedar measurement a.asc, right insole.", true),
            ("Tekscan measurement P01L_m.asf, by template.", "Tekscan measurement P01R_m.asf, by template.", true),
            (
                "CSV import of left.csv with the layout left.json.",
                "CSV import of right.csv with the layout right.json.",
                true,
            ),
            (
                "Walk Ga1_01 of PhysioNet's database gaitpdb, left foot",
                "Walk Ga1_02 of PhysioNet's database gaitpdb, right foot",
                false,
            ),
            ("pedar measurement ann.asc, left insole.", "pedar measurement bob.asc, right insole.", false),
            ("Tekscan measurement walk.asf, by template.", "pedar measurement walk.asc, right insole.", false),
            // Only the first recording has a remark of the import.
            (
                "CSV import of left.csv with the layout left.csv. The largest force is 99.0 N.",
                "CSV import of right.csv with the layout right.csv.",
                true,
            ),
            ("", "", true),
        ] {
            assert_eq!(is_same_but_for_the_foot(left, right), is_same, "{left} {right}");
        }
    }

    #[test]
    fn sensors_differ_in_the_name_or_in_the_size_of_the_cells() {
        let layout = |name: &str, cells: usize, area_mm2: f64| {
            let cell = |i: usize| Cell { x_mm: i as f64, y_mm: 0.0, area_mm2, region: Region::Heel };
            Layout { name: name.into(), cells: (0..cells).map(cell).collect(), sheet: None }
        };
        let left = layout("Tekscan FSCAN, 60 x 21 cells", 471, 25.8);
        for (other, is_same) in [
            (layout("Tekscan FSCAN, 60 x 21 cells", 554, 25.8), true),
            (layout("Tekscan FSCAN, 30 x 11 cells", 120, 103.2), false),
            (layout("emed plate", 506, 25.0), false),
        ] {
            assert_eq!(is_same_sensor(&left, &other), is_same, "{}", other.name);
        }
        assert!(is_same_sensor(&layout("sole_left", 9, 100.0), &layout("sole_right", 9, 100.0)));
    }
}
