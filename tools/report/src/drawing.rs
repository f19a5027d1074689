//! SVG drawings, and scales and axes of charts. Lengths are in units of the view box, about a pixel on a screen.

use crate::format::{lines, number};
use maud::{Markup, html};
use std::fmt::Write;

/// The style sheet of the drawings, in the page and in the picture.
pub const STYLE: &str = include_str!("drawing.css");

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
        width: 42.0 + 6.6 * meaning.chars().count() as f64,
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

/// Distance from the position of 0 to the start of a logarithmic scale.
const ZERO_GAP: f64 = 24.0;

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

    /// Round values within the scale for about `wanted` ticks.
    pub fn ticks(&self, wanted: usize) -> Vec<f64> {
        let [low, high] = self.values;
        let round = |digits: &[f64]| -> Vec<f64> {
            let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
            let all = decades.flat_map(|e| digits.iter().map(move |digit| digit * 10f64.powi(e)));
            all.filter(|tick| (low * 0.999..=high * 1.001).contains(tick)).collect()
        };
        if self.kind != Kind::Linear {
            let fine = round(&[1.0, 2.0, 5.0]);
            let decades = round(&[1.0]);
            let every = decades.len().div_ceil(wanted + 1).max(1);
            return if fine.len() <= wanted + 1 { fine } else { decades.into_iter().step_by(every).collect() };
        }
        let rough = (high - low) / wanted as f64;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|s| s * decade).into_iter().find(|s| *s >= 0.999 * rough);
        let step = step.unwrap_or(rough);
        let first = (low / step - 1e-6).ceil() as i64;
        let last = (high / step + 1e-6).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
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
            @for value in self.y.ticks(3) {
                @let y = self.y.at(value);
                path.grid d={ "M" (left) " " (y) "H" (right) } {}
                text.end x=(left - 5.0) y=(y + 3.5) { (tick(value)) }
            }
            @for value in self.x.ticks(4) {
                @let x = self.x.at(value);
                path.axis d={ "M" (x) " " (bottom) "v3" } {}
                text.middle x=(x) y=(bottom + 14.0) { (tick(value)) }
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
