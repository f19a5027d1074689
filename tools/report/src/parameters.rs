//! The parameters by region (Fig. 8 of the paper): the five identifiable ones with their intervals, and all eight.

use crate::drawing::{self, Drawing, Scale, tick};
use crate::format::{NONE, number};
use crate::region::{TITLES, colour, fit_of, fitted};
use fit::interval::{FIVE, Interval, RESAMPLED_STEPS};
use fit::{Method, RegionFit, Study};
use maud::{Markup, html};
use plantar::pipeline::model::ForceLaw;

/// Width of a chart.
pub const WIDTH: f64 = 260.0;
/// Height of a chart.
pub const HEIGHT: f64 = TOP + 8.0 * ROW + 22.0;
const LEFT: f64 = 112.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 26.0;
const ROW: f64 = 21.0;

/// The display of one of [`FIVE`].
struct Parameter {
    name: &'static str,
    unit: &'static str,
    /// Factor from SI to `unit`.
    factor: f64,
    /// True if its axis is logarithmic.
    logarithmic: bool,
    /// True if its value may be 0.
    zero: bool,
}

/// The display of the five identifiable parameters, in the order of [`FIVE`].
const SHOWN: [Parameter; 5] = [
    Parameter { name: "size", unit: "mm²", factor: 1e6, logarithmic: true, zero: false },
    Parameter { name: "stiffness", unit: "kPa", factor: 1e-3, logarithmic: true, zero: false },
    Parameter { name: "damping", unit: "kPa s", factor: 1e-3, logarithmic: true, zero: true },
    Parameter { name: "stiffness exponent", unit: "", factor: 1.0, logarithmic: false, zero: true },
    Parameter { name: "damping exponent", unit: "", factor: 1.0, logarithmic: false, zero: true },
];

/// Index in [`FIVE`] of the damping exponent m, which has no meaning without damping.
const DAMPING_EXPONENT: usize = 4;

impl Parameter {
    /// Title of the chart.
    fn title(&self, symbol: &str) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(", {}", self.unit) };
        format!("{symbol}{unit}: {}", self.name)
    }

    /// A range in SI in the displayed unit.
    fn scaled(&self, range: [f64; 2]) -> [f64; 2] {
        range.map(|value| value * self.factor)
    }
}

/// A parameter of a region: its value in SI, and its intervals if they were computed.
fn value(fit: &RegionFit, parameter: usize) -> (f64, Option<&Interval>) {
    (values(&fit.law)[parameter], fit.uncertainty.as_ref().map(|uncertainty| &uncertainty.intervals[parameter]))
}

/// The five parameters of a force law in the order of [`FIVE`], SI units.
fn values(law: &ForceLaw<f64>) -> [f64; 5] {
    [law.ab_m2, law.stiffness_pa, law.damping_pa_s, law.n, law.m]
}

/// One chart for each parameter.
pub fn charts(study: &Study) -> [Drawing; 5] {
    std::array::from_fn(|parameter| chart(study, parameter))
}

fn chart(study: &Study, parameter: usize) -> Drawing {
    let shown = &SHOWN[parameter];
    let title = shown.title(FIVE[parameter]);
    let scale = scale(study, parameter);
    let bottom = TOP + 8.0 * ROW;
    Drawing {
        width: WIDTH,
        height: HEIGHT,
        label: format!("{title}, by region with 95 % confidence intervals"),
        body: html! {
            text.strong x="2" y="13" { (title) }
            @for value in scale.ticks(3) {
                path.grid d={ "M" (format!("{:.1}", scale.at(value))) " " (TOP) "V" (bottom) } {}
                text.middle x=(format!("{:.1}", scale.at(value))) y=(bottom + 14.0) { (tick(value)) }
            }
            @if shown.logarithmic && shown.zero { text.middle x=(scale.at(0.0)) y=(bottom + 14.0) { "0" } }
            path.axis d={ "M" (LEFT) " " (bottom) "H" (WIDTH - RIGHT) } {}
            @for region in 0..8 {
                @let y = TOP + (region as f64 + 0.5) * ROW;
                text.end x=(LEFT - 8.0) y=(y + 4.0) { (TITLES[region]) }
                @match fit_of(study, region) {
                    Ok(fit) if parameter == DAMPING_EXPONENT && fit.law.damping_pa_s == 0.0 =>
                        text.small.soft x=(LEFT + 5.0) y=(y + 3.5) { "no damping: G is 0" },
                    Ok(fit) => g.(colour(region)) { (row(&scale, shown, value(fit, parameter), y)) },
                    // The tables contain the complete reason.
                    Err(reason) => text.small.soft x=(LEFT + 5.0) y=(y + 3.5) {
                        "not fitted: " (reason.split([':', '(']).next().unwrap_or_default())
                    },
                }
            }
        },
    }
}

