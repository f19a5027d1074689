//! A part of a measurement, by its times.

use crate::text::seconds;
use crate::{Error, Result};
use std::ops::Range;
use std::path::Path;

/// The first and the last time of frames, s, on the clock of a recording or, for an import, of the recording that an import of
/// all frames results in. The default is the whole measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Earlier frames are left out.
    pub from_s: f64,
    /// Later frames are left out.
    pub to_s: f64,
}

impl Default for Span {
    fn default() -> Self {
        Self { from_s: f64::NEG_INFINITY, to_s: f64::INFINITY }
    }
}

impl Span {
    /// The span between these times, s; without one of them, from the beginning or to the end.
    ///
    /// # Errors
    /// Fails if the first time is not before the last one.
    pub fn new(from_s: Option<f64>, to_s: Option<f64>) -> Result<Self> {
        let all = Self::default();
        let span = Self { from_s: from_s.unwrap_or(all.from_s), to_s: to_s.unwrap_or(all.to_s) };
        if span.from_s < span.to_s {
            return Ok(span);
        }
        Err(Error::content(
            format!("from {} s to {} s", span.from_s, span.to_s),
            "the part does not end after it begins",
            "state two times in this order",
        ))
    }

    /// The range of the frames within this span, of frames with increasing times `t_s`, and a sentence about it; `None` if these
    /// are all frames.
    ///
    /// # Errors
    /// Fails if no frame is within the span. The message names `path` and the times of the frames.
    pub(crate) fn part(self, t_s: &[f64], path: &Path) -> Result<Option<(Range<usize>, String)>> {
        let start = t_s.partition_point(|&t_s| t_s < self.from_s);
        let end = t_s.partition_point(|&t_s| t_s <= self.to_s);
        let (Some(&first_s), Some(&last_s)) = (t_s.first(), t_s.last()) else { return Ok(None) };
        if start >= end {
            return Err(Error::content(
                path.display().to_string(),
                format!(
                    "no frame {}; the frames are from {} to {} s",
                    self.in_words(),
                    seconds(first_s),
                    seconds(last_s)
                ),
                "state times within these",
            ));
        }
        let left_out = t_s.len() - (end - start);
        let sentence = || {
            format!(
                "The recording has only the frames {} of this measurement. Frames that were left out: {left_out}.",
                self.in_words()
            )
        };
        Ok((left_out > 0).then(|| (start..end, sentence())))
    }

    fn in_words(self) -> String {
        match (self.from_s.is_finite(), self.to_s.is_finite()) {
            (true, true) => format!("from {} to {} s", seconds(self.from_s), seconds(self.to_s)),
            (true, false) => format!("from {} s", seconds(self.from_s)),
            _ => format!("up to {} s", seconds(self.to_s)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ends_belong_to_the_span() {
        let t_s = [0.0, 0.5, 1.0, 1.5, 2.0];
        let part = |from_s, to_s| Span { from_s, to_s }.part(&t_s, Path::new("walk.txt")).expect("frames");
        let (range, sentence) = part(0.5, 1.5).expect("a part");
        assert_eq!(range, 1..4);
        assert_eq!(
            sentence,
            "The recording has only the frames from 0.5 to 1.5 s of this measurement. Frames that were left out: 2."
        );
        assert_eq!(part(0.0, 2.0), None);
        assert_eq!(part(1.1, f64::INFINITY).map(|(range, _)| range), Some(3..5));
    }

    #[test]
    fn a_span_without_frames_is_refused_with_the_times_of_the_export() {
        let span = Span { from_s: 3.0, to_s: f64::INFINITY };
        let message = span.part(&[0.0, 1.0], Path::new("walk.txt")).expect_err("a refusal").to_string();
        assert!(message.starts_with("walk.txt: no frame from 3 s; the frames are from 0 to 1 s"), "{message}");
    }
}
