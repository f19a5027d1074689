//! NRMSE (Eq. 20) by region, as bars (Fig. 7 of the paper) and as a table (Table 2 of the paper).

use crate::drawing::{self, Drawing, Scale, Tick, paragraph, tick};
use crate::format::{NONE, percent, signed_percent};
use crate::region::{PAPER_NRMSE, TITLES, colour, fit_of, fitted};
use fit::{Quality, Study};
use maud::{Markup, html};

/// Width of the drawing.
pub const WIDTH: f64 = 430.0;
const LEFT: f64 = 104.0;
const RIGHT: f64 = 30.0;
/// Height of a bar.
const BAR: f64 = 9.0;
/// Height of the row of a region.
const ROW: f64 = 4.0 * BAR + 15.0;
const TOP: f64 = 4.0;

/// The four errors in the chart, with the names of the fields of [`Quality`], and the CSS classes of their bars: the errors of
/// parameters that were fitted to all steps, to the step itself, and to the other steps, and of the best non-decreasing function
/// of the contact area.
const ERRORS: [(&str, &str); 4] =
    [("fitted", "fill"), ("own", "fill own"), ("predicted", "fill predicted"), ("floor", "fill floor")];

/// The errors as fractions, in the order of [`ERRORS`].
fn errors(quality: &Quality) -> [Option<f64>; 4] {
    [Some(quality.fitted), Some(quality.own), quality.predicted, Some(quality.floor)]
}

/// The chart with up to four bars for each region, and the value in Table 2 of the paper as a mark.
pub fn bars(study: &Study) -> Drawing {
    let all = fitted(study).flat_map(|(_, fit)| errors(&fit.quality)).flatten().map(|share| share * 100.0);
    let largest = all.chain(PAPER_NRMSE).filter(|percent| percent.is_finite()).fold(0.0, f64::max);
    let scale = Scale::linear([0.0, 1.02 * largest], [LEFT, WIDTH - RIGHT]);
    let bottom = TOP + 8.0 * ROW;
    Drawing {
        width: WIDTH,
        height: bottom + 34.0,
        label: "NRMSE by region: fitted, own, predicted, floor, and the value of the paper for one participant".into(),
        body: html! {
            @for Tick { position, label } in scale.ticks(6, tick) {
                path.grid d={ "M" (position) " " (TOP) "V" (bottom) } {}
                text.middle x=(position) y=(bottom + 14.0) { (label) }
            }
            text.soft.end x=(WIDTH - RIGHT) y=(bottom + 28.0) { "NRMSE, % of peak force" }
            @for region in 0..8 {
                @let top = TOP + region as f64 * ROW + 11.0;
                text.end x=(LEFT - 8.0) y=(top + 2.0 * BAR + 4.0) { (TITLES[region]) }
                @match fit_of(study, region) {
                    Ok(fit) => @for (i, error) in errors(&fit.quality).into_iter().enumerate() {
                        @if let Some(share) = error.filter(|share| share.is_finite()) {
                            @let right = scale.at(share * 100.0);
                            g.(colour(region)) { (bar(ERRORS[i].1, top + i as f64 * BAR, right)) }
                            text.small x=(format!("{:.1}", right + 3.0)) y=(top + (i + 1) as f64 * BAR - 1.2) { (percent(share)) }
                        }
                    },
                    Err(reason) =>
                        (paragraph(&format!("not fitted: {reason}"), LEFT + 6.0, top + BAR + 2.0, 58, "small")),
                }
                (mark(scale.at(PAPER_NRMSE[region]), top))
            }
            path.axis d={ "M" (LEFT) " " (TOP) "V" (bottom) } {}
        },
    }
}

fn bar(class: &str, top: f64, right: f64) -> Markup {
    let width = format!("{:.1}", right - LEFT);
    html! { rect class=(class) x=(LEFT) y=(top + 0.5) width=(width) height=(BAR - 1.0) {} }
}

/// The mark for the value of the paper: a triangle that points down at the upper edge of the bars, `bars_top`.
fn mark(x: f64, bars_top: f64) -> Markup {
    html! { path.fill d=(format!("M{x:.1} {:.1}l-4 -7h8z", bars_top - 0.5)) {} }
}

/// The legend of the bars and the mark.
pub fn legend() -> Vec<Drawing> {
    let bars =
        ERRORS.map(|(name, class)| (html! { rect class=(class) x="1" y="5" width="22" height=(BAR - 1.0) {} }, name));
    let paper = (mark(12.0, 13.0), "paper (Table 2)");
    drawing::legend_entries(bars.into_iter().chain([paper]))
}

/// The table of the errors. It includes errors that are not in the chart.
pub fn table(study: &Study) -> Markup {
    html! {
        table #nrmse {
            caption { "NRMSE (Eq. 20) in % of the peak force of the region, mean over its steps" }
            thead {
                tr {
                    th scope="col" rowspan="2" { "Region" }
                    th scope="col" rowspan="2" { "Steps" }
                    th scope="colgroup" colspan="2" { "Fitted to all" }
                    th scope="colgroup" colspan="2" { "Own step" }
                    th scope="col" rowspan="2" { "Predicted" br; "raw" }
                    th scope="col" rowspan="2" { "Floor" br; "raw" }
                    th scope="col" rowspan="2" { "Bias at" br; "peak, %" }
                    th scope="col" rowspan="2" { "Paper," br; "Table 2" }
                }
                tr {
                    @for _ in 0..2 {
                        th scope="col" { "raw" }
                        th scope="col" { "smoothed" }
                    }
                }
            }
            tbody {
                @for region in 0..8 {
                    tr {
                        th scope="row" { (TITLES[region]) }
                        @match fit_of(study, region) {
                            Ok(fit) => {
                                @let q = &fit.quality;
                                td { (fit.steps.len()) }
                                @for share in [q.fitted, q.fitted_smoothed, q.own, q.own_smoothed] {
                                    td { (percent(share)) }
                                }
                                td { (q.predicted.map_or(NONE.into(), percent)) }
                                td { (percent(q.floor)) }
                                td { (signed_percent(q.peak_bias)) }
                            }
                            Err(reason) => td.reason colspan="8" { "Not fitted: " (reason) },
                        }
                        td { (format!("{:.1}", PAPER_NRMSE[region])) }
                    }
                }
            }
        }
    }
}
