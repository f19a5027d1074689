//! The sole on which the page draws loads: the outline of the insole's own cells, divided into the regions of the cells. Until
//! the page has read the cells, it is [`GENERIC_SOLE`], which the library's template divides into regions.

use plantar::Region;
use plantar::pipeline::outline::GENERIC_SOLE;
use plantar::pipeline::template::region_at;
use serde::{Deserialize, Serialize};

/// Number of regions.
const REGION_COUNT: usize = Region::ALL.len();
/// Length of the generic sole, which has EU size 42.
const LENGTH_MM: f32 = GENERIC_SOLE.length_mm() as f32;

/// The heel of the generic sole, mm: y, at 15 % of its length, and x of the medial and of the lateral limit of the width.
/// The width of the foot for the template follows straight lines from the limits of the heel to those of the forefoot, not the
/// narrower edges of the midfoot.
const HEEL_MM: [f32; 3] = [40.2, 7.0, 71.7];
/// The forefoot of the generic sole, at 69 % of its length. See [`HEEL_MM`].
const FOREFOOT_MM: [f32; 3] = [184.9, 0.0, 96.0];
/// Number of points on each arc of the generic outline.
const ARC_POINTS: usize = 4;
/// Gap between the shapes of neighbouring regions. Half of the gap separates a shape from the outline of the sole. The background
/// is visible in the gap, so that no boundaries have to be drawn.
const GAP_MM: f32 = 0.9;
/// Distance between the rows from which the shape of a region is built.
const ROW_MM: f32 = GAP_MM / 2.0;
/// Distance between the points of a row. The region is determined at these points.
const POINT_MM: f32 = 0.25;
/// A point of a polygon that is nearer than this to the line between its neighbours is removed.
const TOLERANCE_MM: f32 = 0.1;
/// Width of the rim of an insole around its cells. Contact ellipses extend beyond the cells in contact: the ellipse with the
/// second moments of a square is 15 % wider than the square.
const RIM_MM: f32 = 7.0;
/// Largest radius of the notches between cells that the outline bridges.
const NOTCH_MM: f32 = 80.0;
/// Cells with edges that are farther than this from a row are ignored for the points of the row: a foot always has nearer cells.
const REACH_MM: f32 = 40.0;

/// A sole in foot coordinates, mm: x to the lateral side, y from heel to toes.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct Sole {
    /// Smallest x and y of the outline.
    pub from_mm: [f32; 2],
    /// Largest x and y of the outline.
    pub to_mm: [f32; 2],
    /// A closed polygon.
    pub outline_mm: Vec<[f32; 2]>,
    /// The regions, in the order of `Facts.regions`.
    pub regions: Vec<RegionShape>,
}

/// The part of a sole in one region, mm; empty for a region without cells.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct RegionShape {
    /// A closed polygon.
    pub outline_mm: Vec<[f32; 2]>,
    /// The centroid of the polygon.
    pub centre_mm: [f32; 2],
}

/// A cell of the insole's layout. For the shape of the sole, it is a square with this area.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(ts_rs::TS))]
pub struct LayoutCell {
    /// Index of the region.
    pub region: usize,
    /// x of the centre, mm.
    pub x_mm: f32,
    /// y of the centre, mm.
    pub y_mm: f32,
    /// Area, mm2.
    pub area_mm2: f32,
}

impl LayoutCell {
    /// Half of the edge of the square.
    fn half_mm(&self) -> f32 {
        self.area_mm2.sqrt() / 2.0
    }
}

impl Sole {
    /// The sole within `outline_mm`, divided by `region_of`, which returns the index of the region of a point.
    fn new(outline_mm: Vec<[f32; 2]>, mut region_of: impl FnMut(f32, f32) -> usize) -> Self {
        let fold = |start: f32, of: fn(f32, f32) -> f32| {
            [0, 1].map(|axis| outline_mm.iter().map(|point| point[axis]).fold(start, of))
        };
        let (from_mm, to_mm) = (fold(f32::INFINITY, f32::min), fold(f32::NEG_INFINITY, f32::max));
        let mut rows: [Vec<Row>; REGION_COUNT] = Default::default();
        let count = ((to_mm[1] - from_mm[1]) / ROW_MM) as usize;
        for y_mm in (0..count).map(|k| from_mm[1] + (k as f32 + 0.5) * ROW_MM) {
            let [medial_mm, lateral_mm] = edges_mm(&outline_mm, y_mm);
            let points = ((lateral_mm - medial_mm) / POINT_MM).ceil() as usize;
            for point in 0..points {
                let from_mm = medial_mm + point as f32 * POINT_MM;
                let to_mm = (from_mm + POINT_MM).min(lateral_mm);
                let Some(rows) = rows.get_mut(region_of((from_mm + to_mm) / 2.0, y_mm)) else { continue };
                match rows.last_mut() {
                    // A region is taken for contiguous in every row, so its shape also covers a gap.
                    Some(row) if row.y_mm == y_mm => row.to_mm = to_mm,
                    _ => rows.push(Row { y_mm, from_mm, to_mm }),
                }
            }
        }
        let regions = rows.iter().map(|rows| shape(&shrink(rows))).collect();
        Self { from_mm, to_mm, outline_mm, regions }
    }

    /// The generic sole.
    pub fn generic() -> Self {
        Self::new(generic_outline_mm(), |x_mm, y_mm| generic_region(x_mm, y_mm) as usize)
    }

