//! The parameters by region (Fig. 8 of the paper): the five identifiable ones with their intervals, and all eight.

use crate::drawing::{self, Drawing};
use crate::format::{NONE, number};
use crate::intervals::{IntervalChart, Mark, Row, unfitted};
use crate::region::{TITLES, fit_of, fitted};
use fit::interval::{FIVE, Interval, MIN_BOOTSTRAP_STEPS};
use fit::{Method, RegionFit, Study};
use maud::{Markup, html};
use plantar::pipeline::model::ForceLaw;

/// The display of one of [`FIVE`].
struct Parameter {
    name: &'static str,
    unit: &'static str,
    /// Factor from SI to `unit`.
    factor: f64,
    /// True if its axis is logarithmic.
    is_logarithmic: bool,
}

/// The display of the five identifiable parameters, in the order of [`FIVE`].
const SHOWN: [Parameter; 5] = [
    Parameter { name: "size", unit: "mm²", factor: 1e6, is_logarithmic: true },
    Parameter { name: "stiffness", unit: "kPa", factor: 1e-3, is_logarithmic: true },
    Parameter { name: "damping", unit: "kPa s", factor: 1e-3, is_logarithmic: true },
    Parameter { name: "stiffness exponent", unit: "", factor: 1.0, is_logarithmic: false },
    Parameter { name: "damping exponent", unit: "", factor: 1.0, is_logarithmic: false },
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
    std::array::from_fn(|parameter| {
        let shown = &SHOWN[parameter];
        IntervalChart {
            title: shown.title(FIVE[parameter]),
            is_logarithmic: shown.is_logarithmic,
            rows: std::array::from_fn(|region| row(study, parameter, region)),
        }
        .draw()
    })
}

fn row(study: &Study, parameter: usize, region: usize) -> Row {
    let shown = &SHOWN[parameter];
    match fit_of(study, region) {
        Ok(fit) if parameter == DAMPING_EXPONENT && fit.law.damping_pa_s == 0.0 => {
            Row::Text("no damping: G is 0".into())
        }
        Ok(fit) => {
            let (value, interval) = value(fit, parameter);
            Row::Value {
                value: value * shown.factor,
                mark: match interval {
                    Some(interval) if interval.at_bound => Mark::Bound,
                    Some(interval) if !interval.is_identifiable => Mark::Undetermined,
                    _ => Mark::Point,
                },
                broad: interval.map(|interval| shown.scaled(interval.jacobian)),
                thin: interval.and_then(|interval| interval.bootstrap).map(|range| shown.scaled(range)),
            }
        }
        Err(reason) => unfitted(&reason),
    }
}

/// The legend of the marks.
pub fn legend(study: &Study) -> Vec<Drawing> {
    let undetermined = match study.options.prior {
        Some(_) => "not determined: close to the usual value of other people, or uncertain by a factor above 100",
        None => "not determined: without meaning",
    };
    drawing::legend_entries([
        (Mark::Point.at(12.0, 9.0), "estimate"),
        (Mark::Undetermined.at(12.0, 9.0), undetermined),
        (Mark::Bound.at(12.0, 9.0), "estimate at a bound"),
        (html! { path.jacobian d="M0 9h24" {} }, "95 %, Jacobian"),
        (html! { path.line d="M0 9h24" {} }, "95 %, resampled steps"),
        (html! { path.fill d="M9 9l5 -3v6z" {} }, "beyond the axis"),
    ])
}

/// The value of a parameter that the force does not determine. `damping` is the symbol of the damping parameter in the table.
fn undetermined(study: &Study, damping: &str) -> String {
    match study.options.prior {
        Some(_) => format!(
            "close to the usual value of other people, uncertain by a factor of more than 100, or without meaning if \
             {damping} is 0"
        ),
        None => "without meaning".into(),
    }
}

/// The table of the five parameters with both intervals.
pub fn five(study: &Study) -> Markup {
    html! {
        table.dense {
            caption {
                "The five identifiable parameters: estimate (95 % confidence interval); * estimate at a bound of the search; \
                 † not determined by the force: " (undetermined(study, "G")) ". Resampling requires at least "
                (MIN_BOOTSTRAP_STEPS) " steps."
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
        span.range { "(" (low) " to " (high) ")" @if interval.at_bound { " *" } @if !interval.is_identifiable { " †" } }
    }
}

/// The table of the paper's eight parameters. A row below the titles states what determines each of them (its basis).
pub fn eight(study: &Study) -> Markup {
    let heads = [
        ("A", "mm", "medial-lateral radius", "identified A B, A/B of the contact"),
        ("B", "mm", "heel-toe radius", "identified A B, A/B of the contact"),
        ("C", "mm", "vertical radius", "fixed, see above"),
        ("d₀", "mm", "thickness", "fixed, see above"),
        ("k", "N/m³", "stiffness coefficient", "identified K, fixed C, d₀"),
        ("n", "", "stiffness exponent", "identified"),
        ("c", "N s/m³", "damping coefficient", "identified G, fixed C, d₀"),
        ("m", "", "damping exponent", "identified"),
    ];
    let searched = study.options.method == Method::Paper;
    html! {
        table.dense {
            caption {
                "The paper's eight parameters (Eq. 17) and the basis of each. † not determined by the force: "
                (undetermined(study, "c"))
            }
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
                                // The index in `FIVE` is that of the parameter on which a value depends: A and B depend on A B,
                                // k on K, and c on G.
                                @for m in [e.a_m, e.b_m] { td { (number(m * 1e3)) (dagger(fit, 0)) } }
                                @for m in [e.c_m, e.d0_m] { td { (number(m * 1e3)) } }
                                @for (value, parameter) in [(e.k, 1), (e.n, 3), (e.c, 2), (e.m, 4)] {
                                    td { (number(value)) (dagger(fit, parameter)) }
                                }
                                td { (number(fit.fixed.aspect)) }
                                td { (number(fit.fixed.compression(&fit.law, fit.area_max_m2) * 100.0)) }
                            }
                            Err(reason) => td.reason colspan="10" { "Not fitted: " (reason) },
                        }
                    }
                }
            }
        }
    }
}

/// The mark of a parameter that the force does not determine.
fn dagger(fit: &RegionFit, parameter: usize) -> &'static str {
    let (_, interval) = value(fit, parameter);
    if interval.is_some_and(|interval| !interval.is_identifiable) { " †" } else { "" }
}

/// The limitations of the fit of each region: first the defects, because of which a part of the result is missing or must not be
/// used, then the warnings.
pub fn warnings(study: &Study) -> Markup {
    let of = |fit: &RegionFit| [&fit.defects[..], &fit.warnings[..]].concat();
    let warned: Vec<_> = fitted(study).map(|(region, fit)| (region, of(fit))).collect();
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