/// The scale of a parameter. It covers all intervals, but extends at most a decade beyond the estimates.
fn scale(study: &Study, parameter: usize) -> Scale {
    let shown = &SHOWN[parameter];
    let positions = [LEFT, WIDTH - RIGHT];
    let mut ends = [f64::MAX, f64::MIN];
    let mut estimates = ends;
    let widen = |ends: &mut [f64; 2], value: f64| {
        if value.is_finite() && (value > 0.0 || !shown.logarithmic) {
            *ends = [ends[0].min(value), ends[1].max(value)];
        }
    };
    for (_, fit) in fitted(study) {
        let (value, intervals) = value(fit, parameter);
        widen(&mut estimates, value * shown.factor);
        widen(&mut ends, value * shown.factor);
        let intervals = intervals.into_iter().flat_map(|i| [Some(i.jacobian), i.bootstrap]).flatten();
        intervals.flat_map(|range| shown.scaled(range)).for_each(|end| widen(&mut ends, end));
    }
    if estimates[0] > estimates[1] {
        estimates = ends;
    }
    match (ends[0] <= ends[1], shown.logarithmic) {
        (true, true) => {
            let low = ends[0].max(estimates[0] / 10.0) / 1.2;
            Scale::logarithmic([low, (ends[1].min(estimates[1] * 10.0) * 1.2).max(4.0 * low)], positions, shown.zero)
        }
        (true, false) => Scale::linear([ends[0].min(0.0), (1.05 * ends[1]).max(0.1)], positions),
        (false, true) => Scale::logarithmic([1.0, 1000.0], positions, shown.zero),
        (false, false) => Scale::linear([0.0, 5.0], positions),
    }
}

/// Draws the estimate, the interval from the Jacobian above it, and the interval from resampled steps below it.
fn row(scale: &Scale, shown: &Parameter, (value, interval): (f64, Option<&Interval>), y: f64) -> Markup {
    let x = scale.at(value * shown.factor);
    html! {
        @if let Some(interval) = interval {
            (bar(scale, shown.scaled(interval.jacobian), y - 3.5, "jacobian"))
            @if let Some(bootstrap) = interval.bootstrap { (bar(scale, shown.scaled(bootstrap), y + 3.5, "line")) }
        }
        @if interval.is_some_and(|interval| interval.at_bound) {
            path.hollow d=(format!("M{x:.1} {:.1}l5 5l-5 5l-5 -5z", y - 5.0)) {}
        } @else {
            circle.fill cx=(format!("{x:.1}")) cy=(y) r="3.2" {}
        }
    }
}

/// Draws an interval, with an arrow at each end that lies beyond the scale.
fn bar(scale: &Scale, [low, high]: [f64; 2], y: f64, class: &str) -> Markup {
    let (left, right) = (scale.at(low), scale.at(high));
    html! {
        path class=(class) d=(format!("M{left:.1} {y:.1}H{right:.1}")) {}
        @if scale.is_beyond(low) { path.fill d=(format!("M{:.1} {y:.1}l5 -3v6z", left - 5.0)) {} }
        @if scale.is_beyond(high) { path.fill d=(format!("M{:.1} {y:.1}l-5 -3v6z", right + 5.0)) {} }
    }
}

/// The legend of the marks.
pub fn legend() -> Vec<Drawing> {
    drawing::legend_entries([
        (html! { circle.fill cx="12" cy="9" r="3.2" {} }, "estimate"),
        (html! { path.hollow d="M12 4l5 5l-5 5l-5 -5z" {} }, "estimate at a bound"),
        (html! { path.jacobian d="M0 9h24" {} }, "95 %, Jacobian"),
        (html! { path.line d="M0 9h24" {} }, "95 %, resampled steps"),
        (html! { path.fill d="M9 9l5 -3v6z" {} }, "beyond the axis"),
    ])
}

