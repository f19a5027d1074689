//! SVG drawings, and scales and axes of charts. Lengths are in units of the view box, about a pixel on a screen.

use crate::format::{lines, number};
use maud::{Markup, html};
use std::fmt::Write;

/// The style sheet of the drawings, in the page and in the picture.
pub const STYLE: &str = include_str!("drawing.css");
/// Width of a character. The fonts of viewers differ; most characters are narrower.
const CHARACTER: f64 = 6.6;
/// Height of a line of text.
const LINE: f64 = 13.0;
/// Smallest distance between the labels of two ticks.
const LABEL_GAP: f64 = 2.0;

/// A drawing that can be used on its own or within a larger one.
pub struct Drawing {
    /// Width in units of the view box.
    pub width: f64,
    /// Height in units of the view box.
    pub height: f64,
    /// Text alternative.
    pub label: String,
    /// The elements.
    pub body: Markup,
}

impl Drawing {
    /// The drawing on its own, scaled to the width that the page gives it.
    pub fn svg(&self) -> Markup {
        html! {
            svg.drawing viewBox={ "0 0 " (self.width) " " (self.height) } role="img" aria-label=(self.label) { (self.body) }
        }
    }

    /// The drawing within a larger one, with its upper left corner at `(x, y)`.
    pub fn at(&self, x: f64, y: f64) -> Markup {
        html! { g transform={ "translate(" (x) " " (y) ")" } { (self.body) } }
    }
}

/// The entries of a legend, each a mark, drawn in 26 x 18 units, with its meaning.
pub fn legend_entries<Text: AsRef<str>>(marks: impl IntoIterator<Item = (Markup, Text)>) -> Vec<Drawing> {
    marks.into_iter().map(|(mark, meaning)| legend_entry(mark, meaning.as_ref())).collect()
}

fn legend_entry(mark: Markup, meaning: &str) -> Drawing {
    Drawing {
        width: 42.0 + width(meaning),
        height: 18.0,
        label: format!("Mark: {meaning}"),
        body: html! { (mark) text x="31" y="13" { (meaning) } },
    }
}

/// A legend in one row, with its upper left corner at `(x, y)`.
pub fn legend_row(entries: &[Drawing], mut x: f64, y: f64) -> Markup {
    html! {
        @for entry in entries {
            (entry.at(x, y))
            @let () = x += entry.width;
        }
    }
}

/// Text in lines of at most `characters`, the baseline of the first at `y`.
pub fn paragraph(text: &str, x: f64, y: f64, characters: usize, class: &str) -> Markup {
    html! {
        text class=(class) y=(y) {
            @for (i, line) in lines(text, characters).iter().enumerate() {
                tspan x=(x) dy=(if i == 0 { "0" } else { "1.25em" }) { (line) }
            }
        }
    }
}

/// A cell as an SVG path in mm: a square, because only its area is known, with a margin to its neighbours.
pub fn square(x_mm: f64, y_mm: f64, area_mm2: f64) -> String {
    let side_mm = 0.92 * area_mm2.sqrt();
    let (left, low) = (x_mm - side_mm / 2.0, y_mm - side_mm / 2.0);
    format!("M{left:.2} {low:.2}h{side_mm:.2}v{side_mm:.2}h-{side_mm:.2}z")
}

/// The drawing for a region that was not fitted. `title` begins its text alternative.
pub fn unfitted(width: f64, height: f64, title: &str, reason: &str) -> Drawing {
    Drawing {
        width,
        height,
        label: format!("{title}: not fitted, {reason}"),
        body: html! {
            rect.empty x="1" y="1" width=(width - 2.0) height=(height - 2.0) rx="4" {}
            text.strong x="14" y="28" { "Not fitted" }
            (paragraph(reason, 14.0, 46.0, (width / 6.2) as usize, ""))
        },
    }
}

/// Width of a text of one line.
fn width(text: &str) -> f64 {
    CHARACTER * text.chars().count() as f64
}

/// A tick of an axis.
pub struct Tick {
    /// Position on the axis.
    pub position: f64,
    /// The value as text.
    pub label: String,
}

/// A function that returns the text for a value.
pub type Label = fn(f64) -> String;

/// A mapping from values to positions.
pub struct Scale {
    values: [f64; 2],
    positions: [f64; 2],
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Linear,
    Logarithmic,
    /// Logarithmic; the position of 0 is [`ZERO_GAP`] units before the smallest value.
    LogarithmicAndZero,
}

/// Distance from the position of 0 to the start of a logarithmic scale. It has room for the label 0 and one of six characters.
const ZERO_GAP: f64 = 26.0;

impl Scale {
    /// A linear scale from the range of values to the range of positions.
    pub fn linear(values: [f64; 2], positions: [f64; 2]) -> Self {
        Self { values, positions, kind: Kind::Linear }
    }

    /// A logarithmic scale from the range of values, which are positive, to the range of positions. With `has_zero`, the scale
    /// also has a position for 0, which is the first position.
    pub fn logarithmic(values: [f64; 2], [first, last]: [f64; 2], has_zero: bool) -> Self {
        match has_zero {
            true => Self { values, positions: [first + ZERO_GAP, last], kind: Kind::LogarithmicAndZero },
            false => Self { values, positions: [first, last], kind: Kind::Logarithmic },
        }
    }

