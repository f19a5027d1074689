//! The soles from above: cells coloured by region, contact ellipses and fitted ellipsoids.

use crate::drawing::{self, Drawing, paragraph};
use crate::region::{TITLES, colour, fit_of};
use fit::Study;
use fit::steps::FootEllipse;
use fit::study::Source;
use maud::{Markup, html};
use plantar::Side;
use recording::Cell;
use std::fmt::Write;

/// Units of the drawing per mm.
const SCALE: f64 = 1.5;
/// Margin around the cells, mm.
const MARGIN_MM: f64 = 10.0;
/// Length of the scale bar, mm.
const BAR_MM: f64 = 50.0;
/// Height of the titles above the feet.
const HEAD: f64 = 20.0;
/// Height of the scale bar below the feet.
const FOOTER: f64 = 34.0;
/// Width of an entry of the legend of regions.
const LEGEND_WIDTH: f64 = 212.0;
const LEGEND_ROW: f64 = 52.0;
/// Fraction of its length and width with which a cell is drawn, so that gaps separate neighbouring cells.
const CELL_SHARE: f64 = 0.85;

/// The first recording of this foot with a layout of cells; a live stream has none.
pub fn source(study: &Study, side: Side) -> Option<&Source> {
    study.sources.iter().find(|source| source.side == side && !source.layout.cells.is_empty())
}

/// Both feet, or the foot that was recorded; `None` if there is no recording with a layout of cells.
pub fn foot(study: &Study) -> Option<Drawing> {
    let feet: Vec<&Source> = [Side::Left, Side::Right].into_iter().filter_map(|side| source(study, side)).collect();
    let cells = || feet.iter().flat_map(|foot| &foot.layout.cells);
    cells().next()?;
    let frame = Frame::of(cells().map(|cell| [cell.x_mm, cell.y_mm]), MARGIN_MM);
    let [width, height] = frame.size_mm().map(|mm| SCALE * mm);
    let below = HEAD + height + FOOTER;
    // The legend is beside a single foot, and below two.
    let (columns, x, y) = if feet.len() == 1 { (1, width + 16.0, HEAD + 12.0) } else { (2, 4.0, below + 14.0) };
    let legend_height = LEGEND_ROW * (8 / columns) as f64 - 14.0;
    let names: Vec<&str> = feet.iter().map(|foot| foot.side.name()).collect();
    Some(Drawing {
        width: (width * feet.len() as f64).max(x + LEGEND_WIDTH * columns as f64),
        height: below.max(y + legend_height),
        label: format!(
            "Cells of the {} foot by region with contact ellipses and fitted ellipsoids",
            names.join(" and ")
        ),
        body: html! {
            @for (i, foot) in feet.iter().enumerate() {
                text.title.middle x=(i as f64 * width + width / 2.0) y="14" { (foot.side.name()) " foot" }
                (frame.show(foot.side, [i as f64 * width, HEAD, width, height], &content(study, foot)))
            }
            (scale_bar(8.0, below - 16.0))
            @for region in 0..8 {
                @let row = region % (8 / columns);
                @let column = region / (8 / columns);
                (region_entry(study, region, x + LEGEND_WIDTH * column as f64, y + LEGEND_ROW * row as f64))
            }
        },
    })
}

/// The legend of the lines.
pub fn legend() -> Vec<Drawing> {
    drawing::legend_entries([
        (html! { ellipse.contact cx="12" cy="9" rx="11" ry="6" {} }, "contact ellipse, mean over steps"),
        (html! { ellipse.ellipsoid.c0 cx="12" cy="9" rx="11" ry="6" {} }, "fitted ellipsoid, A × B"),
    ])
}

/// The displayed range of the foot coordinates, mm.
pub struct Frame {
    x_mm: [f64; 2],
    y_mm: [f64; 2],
}

impl Frame {
    /// The range of these places, each as x and y in mm, with a margin around them, mm.
    pub fn of(places_mm: impl Iterator<Item = [f64; 2]> + Clone, margin_mm: f64) -> Self {
        let range = |axis: usize| {
            let values = places_mm.clone().map(|place| place[axis]);
            let [low, high] = values.fold([f64::MAX, f64::MIN], |[low, high], v| [low.min(v), high.max(v)]);
            [low - margin_mm, high + margin_mm]
        };
        Self { x_mm: range(0), y_mm: range(1) }
    }

    /// Width and height, mm.
    pub fn size_mm(&self) -> [f64; 2] {
        [self.x_mm, self.y_mm].map(|[low, high]| high - low)
    }

