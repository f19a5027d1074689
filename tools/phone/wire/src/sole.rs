//! The sole on which the page draws loads. It is [`GENERIC_SOLE`], which the library's template divides into regions.
//!
//! An insole does not report the positions of its cells, so the page shows a generic foot instead of the wearer's foot.

use plantar::Region;
use plantar::pipeline::outline::GENERIC_SOLE;
use plantar::pipeline::template::region_at;

/// Number of regions.
pub const REGION_COUNT: usize = Region::ALL.len();
/// Length of the sole, which has EU size 42.
pub const LENGTH_MM: f32 = GENERIC_SOLE.length_mm() as f32;
/// Width of the sole.
pub const WIDTH_MM: f32 = GENERIC_SOLE.width_mm() as f32;

/// The y, the medial edge and the lateral edge of the heel and of the forefoot, mm. Between heel and forefoot, the edges of the
/// foot are interpolated for the template.
const HEEL_MM: [f32; 3] = [40.2, 7.0, 71.7];
/// See [`HEEL_MM`].
const FOREFOOT_MM: [f32; 3] = [184.9, 0.0, 96.0];
/// Number of points on each arc of the outline.
const ARC_POINTS: usize = 4;
/// Gap between the shapes of neighbouring regions. Half of the gap separates a shape from the outline of the sole. The background
/// is visible in the gap, so that no boundaries have to be drawn.
const GAP_MM: f32 = 0.9;
/// Distance between the rows from which the shape of a region is built.
const ROW_MM: f32 = GAP_MM / 2.0;
/// Distance between the points of a row. The template is evaluated at these points.
const POINT_MM: f32 = 0.25;
/// A point of a polygon that is nearer than this to the line between its neighbours is removed.
const TOLERANCE_MM: f32 = 0.1;

/// One region of the sole, mm in foot coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegionShape {
    /// A closed polygon.
    pub outline_mm: Vec<[f32; 2]>,
    /// The centroid of the polygon.
    pub centre_mm: [f32; 2],
}

