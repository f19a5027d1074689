//! A chart of one value by region, with its 95 % intervals.

use crate::drawing::{Drawing, Scale, Tick};
use crate::format::round_number;
use crate::region::{TITLES, colour};
use maud::{Markup, html};

/// Width of a chart.
pub const WIDTH: f64 = 260.0;
/// Height of a chart.
pub const HEIGHT: f64 = TOP + 8.0 * ROW + 22.0;
const LEFT: f64 = 112.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 26.0;
const ROW: f64 = 21.0;

/// A chart with a row for each region.
pub struct IntervalChart {
    /// Title with the unit.
    pub title: String,
    /// True if the axis is logarithmic.
    pub is_logarithmic: bool,
    /// The rows, in the order of the regions.
    pub rows: [Row; 8],
}

/// The row of a region.
pub enum Row {
    /// A value with its intervals, all in the unit of the chart.
    Value {
        value: f64,
        mark: Mark,
        /// The interval that is drawn as a broad line.
        broad: Option<[f64; 2]>,
        /// The interval that is drawn as a thin line.
        thin: Option<[f64; 2]>,
    },
    /// The reason why there is no value.
    Text(String),
}

/// The mark of a value.
#[derive(Clone, Copy, PartialEq)]
pub enum Mark {
    /// An estimate.
    Point,
    /// An estimate at a bound of the search.
    Bound,
    /// A value that the data do not determine.
    Undetermined,
}

impl Mark {
    /// Draws the mark with its centre at `(x, y)`.
    pub fn at(self, x: f64, y: f64) -> Markup {
        html! {
            @match self {
                Self::Point => circle.fill cx=(format!("{x:.1}")) cy=(y) r="3.2" {},
                Self::Bound => path.hollow d=(format!("M{x:.1} {:.1}l5 5l-5 5l-5 -5z", y - 5.0)) {},
                Self::Undetermined => circle.hollow cx=(format!("{x:.1}")) cy=(y) r="3.4" {},
            }
        }
    }
}

impl IntervalChart {
    /// The drawing.
    pub fn draw(&self) -> Drawing {
        let scale = self.scale();
        let bottom = TOP + 8.0 * ROW;
        Drawing {
            width: WIDTH,
            height: HEIGHT,
            label: format!("{}, by region with 95 % confidence intervals", self.title),
            body: html! {
                text.strong x="2" y="13" { (self.title) }
                @for Tick { position, label } in scale.ticks(3, round_number) {
                    @let x = format!("{position:.1}");
                    path.grid d={ "M" (x) " " (TOP) "V" (bottom) } {}
                    text.middle x=(x) y=(bottom + 14.0) { (label) }
                }
                path.axis d={ "M" (LEFT) " " (bottom) "H" (WIDTH - RIGHT) } {}
                @for (region, row) in self.rows.iter().enumerate() {
                    @let y = TOP + (region as f64 + 0.5) * ROW;
                    text.end x=(LEFT - 8.0) y=(y + 4.0) { (TITLES[region]) }
                    @match row {
                        Row::Value { value, mark, broad, thin } => g.(colour(region)) {
                            @let offset = if broad.is_some() && thin.is_some() { 3.5 } else { 0.0 };
                            @if let Some(range) = broad { (bar(&scale, *range, y - offset, "jacobian")) }
                            @if let Some(range) = thin { (bar(&scale, *range, y + offset, "line")) }
                            (mark.at(scale.at(*value), y))
                        },
                        Row::Text(text) => text.small.soft x=(LEFT + 5.0) y=(y + 3.5) { (text) },
                    }
                }
            },
        }
    }

    /// The values and the ends of their intervals.
    fn ends(&self) -> impl Iterator<Item = f64> {
        self.rows.iter().flat_map(|row| match row {
            Row::Value { value, broad, thin, .. } => {
                std::iter::once(*value).chain([broad, thin].into_iter().flatten().flatten().copied()).collect()
            }
            Row::Text(_) => Vec::new(),
        })
    }

    /// True if a value or an end of an interval is 0 on a logarithmic axis, which then also has a position for 0.
    fn has_zero(&self) -> bool {
        self.is_logarithmic && self.ends().any(|end| end <= 0.0)
    }

    /// The scale. It covers all intervals, but a logarithmic axis extends at most by a factor of 12 beyond the values, and a
    /// linear axis, which contains 0, at most by three times the range of the values and 0. The ends of a logarithmic axis differ
    /// by a factor of at least 5, so that it has two round values.
    fn scale(&self) -> Scale {
        let positions = [LEFT, WIDTH - RIGHT];
        let is_shown = |value: &f64| value.is_finite() && (*value > 0.0 || !self.is_logarithmic);
        let ends_of = |values: Vec<f64>| {
            let values = values.into_iter().filter(is_shown);
            values.fold([f64::MAX, f64::MIN], |[low, high], value| [low.min(value), high.max(value)])
        };
        let values = self.rows.iter().filter_map(|row| match row {
            Row::Value { value, .. } => Some(*value),
            Row::Text(_) => None,
        });
        let ends = ends_of(self.ends().collect());
        let estimates = match ends_of(values.collect()) {
            [low, high] if low > high => ends,
            estimates => estimates,
        };
        match (ends[0] <= ends[1], self.is_logarithmic) {
            (true, true) => {
                let low = ends[0].max(estimates[0] / 10.0) / 1.2;
                let high = (ends[1].min(estimates[1] * 10.0) * 1.2).max(5.0 * low);
                Scale::logarithmic([low, high], positions, self.has_zero())
            }
            (true, false) => {
                let beyond = 3.0 * (estimates[1].max(0.0) - estimates[0].min(0.0)).max(0.1);
                let low = ends[0].min(0.0).max(estimates[0].min(0.0) - beyond);
                Scale::linear([low, (1.05 * ends[1]).min(estimates[1] + beyond).max(0.1)], positions)
            }
            (false, true) => Scale::logarithmic([1.0, 1000.0], positions, self.has_zero()),
            (false, false) => Scale::linear([0.0, 5.0], positions),
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

/// The row of a region that was not fitted. It contains the reason up to the first colon or opening parenthesis; the tables
/// contain the complete reason.
pub fn unfitted(reason: &str) -> Row {
    Row::Text(format!("not fitted: {}", reason.split([':', '(']).next().unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The drawing of a logarithmic chart of this value in one region and 1 in the others.
    fn drawing_of(value: f64) -> String {
        let row = |region| Row::Value {
            value: if region == 0 { value } else { 1.0 },
            mark: Mark::Point,
            broad: None,
            thin: None,
        };
        let chart = IntervalChart { title: "".into(), is_logarithmic: true, rows: std::array::from_fn(row) };
        chart.draw().body.into_string()
    }

    #[test]
    fn a_logarithmic_axis_has_a_position_for_zero_if_a_value_is_zero() {
        let zero = format!("x=\"{LEFT:.1}\" y=\"{}\">0</text>", TOP + 8.0 * ROW + 14.0);
        assert!(drawing_of(0.0).contains(&zero) && drawing_of(0.0).contains(&format!("cx=\"{LEFT:.1}\"")));
        assert!(!drawing_of(0.1).contains(&zero));
    }
}
