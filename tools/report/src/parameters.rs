//! The parameters by region (the paper's Fig. 8): the five that force can tell with their intervals, and all eight.

use crate::drawing::{self, Drawing, Scale, tick};
use crate::format::{NONE, number};
use crate::region::{TITLES, colour, fit_of, fitted};
use fit::interval::{FIVE, Interval, RESAMPLED_STEPS};
use fit::{Method, RegionFit, Study};
use maud::{Markup, html};
use plantar::pipeline::model::ForceLaw;

pub const WIDTH: f64 = 260.0;
pub const HEIGHT: f64 = TOP + 8.0 * ROW + 22.0;
const LEFT: f64 = 112.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 26.0;
const ROW: f64 = 21.0;

/// One of [`FIVE`] as it is shown.
struct Parameter {
    name: &'static str,
    unit: &'static str,
    /// From SI.
    factor: f64,
    /// Over decades.
    logarithmic: bool,
    /// May be 0.
    zero: bool,
}

/// In the order of [`FIVE`].
const SHOWN: [Parameter; 5] = [
    Parameter { name: "size", unit: "mm²", factor: 1e6, logarithmic: true, zero: false },
    Parameter { name: "stiffness", unit: "kPa", factor: 1e-3, logarithmic: true, zero: false },
    Parameter { name: "damping", unit: "kPa s", factor: 1e-3, logarithmic: true, zero: true },
    Parameter { name: "stiffness exponent", unit: "", factor: 1.0, logarithmic: false, zero: true },
    Parameter { name: "damping exponent", unit: "", factor: 1.0, logarithmic: false, zero: true },
];

/// The last of [`FIVE`] means nothing without damping.
const DAMPING_EXPONENT: usize = 4;

impl Parameter {
    fn title(&self, symbol: &str) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(", {}", self.unit) };
        format!("{symbol}{unit}: {}", self.name)
    }

    fn scaled(&self, range: [f64; 2]) -> [f64; 2] {
        range.map(|value| value * self.factor)
    }
}

/// A parameter of a region: its value, in SI, and where there are any its intervals.
fn value(fit: &RegionFit, parameter: usize) -> (f64, Option<&Interval>) {
    (values(&fit.law)[parameter], fit.uncertainty.as_ref().map(|uncertainty| &uncertainty.intervals[parameter]))
}

fn values(law: &ForceLaw<f64>) -> [f64; 5] {
    [law.ab_m2, law.stiffness_pa, law.damping_pa_s, law.n, law.m]
}

/// One chart a parameter.
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
        label: format!("{title}, by region with 95 % intervals"),
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
                    // The whole reason is in the tables.
                    Err(reason) => text.small.soft x=(LEFT + 5.0) y=(y + 3.5) {
                        "not fitted: " (reason.split([':', '(']).next().unwrap_or_default())
                    },
                }
            }
        },
    }
}

/// From the least to the largest interval, but at most a decade beyond the estimates.
fn scale(study: &Study, parameter: usize) -> Scale {
    let shown = &SHOWN[parameter];
    let places = [LEFT, WIDTH - RIGHT];
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
            Scale::logarithmic([low, (ends[1].min(estimates[1] * 10.0) * 1.2).max(4.0 * low)], places, shown.zero)
        }
        (true, false) => Scale::linear([ends[0].min(0.0), (1.05 * ends[1]).max(0.1)], places),
        (false, true) => Scale::logarithmic([1.0, 1000.0], places, shown.zero),
        (false, false) => Scale::linear([0.0, 5.0], places),
    }
}

/// Above the interval from the Jacobian, below that from resampled steps, the estimate between them.
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

/// An interval; an arrow where it goes on beyond the scale.
fn bar(scale: &Scale, [low, high]: [f64; 2], y: f64, class: &str) -> Markup {
    let (left, right) = (scale.at(low), scale.at(high));
    html! {
        path class=(class) d=(format!("M{left:.1} {y:.1}H{right:.1}")) {}
        @if scale.is_beyond(low) { path.fill d=(format!("M{:.1} {y:.1}l5 -3v6z", left - 5.0)) {} }
        @if scale.is_beyond(high) { path.fill d=(format!("M{:.1} {y:.1}l-5 -3v6z", right + 5.0)) {} }
    }
}

/// What the marks mean.
pub fn key() -> Vec<Drawing> {
    drawing::key([
        (html! { circle.fill cx="12" cy="9" r="3.2" {} }, "estimate"),
        (html! { path.hollow d="M12 4l5 5l-5 5l-5 -5z" {} }, "estimate at a bound"),
        (html! { path.jacobian d="M0 9h24" {} }, "95 %, Jacobian"),
        (html! { path.line d="M0 9h24" {} }, "95 %, resampled steps"),
        (html! { path.fill d="M9 9l5 -3v6z" {} }, "goes on beyond"),
    ])
}

/// The five with both intervals.
pub fn five(study: &Study) -> Markup {
    html! {
        table.dense {
            caption {
                "The five parameters that force can tell: estimate (95 % interval); * estimate at a bound. Resampling needs "
                (RESAMPLED_STEPS) " steps."
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

/// The value and, on a line of its own where room is short, its interval.
fn cell(interval: &Interval, shown: &Parameter, range: Option<[f64; 2]>) -> Markup {
    let Some(range) = range else { return html! { (NONE) } };
    let [low, high] = shown.scaled(range).map(number);
    html! {
        (number(interval.value * shown.factor)) " "
        span.range { "(" (low) " to " (high) ")" @if interval.at_bound { " *" } }
    }
}

/// All eight of the paper's, and what each rests on.
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
            caption { "The paper's eight parameters (Eq. 17) and what each rests on" }
            thead {
                tr {
                    th scope="col" rowspan="2" { "Region" }
                    @for (symbol, unit, name, _) in heads {
                        th scope="col" title=(name) { (symbol) @if !unit.is_empty() { ", " (unit) } }
                    }
                    th scope="col" rowspan="2" { "A/B" }
                    th scope="col" rowspan="2" { "Peak com-" br; "pression, %" }
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

/// What else to know of each region, in plain words.
pub fn warnings(study: &Study) -> Markup {
    let warned: Vec<_> = fitted(study).map(|(region, fit)| (region, &fit.warnings)).collect();
    html! {
        @if warned.iter().any(|(_, warnings)| !warnings.is_empty()) {
            h3.spaced { "Read with care" }
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