    /// The position of a value. A value outside of the scale has the position of the nearer end.
    pub fn at(&self, value: f64) -> f64 {
        if self.is_zero(value) {
            return self.positions[0] - ZERO_GAP;
        }
        let [low, high] = self.values;
        let value = value.clamp(low, high);
        let share = match self.kind {
            Kind::Linear => (value - low) / (high - low),
            _ => (value / low).ln() / (high / low).ln(),
        };
        self.positions[0] + share * (self.positions[1] - self.positions[0])
    }

    fn is_zero(&self, value: f64) -> bool {
        self.kind == Kind::LogarithmicAndZero && value <= 0.0
    }

    /// True for values outside of the scale.
    pub fn is_beyond(&self, value: f64) -> bool {
        !(self.values[0]..=self.values[1]).contains(&value) && !self.is_zero(value)
    }

    /// The ticks of a horizontal axis at round values, about `wanted` and at least two, with labels that do not overlap. A linear
    /// scale contains 0, and the ends of a logarithmic one differ by a factor of at least 5. The position for 0 of a logarithmic
    /// scale, if it has one, is an additional tick. A linear scale with equal ends has no ticks.
    pub fn ticks(&self, wanted: usize, label: Label) -> Vec<Tick> {
        self.ticks_along(wanted, label, width)
    }

    /// As [`Scale::ticks`]. `extent` is the length of a label along the axis: its width, or its height for a vertical axis.
    fn ticks_along(&self, wanted: usize, label: Label, extent: fn(&str) -> f64) -> Vec<Tick> {
        let place = |value: f64| Tick { position: self.at(value), label: label(value) };
        let are_apart = |pair: &[Tick]| {
            let extents = extent(&pair[0].label) + extent(&pair[1].label);
            (pair[1].position - pair[0].position).abs() >= extents / 2.0 + LABEL_GAP
        };
        let zero = (self.kind == Kind::LogarithmicAndZero).then_some(0.0);
        let with_zero = |values: Vec<f64>| zero.into_iter().chain(values).map(place).collect::<Vec<_>>();
        let least = 2 + usize::from(zero.is_some());
        let is_readable = |ticks: &Vec<Tick>| ticks.len() >= least && ticks.windows(2).all(are_apart);
        let sets = self.round_values(wanted);
        // If the labels of each set overlap, the first and the last value of a set have the most room.
        let ends = sets.iter().filter_map(|set| Some(vec![*set.first()?, *set.last()?]));
        let mut all = sets.iter().cloned().chain(ends).map(with_zero);
        all.find(is_readable).unwrap_or_else(|| with_zero(Vec::new()))
    }

    /// Sets of round values within the scale, in the order of preference for about `wanted` ticks.
    fn round_values(&self, wanted: usize) -> Vec<Vec<f64>> {
        let [low, high] = self.values;
        if self.kind == Kind::Linear {
            let rough = (high - low) / wanted as f64;
            // The multiples of a smaller step cannot be counted.
            if rough < f64::MIN_POSITIVE {
                return Vec::new();
            }
            let decade = 10f64.powf(rough.log10().floor());
            let steps = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0].map(|step| step * decade);
            let multiples = |step: &f64| -> Vec<f64> {
                let (first, last) = ((low / step - 1e-6).ceil() as i64, (high / step + 1e-6).floor() as i64);
                (first..=last).map(|i| i as f64 * step).collect()
            };
            // Larger steps leave more room for labels; with smaller steps, a short scale has more than one tick.
            let (smaller, larger) = steps.split_at(steps.partition_point(|step| *step < 0.999 * rough));
            return larger.iter().chain(smaller.iter().rev()).map(multiples).collect();
        }
        let round = |digits: &[f64]| -> Vec<f64> {
            let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
            let all = decades.flat_map(|e| digits.iter().map(move |digit| digit * 10f64.powi(e)));
            all.filter(|tick| (low * 0.999..=high * 1.001).contains(tick)).collect()
        };
        let decades = round(&[1.0]);
        let mut sets = vec![round(&[1.0, 2.0, 5.0]), round(&[1.0, 3.0])];
        sets.extend((1..=decades.len()).map(|every| decades.iter().copied().step_by(every).collect::<Vec<_>>()));
        sets.retain(|set| set.len() <= wanted + 1);
        sets.push(round(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]));
        sets
    }
}

/// A number without trailing zeros, for ticks.
pub fn tick(value: f64) -> String {
    let text = number(value);
    if text.contains('.') && !text.contains('×') {
        text.trim_end_matches('0').trim_end_matches('.').into()
    } else {
        text
    }
}

/// The scales of a chart of curves.
pub struct Curves {
    /// The horizontal scale: time, s, in the charts of a step.
    pub x: Scale,
    /// The vertical scale: the quantity.
    pub y: Scale,
}