    /// The sole of an insole with these cells; `None` without cells, or if a cell is 1 m or more from an axis, or has no area or
    /// one of 100 cm² or more.
    pub fn of(cells: &[LayoutCell]) -> Option<Self> {
        let is_valid = |cell: &LayoutCell| {
            cell.x_mm.abs() < 1e3 && cell.y_mm.abs() < 1e3 && cell.area_mm2 > 0.0 && cell.area_mm2 < 1e4
        };
        if cells.is_empty() || !cells.iter().all(is_valid) {
            return None;
        }
        let (mut row_mm, mut near) = (f32::NAN, Vec::new());
        let nearest_region = |x_mm: f32, y_mm: f32| {
            // NaN differs from every y, so the first point begins a row.
            if row_mm != y_mm {
                row_mm = y_mm;
                near.clear();
                near.extend(cells.iter().filter(|cell| (cell.y_mm - y_mm).abs() < REACH_MM + cell.half_mm()));
            }
            // The power distance, so that large cells reach farther than small ones.
            let distance =
                |cell: &LayoutCell| (cell.x_mm - x_mm).powi(2) + (cell.y_mm - y_mm).powi(2) - cell.half_mm().powi(2);
            let nearest_cell = near.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            nearest_cell.map_or(REGION_COUNT, |cell| cell.region)
        };
        Some(Self::new(outline_mm(cells), nearest_region))
    }
}

/// The outline of an insole: all points that are at most [`RIM_MM`] from its cells. Notches into which a disc with the radius
/// [`NOTCH_MM`] does not fit are filled: the cells are widened by this radius, and the result is narrowed by it minus the rim.
fn outline_mm(cells: &[LayoutCell]) -> Vec<[f32; 2]> {
    let end = |of: fn(f32, f32) -> f32, sign: f32| {
        let ends = cells.iter().map(|cell| cell.y_mm + sign * cell.half_mm());
        ends.fold(-sign * f32::INFINITY, of) + sign * (NOTCH_MM + 1.0)
    };
    let (first_mm, last_mm) = (end(f32::min, -1.0), end(f32::max, 1.0));
    // The rows are 1 mm apart.
    let rows: Vec<_> = (0..=(last_mm - first_mm) as usize).map(|k| first_mm + k as f32).collect();
    // The half width of a disc of this radius at the distance `dy_mm` from its centre; NaN beyond the disc.
    let chord_mm = |radius_mm: f32, dy_mm: f32| (radius_mm.powi(2) - dy_mm.powi(2)).sqrt();
    let widened = rows.iter().map(|&y_mm| {
        cells.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[medial, lateral], cell| {
            let dy_mm = ((cell.y_mm - y_mm).abs() - cell.half_mm()).max(0.0);
            let reach_mm = cell.half_mm() + chord_mm(NOTCH_MM, dy_mm);
            // `min` and `max` ignore NaN.
            [medial.min(cell.x_mm - reach_mm), lateral.max(cell.x_mm + reach_mm)]
        })
    });
    let widened: Vec<_> = widened.collect();
    let radius_mm = NOTCH_MM - RIM_MM;
    // The number of rows within the radius.
    let span = radius_mm as usize;
    let narrowed = (span..rows.len() - span).filter_map(|k| {
        let edges = (k - span..=k + span).map(|other| {
            let chord_mm = chord_mm(radius_mm, rows[other] - rows[k]);
            [widened[other][0] + chord_mm, widened[other][1] - chord_mm]
        });
        let edges = edges.reduce(|a, b| [a[0].max(b[0]), a[1].min(b[1])])?;
        (edges[0] < edges[1]).then_some((rows[k], edges))
    });
    let narrowed: Vec<_> = narrowed.collect();
    let medial: Vec<_> = narrowed.iter().map(|&(y_mm, [medial_mm, _])| [medial_mm, y_mm]).collect();
    let lateral: Vec<_> = narrowed.iter().rev().map(|&(y_mm, [_, lateral_mm])| [lateral_mm, y_mm]).collect();
    [simplified(&medial), simplified(&lateral)].concat()
}

/// The outline of the generic sole: a closed polygon with rounded corners. Each corner is replaced by a parabola from the middle
/// of one edge to the middle of the next edge.
fn generic_outline_mm() -> Vec<[f32; 2]> {
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
    if rows.is_empty() {
        return RegionShape::default();
    }
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

/// The region at a point of the generic sole.
fn generic_region(x_mm: f32, y_mm: f32) -> Region {
    let along = (y_mm - HEEL_MM[0]) / (FOREFOOT_MM[0] - HEEL_MM[0]);
    let edge = |i: usize, along: f32| HEEL_MM[i] + (FOREFOOT_MM[i] - HEEL_MM[i]) * along;
    let centre_mm = (edge(1, along) + edge(2, along)) / 2.0;
    // Behind the y of the heel and beyond that of the forefoot, the width is constant.
    let clamped = along.clamp(0.0, 1.0);
    let width_mm = edge(2, clamped) - edge(1, clamped);
    region_at((x_mm - centre_mm) / width_mm + 0.5, y_mm / LENGTH_MM)
}

/// The x of the medial edge and the x of the lateral edge of an outline at `y_mm`, which must be within the length of the sole.
fn edges_mm(outline: &[[f32; 2]], y_mm: f32) -> [f32; 2] {
    let next = outline.iter().cycle().skip(1);
    let crossings = outline.iter().zip(next).filter(|(a, b)| (a[1] > y_mm) != (b[1] > y_mm));
    let x_mm = crossings.map(|(a, b)| a[0] + (y_mm - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    x_mm.fold([f32::INFINITY, f32::NEG_INFINITY], |[medial, lateral], x_mm| [medial.min(x_mm), lateral.max(x_mm)])
}
