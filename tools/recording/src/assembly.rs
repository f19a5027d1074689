//! The last stage of most imports: selects a span of time, fills short gaps between frames, and checks the recording. The
//! imports of pedar, CSV and `jiku-data` do not use it.

use crate::check::{self, At};
use crate::footprint::capitalised;
use crate::layout::MAX_CELLS;
use crate::span::Span;
use crate::{Export, Layout, Recording, Result, gaps, rate};
use plantar::Side;
use std::path::Path;

/// The content of an export as read, before this stage.
#[derive(Default)]
pub struct ParsedExport {
    pub feet: Vec<UncheckedRecording>,
    /// Becomes [`Export::remarks`].
    pub remarks: Vec<String>,
}

impl ParsedExport {
    /// The recordings of all feet, of the frames within `span`.
    ///
    /// # Errors
    /// Fails in the same cases as [`UncheckedRecording::recording`].
    pub fn completed(self, path: &Path, span: Span) -> Result<Export> {
        let Self { feet, mut remarks } = self;
        let feet = feet.into_iter().map(|foot| foot.recording(path, span, &mut remarks)).collect::<Result<_>>()?;
        Ok(Export { feet, remarks })
    }
}

/// The contents of a recording that are not yet checked. Frames may be missing.
pub struct UncheckedRecording {
    pub side: Side,
    pub layout: Layout,
    /// Time of each frame, increasing, s.
    pub t_s: Vec<f64>,
    /// All cells of the first frame, then those of the second one, and so on.
    pub pressure_kpa: Vec<f32>,
    /// Provenance, in sentences.
    pub source: String,
}

impl UncheckedRecording {
    /// The recording of the frames within `span`, with gaps treated as by [`gaps::fill`]: short ones are filled; if there are
    /// longer ones, only the longest part without one remains. If there are more than [`MAX_CELLS`], neighbouring cells are
    /// merged. Sentences about these steps are added to `remarks`.
    ///
    /// # Errors
    /// Fails if no frame is within the span, the frames or the cells violate a rule of recordings, or the frames do not fit into
    /// memory when gaps are filled. Messages name `path`, and the time of the frame.
    fn recording(self, path: &Path, span: Span, remarks: &mut Vec<String>) -> Result<Recording> {
        let Self { side, layout, mut t_s, mut pressure_kpa, source } = self;
        let file = path.display().to_string();
        let mut remark = |sentences: &str| remarks.push(format!("{} foot: {sentences}", capitalised(side)));
        if let Some((part, sentence)) = span.part(&t_s, path)? {
            t_s = t_s[part.clone()].to_vec();
            pressure_kpa = pressure_kpa[part.start * layout.cells.len()..part.end * layout.cells.len()].to_vec();
            remark(&sentence);
        }
        check::value_count(gaps::frames_after_fill(&t_s) as u64, layout.cells.len(), &file)?;
        if let Some(note) = gaps::fill(&mut t_s, &mut pressure_kpa, layout.cells.len()) {
            remark(&note);
        }
        t_s.iter_mut().for_each(|t_s| *t_s = rate::rounded_s(*t_s));
        // After frames were filled or left out, only the time identifies a frame of the export.
        let place = |at: At| match at {
            At::Whole => file.clone(),
            At::Frame(frame) => format!("{file}, at {} s", t_s[frame]),
            At::Value { frame, cell } => format!("{file}, at {} s, cell {cell}", t_s[frame]),
        };
        let rate_hz = rate::of(&t_s, &place)?;
        check::geometry(&layout, &file)?;
        check::pressures(&pressure_kpa, layout.cells.len(), &place)?;
        let recording = Recording { side, layout, rate_hz, source, t_s, pressure_kpa };
        if recording.cells() <= MAX_CELLS {
            return Ok(recording);
        }
        let mut merged = recording.binned(MAX_CELLS)?;
        // The sentence about the merge becomes a remark, which the import adds to the provenance.
        remark(merged.source.split_off(recording.source.len()).trim_start());
        Ok(merged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cell;
    use plantar::Region;

    /// The message with which the recording of a row of cells is refused.
    fn refusal(cells: u16, t_s: Vec<f64>, pressure_kpa: Vec<f32>) -> Option<String> {
        let cell = |i: u16| Cell { x_mm: 10.0 * f64::from(i), y_mm: 10.0, area_mm2: 50.0, region: Region::Heel };
        let unchecked = UncheckedRecording {
            side: Side::Left,
            layout: Layout { name: String::new(), cells: (0..cells).map(cell).collect(), sheet: None },
            t_s,
            pressure_kpa,
            source: String::new(),
        };
        unchecked
            .recording(Path::new("walk.txt"), Span::default(), &mut Vec::new())
            .err()
            .map(|error| error.to_string())
    }

    #[test]
    fn messages_name_the_time_and_the_cell() {
        let message = |t_s: [f64; 4], kpa: f32| {
            let mut pressure_kpa = vec![0.0; 8];
            pressure_kpa[5] = kpa;
            refusal(2, t_s.into(), pressure_kpa)
        };
        let starts = |message: Option<String>, with: &str| message.is_some_and(|message| message.starts_with(with));
        assert!(starts(message([0.0, 0.01, 0.01, 0.02], 0.0), "walk.txt, at 0.01 s: time 0.01 s is repeated"));
        assert!(starts(message([0.0, 0.01, 0.02, 0.03], -1.0), "walk.txt, at 0.02 s, cell 1: pressure -1 kPa"));
        assert_eq!(message([0.0, 0.01, 0.02, 0.03], 1.0), None);
    }

    /// Between the 2001 frames, there are 1000 gaps, in each of which 98 frames were lost. The pressures are missing, so that an
    /// import that begins to fill the gaps panics, instead of allocating 12 GB.
    #[test]
    fn frames_in_gaps_count_towards_the_limit_on_memory() {
        let t_s = (0..=2000).map(|i| f64::from(i / 2) * 0.1 + f64::from(i % 2) * 1e-3).collect();
        let message = refusal(30_000, t_s, Vec::new()).expect("a refusal");
        assert!(message.starts_with("walk.txt: 100001 frames of 30000 cells, more than"), "{message}");
    }
}
