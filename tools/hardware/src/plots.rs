//! The plots of the simulation, as SVG files.

use crate::analyses::Points;
use crate::data_sheet::{LOGIC_MULTIPLEXER_TYPICAL_OHM, MULTIPLEXER_ON_OHM, MULTIPLEXER_TYPICAL_OHM, SWITCH_ON_OHM};
use crate::figures::{CROSSTALK_PERCENT, Results};
use maud::{Markup, PreEscaped, html};
use plantar::firmware::front_end::{self, SETTLE_US};
use report::drawing::{Curves, STYLE, Scale, legend_entries};
use std::fmt::Write;

/// Width of a chart with its margins, in units of the view box, as all lengths here.
const WIDTH: f64 = 640.0;
/// Height of a chart with its margins, without the legend.
const HEIGHT: f64 = 330.0;
/// Left edge of the area of the curves.
const LEFT: f64 = 60.0;
/// Right edge of the area of the curves.
const RIGHT: f64 = 600.0;
/// Upper edge of the area of the curves.
const TOP: f64 = 60.0;
/// Lower edge of the area of the curves.
const BOTTOM: f64 = 290.0;
/// Height of an entry of the legend.
const ENTRY: f64 = 18.0;

/// A curve with its name.
struct Line<'a> {
    name: &'a str,
    points: Points,
}

/// A chart with its axes.
struct Chart<'a> {
    title: &'a str,
    /// The scales of both axes.
    scales: Curves,
    x_title: &'a str,
    y_title: &'a str,
    lines: Vec<Line<'a>>,
    /// Drawn in addition to the curves, such as limits.
    marks: Markup,
}

fn x_scale(values: [f64; 2], is_logarithmic: bool) -> Scale {
    let positions = [LEFT, RIGHT];
    if is_logarithmic { Scale::logarithmic(values, positions, false) } else { Scale::linear(values, positions) }
}

fn y_scale(values: [f64; 2], is_logarithmic: bool) -> Scale {
    let positions = [BOTTOM, TOP];
    if is_logarithmic { Scale::logarithmic(values, positions, false) } else { Scale::linear(values, positions) }
}

impl Chart<'_> {
    /// The SVG path of a curve, which is interrupted at points beyond the scales.
    fn path(&self, points: &Points) -> String {
        let mut path = String::new();
        let mut command = 'M';
        for (x, y) in points {
            if self.scales.x.is_beyond(*x) || self.scales.y.is_beyond(*y) {
                command = 'M';
                continue;
            }
            // Writing to a String does not fail.
            let _ = write!(path, "{command}{:.1} {:.1}", self.scales.x.at(*x), self.scales.y.at(*y));
            command = 'L';
        }
        path
    }

    /// A vertical line at `x`, with a text above it.
    fn vertical(&self, x: f64, text: &str) -> Markup {
        let x = format!("{:.1}", self.scales.x.at(x));
        html! {
            path.axis.dashed d={ "M" (x) " " (BOTTOM) "V" (TOP) } {}
            text.small.middle x=(x) y=(TOP - 4.0) { (text) }
        }
    }

    /// A horizontal line at `y`, with a text at its right end.
    fn horizontal(&self, y: f64, text: &str) -> Markup {
        let y = self.scales.y.at(y);
        html! {
            path.axis.dashed d=(format!("M{LEFT} {y:.1}H{RIGHT}")) {}
            text.small.end x=(RIGHT) y=(format!("{:.1}", y - 4.0)) { (text) }
        }
    }

    fn svg(&self) -> String {
        let rows = self.lines.len().div_ceil(2) as f64;
        let height = HEIGHT + ENTRY * rows + 10.0;
        let marks =
            self.lines.iter().enumerate().map(|(i, line)| (html! { path.model.{ "c" (i) } d="M1 9h22" {} }, line.name));
        let entries = legend_entries(marks);
        let drawing = html! {
            svg.drawing xmlns="http://www.w3.org/2000/svg" width=(WIDTH) height=(height)
                viewBox={ "0 0 " (WIDTH) " " (height) } role="img" aria-label=(self.title) {
                style { (PreEscaped(STYLE)) }
                rect width="100%" height="100%" fill="#fff" {}
                text.title x="10" y="20" { (self.title) }
                (self.scales.axes(self.x_title, self.y_title))
                (self.marks)
                @for (i, line) in self.lines.iter().enumerate() {
                    path.line.{ "c" (i) } d=(self.path(&line.points)) {}
                }
                @for (i, entry) in entries.iter().enumerate() {
                    (entry.at(LEFT + 270.0 * (i % 2) as f64, HEIGHT + ENTRY * (i / 2) as f64))
                }
            }
        };
        drawing.into_string() + "\n"
    }
}

/// The plots: the name of each file, and its content.
pub fn plots(results: &Results) -> Vec<(&'static str, String)> {
    vec![
        ("transfer.svg", transfer(results)),
        ("settling.svg", settling(results)),
        ("crosstalk.svg", crosstalk(results)),
        ("loop-gain.svg", loops(results, "Loop gain", "dB", [-40.0, 80.0], |one| &one.gain_db)),
        ("phase.svg", loops(results, "Phase margin at each frequency", "degrees", [0.0, 150.0], |one| &one.margin_deg)),
        ("noise.svg", noise(results)),
    ]
}