    /// Shows `content`, which is drawn in foot coordinates in mm, from above: the toes up, and the lateral side of a left foot on
    /// the left. The frame is scaled to the rectangle of x, y, width and height. Content outside of it is clipped.
    pub fn show(&self, side: Side, [x, y, width, height]: [f64; 4], content: &Markup) -> Markup {
        let [width_mm, height_mm] = self.size_mm();
        let (mirror, left_mm) = if side == Side::Left { (-1.0, -self.x_mm[1]) } else { (1.0, self.x_mm[0]) };
        html! {
            svg x=(x) y=(y) width=(width) height=(height)
                viewBox={ (left_mm) " " (-self.y_mm[1]) " " (width_mm) " " (height_mm) } {
                g transform={ "scale(" (mirror) " -1)" } { (content) }
            }
        }
    }
}

/// The cells of one foot, and the contact ellipses and ellipsoids of its regions, in foot coordinates.
fn content(study: &Study, foot: &Source) -> Markup {
    let pitch_mm = pitch_mm(&foot.layout.cells);
    html! {
        @for region in 0..8 {
            path.cells.(colour(region)) d=(cells(foot, region, pitch_mm)) {}
        }
        @for region in 0..8 {
            @if let Some(ellipse) = mean_ellipse(study, foot.side, region) {
                @if let Ok(fit) = fit_of(study, region) {
                    @let (a_mm, b_mm) = (fit.ellipsoid.a_m * 1e3, fit.ellipsoid.b_m * 1e3);
                    (outline(&ellipse, a_mm, b_mm, &format!("ellipsoid {}", colour(region))))
                }
                (outline(&ellipse, ellipse.r_a_mm, ellipse.r_b_mm, "contact"))
            }
        }
    }
}

/// The cells of one region, as an SVG path.
fn cells(foot: &Source, region: usize, pitch_mm: Option<[f64; 2]>) -> String {
    let mut path = String::new();
    for cell in foot.layout.cells.iter().filter(|cell| cell.region as usize == region) {
        let side_mm = cell.area_mm2.sqrt();
        // A cell that fills an element of a regular grid has the shape of that element. The shape of other cells is not known, so
        // they are drawn as squares.
        let fills = |[x_mm, y_mm]: &[f64; 2]| (x_mm * y_mm / cell.area_mm2 - 1.0).abs() < 0.05;
        let [x_mm, y_mm] = pitch_mm.filter(fills).unwrap_or([side_mm, side_mm]).map(|mm| CELL_SHARE * mm);
        let (left, low) = (cell.x_mm - x_mm / 2.0, cell.y_mm - y_mm / 2.0);
        // Writing to a String does not fail.
        let _ = write!(path, "M{left:.2} {low:.2}h{x_mm:.2}v{y_mm:.2}h-{x_mm:.2}z");
    }
    path
}

/// The smallest distances between cells along both axes, mm.
fn pitch_mm(cells: &[Cell]) -> Option<[f64; 2]> {
    let least = |along: fn(&Cell) -> f64| {
        let mut places: Vec<f64> = cells.iter().map(along).collect();
        places.sort_by(f64::total_cmp);
        // Smaller distances are rounding errors between cells of the same row or column.
        let gaps = places.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap_mm| *gap_mm > 0.1);
        gaps.min_by(f64::total_cmp)
    };
    Some([least(|cell| cell.x_mm)?, least(|cell| cell.y_mm)?])
}

/// The mean contact ellipse over the steps of one foot.
fn mean_ellipse(study: &Study, side: Side, region: usize) -> Option<FootEllipse> {
    FootEllipse::of_steps(study.steps.iter().filter(|step| step.side == side).map(|step| &step.regions[region]))
}

/// An ellipse with these radii at the centre and angle of `at`.
fn outline(at: &FootEllipse, a_mm: f64, b_mm: f64, class: &str) -> Markup {
    let place = format!("translate({:.2} {:.2}) rotate({:.1})", at.x_mm, at.y_mm, at.angle_deg);
    html! { ellipse class=(class) rx=(format!("{a_mm:.2}")) ry=(format!("{b_mm:.2}")) transform=(place) {} }
}

fn scale_bar(x: f64, y: f64) -> Markup {
    let length = BAR_MM * SCALE;
    html! {
        path.line d={ "M" (x) " " (y - 3.0) "v6m0 -3h" (length) "m0 -3v6" } {}
        text.middle x=(x + length / 2.0) y=(y + 14.0) { (BAR_MM) " mm" }
    }
}

/// The entry of a region in the legend.
fn region_entry(study: &Study, region: usize, x: f64, y: f64) -> Markup {
    html! {
        rect.fill.(colour(region)) x=(x) y=(y - 9.0) width="11" height="11" rx="2" {}
        text.strong x=(x + 17.0) y=(y) { (TITLES[region]) }
        @match fit_of(study, region) {
            Ok(fit) => {
                @let (a_mm, b_mm) = (fit.ellipsoid.a_m * 1e3, fit.ellipsoid.b_m * 1e3);
                text.soft x=(x + 17.0) y=(y + 14.0) { (format!("A {a_mm:.1} mm, B {b_mm:.1} mm")) }
            }
            Err(reason) => (paragraph(&format!("not fitted: {reason}"), x + 17.0, y + 12.0, 38, "small soft")),
        }
    }
}
