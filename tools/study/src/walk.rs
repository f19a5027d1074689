//! The walk of one foot or of both feet in recordings, for the measures of gait.

use crate::table::{Row, Value};
use anyhow::{Result, bail};
use client::gait::{COUNT, FootStep, Gait, MEASURES, Stride};
use fit::contacts::CutOff;
use fit::steps::ExclusionReason;
use plantar::Side;
use plantar::insole::Insole;
use plantar::protocol::Step;
use recording::{FrameSource, MAX_CELLS, Recording, Scan, VirtualInsole, is_same_rate, note_unless_same_walk};

/// The steps that an insole would find in a recording.
#[derive(Debug, Default)]
pub struct RecordedWalk {
    /// The steps. Their starts and durations are those of their frames in the time column of the recording.
    pub steps: Vec<Step>,
    /// The numbers of the load bouts, which are numbered together with the steps.
    pub bouts: Vec<u32>,
    /// The contacts that the beginning or the end of the recording cuts off: the time of the first frame, s, and the reason.
    pub cut_off: Vec<(f64, ExclusionReason)>,
}

impl RecordedWalk {
    /// Finds the steps in a recording. `virtual_insole` is that of the recording, and `progress` is called with the number of
    /// frames that were evaluated.
    ///
    /// # Errors
    /// Fails if the recording cannot be read or evaluated, or if its time column begins before 0.
    pub fn find(virtual_insole: &VirtualInsole, source: FrameSource, progress: &mut dyn FnMut(usize)) -> Result<Self> {
        let mut insole = Box::new(Insole::<f32, MAX_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
        let mut walk = Self::default();
        // The times of the frames so far.
        let (mut times_s, mut cut_off) = (Vec::<f64>::new(), CutOff::default());
        let mut add_records = |toe_off: bool, insole: &mut Insole<f32, MAX_CELLS>, times_s: &[f64]| {
            let time_us = |insole_us: u64| {
                let t_s = times_s.get(virtual_insole.frame_at(insole_us)).or(times_s.last());
                t_s.map_or(0, |t_s| (t_s * 1e6).round() as u64)
            };
            if let Some(step) = toe_off.then(|| insole.whole_step()).flatten().map(|step| Step::new(&step)) {
                let start_us = time_us(step.start_us);
                let duration_us = time_us(step.start_us + u64::from(step.duration_us)).saturating_sub(start_us) as u32;
                walk.steps.push(Step { start_us, duration_us, ..step });
            }
            walk.bouts.extend(insole.take_bout().map(|bout| bout.number));
        };
        let mut scans = virtual_insole.scans(source);
        // The repetitions of the last frame, which have no time, are not evaluated: their load was not recorded.
        while let Some(Scan { index, t_s: Some(t_s), codes }) = scans.next_scan()? {
            if t_s < 0.0 {
                bail!("the time column begins at {t_s} s: shift it, so that it begins at 0 or later");
            }
            times_s.push(t_s);
            let toe_off = insole.frame(index as u32, codes);
            cut_off.frame(t_s, toe_off, &insole);
            add_records(toe_off, &mut insole, &times_s);
            if index.is_multiple_of(4096) {
                progress(index);
            }
        }
        let toe_off = insole.end_stance();
        add_records(toe_off, &mut insole, &times_s);
        walk.cut_off = cut_off.end(&insole);
        Ok(walk)
    }

    /// The steps on the clock of the time column.
    pub fn foot_steps(&self) -> Vec<FootStep> {
        self.steps.iter().map(|step| FootStep::new(step, step.start_us, &self.bouts)).collect()
    }
}

/// Checks that the recordings of two feet can be compared, and returns a note if they do not seem to be of the same walk. Only
/// the descriptions of the recordings are used, not their frames.
///
/// # Errors
/// Fails if the frame rates differ.
pub fn check_pair([first, second]: [&Recording; 2]) -> Result<Option<String>> {
    if !is_same_rate(first.rate_hz, second.rate_hz) {
        bail!(
            "the recordings have different rates ({:.2} and {:.2} Hz), so that times, peak forces and loading of the feet \
             cannot be compared: give recordings of one walk, imported with the same --rate, such as --rate 100",
            first.rate_hz,
            second.rate_hz
        );
    }
    // The texts of insoles have their serial numbers, which differ between the feet.
    let is_of_insole = first.layout.is_of_insole() || second.layout.is_of_insole();
    Ok((!is_of_insole).then(|| note_unless_same_walk(&first.source, &second.source)).flatten())
}

/// The rows of a table of the strides of both feet, those of the left foot first, each foot in the order of time: foot, heel
/// strike on the clock of the walk, heel strike of the other foot, whether the stride continues the one before it, and the
/// measures.
pub fn stride_rows(gait: &Gait) -> Vec<Row> {
    let feet = [Side::Left, Side::Right].into_iter().zip(&gait.feet);
    feet.flat_map(|(side, foot)| foot.strides.iter().map(move |stride| stride_row(side, stride))).collect()
}

/// A row with arbitrary values, for the names and types of the columns of a table of strides that may have no rows.
pub fn stride_columns() -> Row {
    stride_row(Side::Left, &Stride { start_s: 0.0, other_s: None, is_consecutive: false, values: [None; COUNT] })
}

fn stride_row(side: Side, stride: &Stride) -> Row {
    let mut row: Row = vec![
        ("side", side.name().into()),
        ("start_s", stride.start_s.into()),
        ("other_start_s", Value::Real(stride.other_s)),
        ("is_consecutive", stride.is_consecutive.into()),
    ];
    row.extend(MEASURES.iter().zip(stride.values).map(|(measure, value)| (measure.key, Value::Real(value))));
    row
}
