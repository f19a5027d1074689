//! A sole to draw loads on: the outline of a generic insole, divided by the core's template.
//!
//! An insole does not say where its cells lie, so this is a picture of a foot and not of the wearer's.

use plantar::Region;
use plantar::pipeline::template::region_at;

/// Regions.
pub const REGION_COUNT: usize = Region::ALL.len();
/// Length of the sole, EU size 42.
pub const LENGTH_MM: f32 = 268.0;
/// Its width.
pub const WIDTH_MM: f32 = 96.0;
/// y and the medial and lateral edges there, mm; the sole of the computed walk.
const OUTLINE_MM: [[f32; 3]; 14] = [
    [0.0, 24.0, 52.0],
    [10.0, 13.0, 63.0],
    [30.0, 7.0, 70.0],
    [60.0, 8.0, 72.0],
    [100.0, 15.0, 77.0],
    [130.0, 16.0, 83.0],
    [160.0, 10.0, 90.0],
    [190.0, 2.0, 95.0],
    [205.0, 0.0, 96.0],
    [225.0, 1.0, 92.0],
    [245.0, 6.0, 82.0],
    [258.0, 13.0, 69.0],
    [266.0, 24.0, 53.0],
    [LENGTH_MM, 30.0, 46.0],
];
/// Where the template's width is taken at heel and forefoot: y and the edges, mm.
const HEEL_MM: [f32; 3] = [40.2, 7.0, 71.7];
const FOREFOOT_MM: [f32; 3] = [184.9, 0.0, 96.0];
/// Rows and the points along them that are asked for their region.
const ROW_MM: f32 = 2.0;
const POINT_MM: f32 = 0.5;

/// One region of the sole, mm in foot coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegionShape {
    /// A closed polygon.
    pub outline_mm: Vec<[f32; 2]>,
    /// Its centroid.
    pub centre_mm: [f32; 2],
}

/// The sole's outline, a closed polygon.
pub fn outline_mm() -> Vec<[f32; 2]> {
    let medial = OUTLINE_MM.iter().map(|[y, medial, _]| [*medial, *y]);
    let lateral = OUTLINE_MM.iter().rev().map(|[y, _, lateral]| [*lateral, *y]);
    medial.chain(lateral).collect()
}

/// The regions, in the order of [`Region::ALL`].
pub fn region_shapes() -> [RegionShape; REGION_COUNT] {
    let mut rows: [Vec<Row>; REGION_COUNT] = Default::default();
    let count = (LENGTH_MM / ROW_MM) as usize;
    for y_mm in (0..count).map(|k| (k as f32 + 0.5) * ROW_MM) {
        let [medial_mm, lateral_mm] = edges_mm(y_mm);
        let points = ((lateral_mm - medial_mm) / POINT_MM).ceil() as usize;
        for point in 0..points {
            let from_mm = medial_mm + point as f32 * POINT_MM;
            let to_mm = (from_mm + POINT_MM).min(lateral_mm);
            let rows = &mut rows[region_of((from_mm + to_mm) / 2.0, y_mm) as usize];
            match rows.last_mut() {
                // A region is one piece in every row.
                Some(row) if row.y_mm == y_mm => row.to_mm = to_mm,
                _ => rows.push(Row { y_mm, from_mm, to_mm }),
            }
        }
    }
    rows.map(|rows| shape(&rows))
}

/// The part of a region at one y.
struct Row {
    y_mm: f32,
    from_mm: f32,
    to_mm: f32,
}

fn shape(rows: &[Row]) -> RegionShape {
    // Through the middles of the rows, so that slanting boundaries are lines and no stairs; level ones meet half a row further.
    let end = |row: Option<&Row>, dy_mm: f32| row.map(|row| Row { y_mm: row.y_mm + dy_mm, ..*row });
    let low = end(rows.first(), -ROW_MM / 2.0);
    let high = end(rows.last(), ROW_MM / 2.0);
    let line: Vec<&Row> = low.iter().chain(rows).chain(&high).collect();
    let medial = line.iter().map(|row| [row.from_mm, row.y_mm]);
    let lateral = line.iter().rev().map(|row| [row.to_mm, row.y_mm]);
    let mean = |of: &dyn Fn(&Row) -> f32| {
        let width = |row: &Row| row.to_mm - row.from_mm;
        rows.iter().map(|row| of(row) * width(row)).sum::<f32>() / rows.iter().map(width).sum::<f32>()
    };
    RegionShape {
        outline_mm: medial.chain(lateral).collect(),
        centre_mm: [mean(&|row| (row.from_mm + row.to_mm) / 2.0), mean(&|row| row.y_mm)],
    }
}

/// The region at a place on the sole.
fn region_of(x_mm: f32, y_mm: f32) -> Region {
    let along = (y_mm - HEEL_MM[0]) / (FOREFOOT_MM[0] - HEEL_MM[0]);
    let edge = |i: usize, along: f32| HEEL_MM[i] + (FOREFOOT_MM[i] - HEEL_MM[i]) * along;
    let centre_mm = (edge(1, along) + edge(2, along)) / 2.0;
    let wide = along.clamp(0.0, 1.0);
    let width_mm = edge(2, wide) - edge(1, wide);
    region_at((x_mm - centre_mm) / width_mm + 0.5, y_mm / LENGTH_MM)
}

/// The medial and lateral edge at `y_mm`, which lies on the sole.
fn edges_mm(y_mm: f32) -> [f32; 2] {
    let after = OUTLINE_MM.partition_point(|[y, ..]| *y <= y_mm).clamp(1, OUTLINE_MM.len() - 1);
    let ([y0, medial0, lateral0], [y1, medial1, lateral1]) = (OUTLINE_MM[after - 1], OUTLINE_MM[after]);
    let share = (y_mm - y0) / (y1 - y0);
    [medial0 + (medial1 - medial0) * share, lateral0 + (lateral1 - lateral0) * share]
}