/// The table of the five parameters with both intervals.
pub fn five(study: &Study) -> Markup {
    html! {
        table.dense {
            caption {
                "The five identifiable parameters: estimate (95 % confidence interval); * estimate at a bound of the search. \
                 Resampling requires at least " (RESAMPLED_STEPS) " steps."
            }
            thead {
                tr {
                    th scope="col" { "Region" }
                    th scope="col" { "Interval" }
                    @for (symbol, shown) in FIVE.iter().zip(&SHOWN) {
                        th scope="col" { (symbol) @if !shown.unit.is_empty() { ", " (shown.unit) } }
                    }
                }
            }
            @for region in 0..8 {
                tbody {
                    @match fit_of(study, region) {
                        Ok(RegionFit { uncertainty: None, law, .. }) => tr {
                            th scope="row" { (TITLES[region]) }
                            td.kind { "none" }
                            @for (value, shown) in values(law).into_iter().zip(&SHOWN) {
                                td { (number(value * shown.factor)) }
                            }
                        },
                        Ok(RegionFit { uncertainty: Some(uncertainty), .. }) => {
                            tr {
                                th scope="rowgroup" rowspan="2" { (TITLES[region]) }
                                td.kind { "Jacobian" }
                                @for (i, shown) in uncertainty.intervals.iter().zip(&SHOWN) {
                                    td { (cell(i, shown, Some(i.jacobian))) }
                                }
                            }
                            tr {
                                td.kind { "resampled" }
                                @for (i, shown) in uncertainty.intervals.iter().zip(&SHOWN) {
                                    td { (cell(i, shown, i.bootstrap)) }
                                }
                            }
                        }
                        Err(reason) => tr {
                            th scope="row" { (TITLES[region]) }
                            td.reason colspan="6" { "Not fitted: " (reason) }
                        },
                    }
                }
            }
        }
    }
}

/// The value and its interval, which wraps to a new line if space is short.
fn cell(interval: &Interval, shown: &Parameter, range: Option<[f64; 2]>) -> Markup {
    let Some(range) = range else { return html! { (NONE) } };
    let [low, high] = shown.scaled(range).map(number);
    html! {
        (number(interval.value * shown.factor)) " "
        span.range { "(" (low) " to " (high) ")" @if interval.at_bound { " *" } }
    }
}

/// The table of the paper's eight parameters. A row below the titles states what determines each of them (its basis).
pub fn eight(study: &Study) -> Markup {
    let heads = [
        ("A", "mm", "medial-lateral radius", "identified A B, measured A/B"),
        ("B", "mm", "heel-toe radius", "identified A B, measured A/B"),
        ("C", "mm", "vertical radius", "pinned"),
        ("d₀", "mm", "thickness", "pinned"),
        ("k", "N/m³", "stiffness coefficient", "identified K, pinned C, d₀"),
        ("n", "", "stiffness exponent", "identified"),
        ("c", "N s/m³", "damping coefficient", "identified G, pinned C, d₀"),
        ("m", "", "damping exponent", "identified"),
    ];
    let searched = study.options.method == Method::Paper;
    html! {
        table.dense {
            caption { "The paper's eight parameters (Eq. 17) and the basis of each" }
            thead {
                tr {
                    th scope="col" rowspan="2" { "Region" }
                    @for (symbol, unit, name, _) in heads {
                        th scope="col" title=(name) { (symbol) @if !unit.is_empty() { ", " (unit) } }
                    }
                    th scope="col" rowspan="2" { "A/B" }
                    th scope="col" rowspan="2" { "Largest com-" br; "pression, %" }
                }
                tr.basis { @for (_, _, _, basis) in heads { td { (if searched { "searched" } else { basis }) } } }
            }
            tbody {
                @for region in 0..8 {
                    tr {
                        th scope="row" { (TITLES[region]) }
                        @match fit_of(study, region) {
                            Ok(fit) => {
                                @let e = &fit.ellipsoid;
                                @for mm in [e.a_m, e.b_m, e.c_m, e.d0_m].map(|m| m * 1e3) { td { (number(mm)) } }
                                @for value in [e.k, e.n, e.c, e.m] { td { (number(value)) } }
                                td { (number(fit.pins.aspect)) }
                                td { (number(fit.pins.compression * 100.0)) }
                            }
                            Err(reason) => td.reason colspan="10" { "Not fitted: " (reason) },
                        }
                    }
                }
            }
        }
    }
}

/// The limitations of the fit of each region.
pub fn warnings(study: &Study) -> Markup {
    let warned: Vec<_> = fitted(study).map(|(region, fit)| (region, &fit.warnings)).collect();
    html! {
        @if warned.iter().any(|(_, warnings)| !warnings.is_empty()) {
            h3.spaced { "Limitations of these parameters" }
            dl.warnings {
                @for (region, warnings) in warned.iter().filter(|(_, warnings)| !warnings.is_empty()) {
                    div {
                        dt { (TITLES[*region]) }
                        @for warning in warnings.iter() { dd { (warning) "." } }
                    }
                }
            }
        }
    }
}