fn transfer(results: &Results) -> String {
    let scales = Curves { x: x_scale([0.0, 0.6], false), y: y_scale([0.0, 70_000.0], false) };
    let millisiemens = |(ohm, code): &(f64, f64)| (1000.0 / ohm, *code);
    let simulated: Points = results.transfer.iter().map(millisiemens).collect();
    let formula: Points = (0..=60).map(|i| f64::from(i) / 100.0).map(|s| (s, front_end::code(1000.0 / s))).collect();
    let formula_name = format!("formula: {} (1 + Rf / R)", front_end::UNLOADED_CODE);
    let mut chart = Chart {
        title: "Code of a cell over its conductance",
        scales,
        x_title: "conductance, mS",
        y_title: "code",
        lines: vec![Line { name: &formula_name, points: formula }],
        marks: html! {},
    };
    let points = simulated.iter().filter(|(s, _)| *s <= 0.6);
    let dots =
        points.map(|(s, code)| (format!("{:.1}", chart.scales.x.at(*s)), format!("{:.1}", chart.scales.y.at(*code))));
    let dots: Vec<_> = dots.collect();
    chart.marks = html! {
        @for (x, y) in &dots { g.c1 { circle.hollow cx=(x) cy=(y) r="3.5" {} } }
        (chart.horizontal(f64::from(front_end::CLIPPED_CODE), "reported as saturated from here on"))
        // The entry of the legend for the dots; the legend below the chart has lines only.
        g.c1 { circle.hollow cx="400" cy="250" r="3.5" {} }
        text.small x="410" y="253.5" { "simulated" }
    };
    chart.svg()
}

fn settling(results: &Results) -> String {
    let line = |change: &crate::analyses::Settling| {
        let points = change.error_lsb.iter().map(|(t_s, lsb)| (t_s * 1e6, lsb.abs())).collect();
        (change.name, points)
    };
    let lines = results.settling.iter().map(line).map(|(name, points)| Line { name, points }).collect();
    let mut chart = Chart {
        title: "Settling of the converter's input after a row was selected",
        scales: Curves { x: x_scale([0.0, 60.0], false), y: y_scale([0.01, 10_000.0], true) },
        x_title: "time, µs",
        y_title: "distance from the final value, LSB of 12 bits",
        lines,
        marks: html! {},
    };
    chart.marks = html! {
        (chart.vertical(SETTLE_US.into(), "first conversion"))
        (chart.horizontal(0.5, "half an LSB"))
    };
    chart.svg()
}

fn crosstalk(results: &Results) -> String {
    let mut chart = Chart {
        title: "Error of a cell when all 15 neighbours in its row are at full load",
        scales: Curves { x: x_scale([0.1, 100.0], true), y: y_scale([0.1, 100.0], true) },
        x_title: "resistance of the row switch, Ω",
        y_title: "% of the reading",
        lines: vec![Line { name: "simulated, row conductor of 0.4 Ω included", points: results.row_error.clone() }],
        marks: html! {},
    };
    chart.marks = html! {
        (chart.horizontal(CROSSTALK_PERCENT, &format!("limit: {CROSSTALK_PERCENT} %")))
        (chart.vertical(SWITCH_ON_OHM.value, "FDG6335N max."))
        (chart.vertical(MULTIPLEXER_TYPICAL_OHM.value, "ADG706 typ."))
        // The text is short, because this line is close to the one before.
        (chart.vertical(MULTIPLEXER_ON_OHM.value, "max."))
        // For comparison: a multiplexer that is common on hobby boards.
        (chart.vertical(LOGIC_MULTIPLEXER_TYPICAL_OHM.value, "CD74HC4067 typ., 4.5 V"))
    };
    chart.svg()
}

fn loops(
    results: &Results,
    title: &str,
    unit: &str,
    values: [f64; 2],
    points: fn(&crate::analyses::Loop) -> &Points,
) -> String {
    let in_khz = |one| points(one).iter().map(|(hz, value)| (hz / 1e3, *value)).collect();
    let lines = results.loops.iter().map(|one| Line { name: one.name, points: in_khz(one) }).collect();
    Chart {
        title,
        scales: Curves { x: x_scale([1.0, 1e5], true), y: y_scale(values, false) },
        x_title: "frequency, kHz",
        y_title: unit,
        lines,
        marks: html! {},
    }
    .svg()
}

fn noise(results: &Results) -> String {
    let line = |one: &crate::analyses::Noise| one.density.iter().map(|(hz, v)| (hz / 1e3, v * 1e9)).collect();
    let lines = results.noise.iter().map(|one| Line { name: one.name, points: line(one) }).collect();
    Chart {
        title: "Noise density at the converter's input",
        scales: Curves { x: x_scale([0.01, 1e4], true), y: y_scale([1.0, 10_000.0], true) },
        x_title: "frequency, kHz",
        y_title: "nV/√Hz",
        lines,
        marks: html! {},
    }
    .svg()
}
