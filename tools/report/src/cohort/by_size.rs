//! Values by region and insole size, with mean and standard deviation over people: charts in the form of Figs. 7 and 8 of the
//! paper, and the table of the errors.

use crate::cohort::participants::plus_minus;
use crate::cohort::title;
use crate::drawing::{self, Drawing, Scale, Tick};
use crate::format::{NONE, round_number};
use crate::region::TITLES;
use fit::cohort::SizeGroup;
use fit::trials::Moments;
use fit::variable::Variable;
use maud::{Markup, html};

/// Width of a chart.
pub const WIDTH: f64 = 260.0;
/// Width of the chart of the errors.
pub const ERRORS_WIDTH: f64 = 460.0;
const LEFT: f64 = 112.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 22.0;
/// Distance between the regions.
const GAP: f64 = 8.0;
/// Height of the mark of a size group in the [`charts`].
const CHARTS_MARK_HEIGHT: f64 = 5.0;
/// The axis of a chart of points is logarithmic if all means are positive and the largest one is more than this factor times the
/// smallest.
const LOGARITHMIC_FROM: f64 = 30.0;

/// The CSS class that sets the colour of a size group. There are six colours, for the groups from 35-36 to 45-46. If there are
/// larger sizes, the last colour is that of the largest group; otherwise, if there are smaller sizes, the first one is that of
/// the smallest group. So only the groups of people with more than twelve successive sizes share a colour.
fn colour(groups: &[SizeGroup], group: &SizeGroup) -> String {
    let sizes = || groups.iter().map(|group| group.smaller_eur);
    let first_eur = match sizes().max() {
        Some(largest_eur @ 46..) => largest_eur - 10,
        _ => sizes().min().map_or(35, |smallest_eur| smallest_eur.min(35)),
    };
    format!("s{}", usize::from(group.smaller_eur.saturating_sub(first_eur) / 2).min(5))
}

/// The form of a chart.
struct Form {
    width: f64,
    /// Height of the mark of a size group.
    mark_height: f64,
    /// True for bars that begin at 0, false for points.
    has_bars: bool,
}

/// The chart of the NRMSE (Fig. 7).
pub fn errors(groups: &[SizeGroup]) -> Drawing {
    chart(groups, Variable::nrmse(), &Form { width: ERRORS_WIDTH, mark_height: 9.0, has_bars: true })
}

/// The charts of those variables that have a value in at least one region.
pub fn charts(groups: &[SizeGroup], variables: impl Iterator<Item = Variable>) -> Vec<Drawing> {
    let has_values = |variable: &Variable| moments(groups, *variable).next().is_some();
    let form = Form { width: WIDTH, mark_height: CHARTS_MARK_HEIGHT, has_bars: false };
    variables.filter(has_values).map(|variable| chart(groups, variable, &form)).collect()
}

/// The height of one of the [`charts`].
#[cfg(feature = "png")]
pub fn height(groups: &[SizeGroup]) -> f64 {
    chart_height(groups, CHARTS_MARK_HEIGHT)
}

fn chart_height(groups: &[SizeGroup], mark_height: f64) -> f64 {
    TOP + 8.0 * row_height(groups, mark_height) + BOTTOM
}

/// Height of the row of a region, with the gap to the next one.
fn row_height(groups: &[SizeGroup], mark_height: f64) -> f64 {
    (groups.len() as f64 * mark_height).max(9.0) + GAP
}

/// The moments of a variable, for all regions and groups that have values.
fn moments<'g>(groups: &'g [SizeGroup], variable: Variable) -> impl Iterator<Item = Moments> + 'g {
    (0..8).flat_map(move |region| groups.iter().filter_map(move |group| group.moments(region, variable)))
}

fn chart(groups: &[SizeGroup], variable: Variable, form: &Form) -> Drawing {
    let title = title(variable);
    let scale = scale(groups, variable, form);
    let row_height = row_height(groups, form.mark_height);
    let height = chart_height(groups, form.mark_height);
    let bottom = height - BOTTOM;
    Drawing {
        width: form.width,
        height,
        label: format!("{title}, by region and insole size, mean with standard deviation"),
        body: html! {
            text.strong x="2" y="13" { (title) }
            @for Tick { position, label } in scale.ticks(if form.width > WIDTH { 6 } else { 4 }, round_number) {
                @let x = format!("{position:.1}");
                path.grid d={ "M" (x) " " (TOP) "V" (bottom) } {}
                text.middle x=(x) y=(bottom + 14.0) { (label) }
            }
            path.axis d={ "M" (LEFT) " " (bottom) "H" (form.width - RIGHT) } {}
            @for region in 0..8 {
                @let top = TOP + region as f64 * row_height + GAP / 2.0;
                text.end x=(LEFT - 8.0) y=(top + (row_height - GAP) / 2.0 + 4.0) { (TITLES[region]) }
                @for (i, group) in groups.iter().enumerate() {
                    @if let Some(moments) = group.moments(region, variable) {
                        @let y = top + (i as f64 + 0.5) * (row_height - GAP) / groups.len() as f64;
                        g.(colour(groups, group)) { (mark(&scale, &moments, y, form)) }
                    }
                }
            }
        },
    }
}