/// The outline of the sole: a closed polygon with rounded corners. Each corner is replaced by a parabola from the middle of one
/// edge to the middle of the next edge.
pub fn outline_mm() -> Vec<[f32; 2]> {
    let medial = GENERIC_SOLE.rows_mm.iter().map(|&[y, medial, _]| [medial as f32, y as f32]);
    let lateral = GENERIC_SOLE.rows_mm.iter().rev().map(|&[y, _, lateral]| [lateral as f32, y as f32]);
    let corners: Vec<_> = medial.chain(lateral).collect();
    let middle = |a: [f32; 2], b: [f32; 2]| [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
    let corner = |i: usize| corners[i % corners.len()];
    let arc = |i: usize| {
        let [from, over, to] = [middle(corner(i), corner(i + 1)), corner(i + 1), middle(corner(i + 1), corner(i + 2))];
        (0..ARC_POINTS).map(move |k| {
            let t = k as f32 / ARC_POINTS as f32;
            [0, 1].map(|axis| {
                let (a, b, c) = (from[axis], over[axis], to[axis]);
                a * (1.0 - t) * (1.0 - t) + 2.0 * b * t * (1.0 - t) + c * t * t
            })
        })
    };
    (0..corners.len()).flat_map(arc).collect()
}

/// The regions, in the order of [`Region::ALL`].
pub fn region_shapes() -> [RegionShape; REGION_COUNT] {
    let outline = outline_mm();
    let mut rows: [Vec<Row>; REGION_COUNT] = Default::default();
    let count = (LENGTH_MM / ROW_MM) as usize;
    for y_mm in (0..count).map(|k| (k as f32 + 0.5) * ROW_MM) {
        let [medial_mm, lateral_mm] = edges_mm(&outline, y_mm);
        let points = ((lateral_mm - medial_mm) / POINT_MM).ceil() as usize;
        for point in 0..points {
            let from_mm = medial_mm + point as f32 * POINT_MM;
            let to_mm = (from_mm + POINT_MM).min(lateral_mm);
            let rows = &mut rows[region_of((from_mm + to_mm) / 2.0, y_mm) as usize];
            match rows.last_mut() {
                // A region is contiguous in every row.
                Some(row) if row.y_mm == y_mm => row.to_mm = to_mm,
                _ => rows.push(Row { y_mm, from_mm, to_mm }),
            }
        }
    }
    rows.map(|rows| shape(&shrink(&rows)))
}

/// The part of a region at one y: the interval of x from `from_mm` to `to_mm`.
struct Row {
    y_mm: f32,
    from_mm: f32,
    to_mm: f32,
}

/// Returns the rows shortened by half of the gap at each boundary. At a slanted boundary, a row also ends where the row before or
/// after it ends; these rows are half of the gap away.
fn shrink(rows: &[Row]) -> Vec<Row> {
    let rows = rows.windows(3).map(|rows| Row {
        y_mm: rows[1].y_mm,
        from_mm: rows[0].from_mm.max(rows[1].from_mm + GAP_MM / 2.0).max(rows[2].from_mm),
        to_mm: rows[0].to_mm.min(rows[1].to_mm - GAP_MM / 2.0).min(rows[2].to_mm),
    });
    rows.filter(|row| row.from_mm < row.to_mm).collect()
}

/// The shape that consists of these rows.
fn shape(rows: &[Row]) -> RegionShape {
    let medial: Vec<_> = rows.iter().map(|row| [row.from_mm, row.y_mm]).collect();
    let lateral: Vec<_> = rows.iter().rev().map(|row| [row.to_mm, row.y_mm]).collect();
    let mean = |of: &dyn Fn(&Row) -> f32| {
        let width = |row: &Row| row.to_mm - row.from_mm;
        rows.iter().map(|row| of(row) * width(row)).sum::<f32>() / rows.iter().map(width).sum::<f32>()
    };
    RegionShape {
        outline_mm: [simplified(&medial), simplified(&lateral)].concat(),
        centre_mm: [mean(&|row| (row.from_mm + row.to_mm) / 2.0), mean(&|row| row.y_mm)],
    }
}

/// Removes points from a polyline by the algorithm of Ramer, Douglas and Peucker: points that are near the straight line from the
/// first to the last point are removed. If a point is farther away, the line is divided there, and both parts are simplified.
fn simplified(line: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let (Some(&[x0, y0]), Some(&[x1, y1])) = (line.first(), line.last()) else { return Vec::new() };
    let length = (x1 - x0).hypot(y1 - y0);
    let distance = |&[x, y]: &[f32; 2]| ((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)).abs() / length;
    let distances = line.iter().map(distance).enumerate();
    let (farthest, distance) =
        distances.fold((0, 0.0), |largest, next| if next.1 > largest.1 { next } else { largest });
    if distance < TOLERANCE_MM {
        return vec![[x0, y0], [x1, y1]];
    }
    let mut points = simplified(&line[..=farthest]);
    points.pop();
    points.extend(simplified(&line[farthest..]));
    points
}

/// The region at a point of the sole.
fn region_of(x_mm: f32, y_mm: f32) -> Region {
    let along = (y_mm - HEEL_MM[0]) / (FOREFOOT_MM[0] - HEEL_MM[0]);
    let edge = |i: usize, along: f32| HEEL_MM[i] + (FOREFOOT_MM[i] - HEEL_MM[i]) * along;
    let centre_mm = (edge(1, along) + edge(2, along)) / 2.0;
    let wide = along.clamp(0.0, 1.0);
    let width_mm = edge(2, wide) - edge(1, wide);
    region_at((x_mm - centre_mm) / width_mm + 0.5, y_mm / LENGTH_MM)
}

/// The x of the medial edge and the x of the lateral edge of an outline at `y_mm`, which must be within the length of the sole.
fn edges_mm(outline: &[[f32; 2]], y_mm: f32) -> [f32; 2] {
    let next = outline.iter().cycle().skip(1);
    let crossings = outline.iter().zip(next).filter(|(a, b)| (a[1] > y_mm) != (b[1] > y_mm));
    let x_mm = crossings.map(|(a, b)| a[0] + (y_mm - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    x_mm.fold([WIDTH_MM, 0.0], |[medial, lateral], x_mm| [medial.min(x_mm), lateral.max(x_mm)])
}