impl Curves {
    /// Grid, ticks and titles of the axes.
    pub fn axes(&self, x_title: &str, y_title: &str) -> Markup {
        let ([left, right], [bottom, top]) = (self.x.positions, self.y.positions);
        html! {
            @for Tick { position: y, label } in self.y.ticks_along(3, tick, |_| LINE) {
                path.grid d={ "M" (left) " " (y) "H" (right) } {}
                text.end x=(left - 5.0) y=(y + 3.5) { (label) }
            }
            @for Tick { position: x, label } in self.x.ticks(4, tick) {
                path.axis d={ "M" (x) " " (bottom) "v3" } {}
                text.middle x=(x) y=(bottom + 14.0) { (label) }
            }
            path.axis d={ "M" (left) " " (bottom) "H" (right) } {}
            text.soft x="2" y=(top - 8.0) { (y_title) }
            text.soft.end x=(right) y=(bottom + 27.0) { (x_title) }
        }
    }

    /// A line through samples as an SVG path. The first sample is at the abscissa `start`, and `every` is the distance between
    /// samples, both in the unit of the horizontal scale.
    pub fn line(&self, start: f64, every: f64, values: &[f64]) -> String {
        self.path(start, every, values, |i| if i == 0 { "M" } else { "L" }, "")
    }

    /// As [`Curves::line`], but with a separate point for each sample instead of a line through them.
    pub fn points(&self, start: f64, every: f64, values: &[f64]) -> String {
        self.path(start, every, values, |_| "M", "h0")
    }

    fn path(&self, start: f64, every: f64, values: &[f64], before: fn(usize) -> &'static str, after: &str) -> String {
        let mut path = String::new();
        for (i, value) in values.iter().enumerate() {
            let (x, y) = (self.x.at(start + i as f64 * every), self.y.at(*value));
            // Writing to a String does not fail.
            let _ = write!(path, "{}{x:.1} {y:.1}{after}", before(i));
        }
        path
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::round_number;

    /// Values in geometric progression.
    fn values(first: f64, last: f64) -> impl Iterator<Item = f64> {
        std::iter::successors(Some(first), |value| Some(value * 1.09)).take_while(move |value| *value < last)
    }

    /// Checks that a scale has at least two labelled ticks, and that no label overlaps the next one.
    fn check(scale: &Scale, ticks: &[Tick], extent: fn(&str) -> f64) {
        let labels: Vec<_> = ticks.iter().map(|tick| &tick.label).collect();
        let zeros = usize::from(scale.kind == Kind::LogarithmicAndZero);
        assert!(ticks.len() >= 2 + zeros, "{:?}: {labels:?}", scale.values);
        for pair in ticks.windows(2) {
            let distance = (pair[1].position - pair[0].position).abs();
            let extents = extent(&pair[0].label) + extent(&pair[1].label);
            assert!(distance >= extents / 2.0, "{:?} in {:?}: {labels:?}", scale.values, scale.positions);
        }
    }

    /// The lengths of the horizontal axes of the report, with the wanted number of ticks and the text of a value.
    const AXES: [(f64, usize, Label); 6] = [
        (134.0, 3, round_number),
        (134.0, 4, round_number),
        (206.0, 4, tick),
        (216.0, 4, tick),
        (296.0, 6, tick),
        (334.0, 6, round_number),
    ];

    #[test]
    fn a_linear_axis_has_two_or_more_labels_that_do_not_overlap() {
        let below = [0.0, 0.001, 0.02, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 1.0, 1.1, 1.5, 2.0, 5.0, 50.0, 1000.0];
        for end in values(1e-4, 1e8) {
            let ranges = below.map(|below| [-below * end, end]).into_iter().chain([[-end, 0.0]]);
            for range in ranges {
                for (length, wanted, label) in AXES {
                    let scale = Scale::linear(range, [0.0, length]);
                    check(&scale, &scale.ticks(wanted, label), width);
                }
            }
            for height in [74.0, 108.0, 118.0] {
                let scale = Scale::linear([0.0, end], [height, 0.0]);
                check(&scale, &scale.ticks_along(3, tick, |_| LINE), |_| LINE);
            }
        }
    }

    #[test]
    fn a_linear_axis_without_extent_has_no_ticks() {
        for end in [0.0, f64::from_bits(1)] {
            assert!(Scale::linear([0.0, end], [0.0, 134.0]).ticks(4, tick).is_empty());
        }
    }

    #[test]
    fn a_logarithmic_axis_has_two_or_more_labels_that_do_not_overlap() {
        let ratios = [5.0, 5.5, 7.0, 9.9, 12.0, 20.0, 33.0, 50.0, 99.0, 150.0, 990.0, 1e4, 1e6, 1e8];
        for low in values(1e-6, 1e8) {
            for (ratio, has_zero) in ratios.into_iter().flat_map(|ratio| [(ratio, false), (ratio, true)]) {
                for (length, wanted) in [(134.0, 3), (134.0, 4), (334.0, 6)] {
                    let scale = Scale::logarithmic([low, ratio * low], [0.0, length], has_zero);
                    check(&scale, &scale.ticks(wanted, round_number), width);
                }
            }
        }
    }
}
