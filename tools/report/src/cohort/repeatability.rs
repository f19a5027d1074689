//! The repeatability of the values between trials: a chart of the ICC, and tables.

use crate::cohort::title;
use crate::drawing::{self, Drawing, Scale};
use crate::format::{NONE, number, round_number};
use crate::region::{TITLES, colour};
use fit::agreement::{Agreement, FootRepeatability, VariableRow};
use maud::{Markup, html};

/// Width of the chart.
pub const WIDTH: f64 = 560.0;
const LEFT: f64 = 208.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 26.0;
const ROW: f64 = 15.0;
const BOTTOM: f64 = 34.0;
/// The smallest ICC of the scale. Smaller values are drawn as arrows.
const LEAST: f64 = -0.2;

/// The rows that have a value in at least one region.
fn rows(foot: &FootRepeatability) -> impl Iterator<Item = &VariableRow> {
    foot.rows.iter().filter(|row| row.regions.iter().any(Option::is_some))
}

/// The chart of the ICC of each variable, with a point for each region and a line at the median.
pub fn chart(foot: &FootRepeatability) -> Drawing {
    let heading = format!("ICC(2,1), {}", foot.comparison());
    let scale = Scale::linear([LEAST, 1.0], [LEFT, WIDTH - RIGHT]);
    let bottom = TOP + rows(foot).count() as f64 * ROW;
    Drawing {
        width: WIDTH,
        height: bottom + BOTTOM,
        label: format!("{heading}, by variable and region"),
        body: html! {
            text.strong x="2" y="13" { (heading) }
            @for value in [LEAST, 0.0, 0.25, 0.5, 0.75, 0.9, 1.0] {
                path.grid d={ "M" (format!("{:.1}", scale.at(value))) " " (TOP) "V" (bottom) } {}
                text.middle x=(format!("{:.1}", scale.at(value))) y=(bottom + 14.0) { (round_number(value)) }
            }
            path.axis d={ "M" (LEFT) " " (bottom) "H" (WIDTH - RIGHT) } {}
            text.soft.end x=(WIDTH - RIGHT) y=(bottom + 28.0) { "ICC(2,1)" }
            @for (i, row) in rows(foot).enumerate() {
                @let y = TOP + (i as f64 + 0.5) * ROW;
                text.end x=(LEFT - 8.0) y=(y + 4.0) { (row.variable.title().0) }
                @for region in 0..8 {
                    @if let Some(icc) = row.regions[region].and_then(|agreement| agreement.icc) {
                        g.(colour(region)) { (point(&scale, icc, y)) }
                    }
                }
                @if let Some(median) = row.median(|agreement| agreement.icc) {
                    @let x = format!("{:.1}", scale.at(median));
                    path.model d={ "M" (x) " " (y - 5.5) "v11" } {}
                }
            }
        },
    }
}

/// A point, or an arrow for a value below the scale.
fn point(scale: &Scale, icc: f64, y: f64) -> Markup {
    let x = scale.at(icc);
    html! {
        @if scale.is_beyond(icc) {
            path.fill d=(format!("M{:.1} {y:.1}l6 -3v6z", x - 3.0)) {}
        } @else {
            circle.fill.own cx=(format!("{x:.1}")) cy=(y) r="3.4" {}
        }
    }
}

/// The legend of the chart.
pub fn legend() -> Vec<Drawing> {
    let regions = (0..8)
        .map(|region| (html! { g.(colour(region)) { circle.fill.own cx="19" cy="9" r="3.8" {} } }, TITLES[region]));
    let median = (html! { path.model d="M19 3v12" {} }, "median of the regions");
    drawing::legend_entries(regions.chain([median]))
}

/// The medians over the regions.
pub fn medians(foot: &FootRepeatability) -> Markup {
    html! {
        table.medians {
            caption { "Repeatability, " (foot.comparison()) ": medians over the regions. " (foot.mdc_note()) }
            thead {
                tr {
                    @for title in ["Variable", "Regions", "ICC(2,1)", "SEM", "MDC", "MDC, % of mean"] { th scope="col" { (title) } }
                }
            }
            tbody {
                @for row in rows(foot) {
                    @let median = |of: &dyn Fn(&Agreement) -> f64| {
                        row.median(|agreement| Some(of(agreement))).map_or(NONE.into(), number)
                    };
                    tr {
                        th scope="row" { (title(row.variable)) }
                        td { (row.regions.iter().flatten().count()) }
                        td { (row.median(|agreement| agreement.icc).map_or(NONE.into(), coefficient)) }
                        td { (median(&|agreement| agreement.sem)) }
                        td { (median(&|agreement| agreement.mdc)) }
                        td { (row.median(Agreement::mdc_percent).map_or(NONE.into(), number)) }
                    }
                }
            }
        }
    }
}

/// ICC, SEM and MDC by region.
pub fn by_region(foot: &FootRepeatability) -> Markup {
    html! {
        table.dense.regions {
            caption {
                "Repeatability by region, " (foot.side.name()) " foot. First line: ICC(2,1), and in parentheses the number of \
                 participants with a value in all compared trials, if it is not " (foot.people.len()) ". Below: SEM and MDC in \
                 the unit of the variable"
            }
            thead { tr { th scope="col" { "Variable" } @for title in TITLES { th scope="col" { (title) } } } }
            tbody {
                @for row in rows(foot) {
                    tr {
                        th scope="row" { (title(row.variable)) }
                        @for agreement in &row.regions {
                            td {
                                @match agreement {
                                    Some(agreement) => {
                                        strong { (agreement.icc.map_or(NONE.into(), coefficient)) }
                                        @if agreement.people < foot.people.len() { " (" (agreement.people) ")" }
                                        br;
                                        span.range { (number(agreement.sem)) }
                                        br;
                                        span.range { (number(agreement.mdc)) }
                                    }
                                    None => (NONE),
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn coefficient(icc: f64) -> String {
    format!("{icc:.2}").replace('-', "−")
}
