//! A step as a picture: peak pressure with the contact ellipses on the foot, and the forces of each region over time.

use crate::drawing::{Curves, Drawing, STYLE, Scale, legend_entries, legend_row, square};
use crate::foot::Frame;
use crate::region::{TITLES, colour};
use maud::{Markup, PreEscaped, html};
use plantar::protocol::{Step, StepRegion};
use recording::Recording;

// The following lengths are in units of the drawing. `FOOT` and `PANEL` are the width and height of the foot and of the panel
// of a region; `TITLE` is the height of the title of a panel.
const MARGIN: f64 = 14.0;
const HEADER: f64 = 58.0;
const FOOT: [f64; 2] = [300.0, 590.0];
const PANEL: [f64; 2] = [250.0, 190.0];
const GAP: f64 = 12.0;
const TITLE: f64 = 18.0;
/// Margin around the cells, mm.
const SPACE_MM: f64 = 12.0;
/// Opacity of an unloaded cell.
const UNLOADED_OPACITY: f64 = 0.06;

/// Measured and model force of each region in a frame, N.
pub type Forces = [(f64, f64); 8];

/// A step of a recording, with the data that its picture shows.
#[derive(Clone, Copy, Debug)]
pub struct StepPicture<'a> {
    /// The recording; only its side, layout and rate are used, not its frames.
    pub recording: &'a Recording,
    /// The step.
    pub step: &'a Step,
    /// The largest measured pressure of each cell of the recording in the step, kPa.
    pub peak_kpa: &'a [f32],
    /// The forces in each frame of the step, from heel strike on.
    pub forces: &'a [Forces],
    /// The contact rule in words.
    pub contact: &'a str,
}

impl StepPicture<'_> {
    /// The picture as an SVG file, with text in a font of the viewer.
    pub fn svg(&self) -> String {
        let (width, height) = (MARGIN + FOOT[0] + 3.0 * (GAP + PANEL[0]) + MARGIN, HEADER + FOOT[1] + MARGIN);
        let svg = html! {
            svg.drawing xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) }
                role="img" aria-label="Peak pressure and contact ellipses of a step, and the forces of each region over time" {
                style { (PreEscaped(STYLE)) }
                rect width="100%" height="100%" fill="#fff" {}
                text.title x=(MARGIN) y="22" { "Peak pressure, contact ellipse at peak force" }
                text x=(MARGIN) y="40" { "contact: " (self.contact) }
                (self.foot())
                // The legend is at the right, because the text of the contact rule is wider than the foot.
                (legend_row(&legend(), MARGIN + FOOT[0] + PANEL[0] + 2.0 * GAP, 26.0))
                @for region in 0..8 {
                    @let (column, row) = ((region % 3) as f64, (region / 3) as f64);
                    (self.region(region).at(MARGIN + FOOT[0] + GAP + column * (PANEL[0] + GAP), HEADER + row * (PANEL[1] + GAP)))
                }
            }
        };
        svg.into_string()
    }

    /// The sole from above in mm, toes up; the lateral side of the left foot is on the left.
    fn foot(&self) -> Markup {
        let cells = &self.recording.layout.cells;
        let frame = Frame::of(cells.iter().map(|cell| [cell.x_mm, cell.y_mm]), SPACE_MM);
        let content = html! {
            @for (cell, opacity) in cells.iter().zip(self.opacity()) {
                @let opacity = format!("fill-opacity:{opacity:.3}");
                @let path = square(cell.x_mm, cell.y_mm, cell.area_mm2);
                path.cells.(colour(cell.region as usize)) d=(path) style=(opacity) {}
            }
            @for region in self.step.regions.iter().filter(|region| region.ellipse_r_a_cmm > 0) { (ellipse(region)) }
        };
        frame.show(self.recording.side, [MARGIN, HEADER, FOOT[0], FOOT[1]], &content)
    }

    /// Opacity of each cell: it increases with the square root of its peak pressure, so that lightly loaded cells are visible.
    fn opacity(&self) -> Vec<f64> {
        let largest_kpa = self.peak_kpa.iter().copied().fold(1.0, f32::max);
        let opacity = |&kpa: &f32| UNLOADED_OPACITY + (1.0 - UNLOADED_OPACITY) * f64::from(kpa / largest_kpa).sqrt();
        self.peak_kpa.iter().map(opacity).collect()
    }

    fn region(&self, region: usize) -> Drawing {
        let every_s = 1.0 / self.recording.rate_hz;
        let measured_n: Vec<f64> = self.forces.iter().map(|forces| forces[region].0).collect();
        let model_n: Vec<f64> = self.forces.iter().map(|forces| forces[region].1).collect();
        let largest_n = measured_n.iter().chain(&model_n).copied().fold(10.0, f64::max);
        let seconds = self.forces.len() as f64 * every_s;
        let chart = Curves {
            x: Scale::linear([0.0, seconds.max(every_s)], [38.0, PANEL[0] - 6.0]),
            y: Scale::linear([0.0, 1.05 * largest_n], [PANEL[1] - 32.0, TITLE + 22.0]),
        };
        Drawing {
            width: PANEL[0],
            height: PANEL[1],
            label: format!("{}: measured and model force over time", TITLES[region]),
            body: html! {
                text.title x="2" y="13" { (TITLES[region]) }
                (chart.axes("s after heel strike", "force, N"))
                path.line d=(chart.line(0.0, every_s, &measured_n)) {}
                path.model.(colour(region)) d=(chart.line(0.0, every_s, &model_n)) {}
            },
        }
    }
}

fn legend() -> Vec<Drawing> {
    legend_entries([
        (html! { path.line d="M0 9h24" {} }, "measured force"),
        (html! { @for region in 0..4 { path.model.(colour(region)) d={ "M" (6 * region) " 9h6" } {} } }, "model force"),
    ])
}

/// The contact ellipse at the region's largest force.
fn ellipse(region: &StepRegion) -> Markup {
    let (x_mm, y_mm) = (f64::from(region.ellipse_x_dmm) / 10.0, f64::from(region.ellipse_y_dmm) / 10.0);
    let angle_deg = f64::from(region.ellipse_angle_ddeg) / 10.0;
    let (r_a_mm, r_b_mm) = (f64::from(region.ellipse_r_a_cmm) / 100.0, f64::from(region.ellipse_r_b_cmm) / 100.0);
    html! {
        ellipse.contact rx=(r_a_mm) ry=(r_b_mm) transform=(format!("translate({x_mm:.1} {y_mm:.1}) rotate({angle_deg:.1})")) {}
    }
}