/// The scale of a chart. It ends above the ranges of the standard deviations. A linear scale contains 0: it begins there or, if a
/// mean is negative, below these ranges. A logarithmic scale begins below these ranges, but not far below a third of the smallest
/// mean. It has no 0, where bars begin, so it is used for points only.
fn scale(groups: &[SizeGroup], variable: Variable, form: &Form) -> Scale {
    let positions = [LEFT, form.width - RIGHT];
    let (mut means, mut ends) = ([f64::MAX, f64::MIN], [f64::MAX, f64::MIN]);
    for Moments { mean, deviation, .. } in moments(groups, variable) {
        let deviation = deviation.unwrap_or(0.0);
        means = [means[0].min(mean), means[1].max(mean)];
        ends = [ends[0].min(mean - deviation), ends[1].max(mean + deviation)];
    }
    if means[0] > means[1] {
        return Scale::linear([0.0, 1.0], positions);
    }
    if !form.has_bars && means[0] > 0.0 && means[1] > LOGARITHMIC_FROM * means[0] {
        return Scale::logarithmic([ends[0].max(means[0] / 3.0) / 1.1, ends[1] * 1.1], positions, false);
    }
    let [low, high] = [if means[0] >= 0.0 { 0.0 } else { ends[0] }, ends[1].max(0.0)];
    let margin = 0.05 * (high - low).max(1e-3);
    Scale::linear([if low < 0.0 { low - margin } else { low }, high + margin], positions)
}

/// The mean, as a bar or a point, and the range of the standard deviation, with an arrow if the range begins below the scale.
fn mark(scale: &Scale, Moments { mean, deviation, .. }: &Moments, y: f64, form: &Form) -> Markup {
    let x = scale.at(*mean);
    html! {
        @if form.has_bars {
            rect.fill.own x=(LEFT) y=(y - form.mark_height / 2.0 + 0.5) width=(format!("{:.1}", x - LEFT))
                height=(form.mark_height - 1.0) {}
        } @else {
            circle.fill cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) r="2.4" {}
        }
        @if let Some(sd) = deviation {
            path.line d=(format!("M{:.1} {y:.1}H{:.1}", scale.at(mean - sd), scale.at(mean + sd))) {}
            @if scale.is_beyond(mean - sd) { path.fill d=(format!("M{:.1} {y:.1}l5 -2.5v5z", LEFT - 1.0)) {} }
        }
    }
}

/// The legend of the sizes, with the numbers of people.
pub fn legend(groups: &[SizeGroup]) -> Vec<Drawing> {
    drawing::legend_entries(groups.iter().map(|group| {
        let mark =
            html! { g.(colour(groups, group)) { path.line d="M1 9h22" {} circle.fill cx="12" cy="9" r="3.2" {} } };
        (mark, format!("{} ({})", group.name().replace('-', "–"), group.people.len()))
    }))
}

/// The table of the NRMSE.
pub fn table(groups: &[SizeGroup]) -> Markup {
    html! {
        table #errors-by-size {
            caption {
                "NRMSE (Eq. 20) in % of the peak force of the region: mean ± standard deviation over participants. If not all \
                 participants of a column have a value, the number of those who have one follows in parentheses"
            }
            thead {
                tr {
                    th scope="col" { "Region" }
                    @for group in groups { th scope="col" { (group.name().replace('-', "–")) " (" (group.people.len()) ")" } }
                }
            }
            tbody {
                @for region in 0..8 {
                    tr {
                        th scope="row" { (TITLES[region]) }
                        @for group in groups {
                            td {
                                @match group.moments(region, Variable::nrmse()) {
                                    Some(moments) => {
                                        (plus_minus(&moments, |value| format!("{value:.1}")))
                                        (group.count_unless_all(&moments))
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
