//! Recordings of the codes that an insole streamed.

use crate::{Cell, Layout, Recording};
use plantar::pipeline::calibrate::{FULL_CODE, SensorLaw};
use plantar::pipeline::setup::{Setup, SetupCell};

/// Largest number of successive missing frames of the stream that are interpolated; a longer gap ends the recording.
const MAX_INTERPOLATED: u32 = 3;

/// Collects the codes of scans, and converts them to pressures by the configuration of the insole.
#[derive(Clone, Debug)]
pub struct StreamedCells {
    setup: Setup,
    cells: Vec<SetupCell>,
    /// Number of scans from one frame of the stream to the next.
    every: u32,
    /// Number and pressures, kPa, of the last scan. [`StreamedCells::take`] does not clear them.
    last: Option<(u32, Vec<f32>)>,
    /// Numbers of the scans since [`StreamedCells::take`], in the order of time. The numbers wrap.
    scans: Vec<u32>,
    /// The pressures of these scans.
    pressure_kpa: Vec<f32>,
    /// The number of interpolated scans among them.
    interpolated: u32,
}

impl StreamedCells {
    /// Starts without scans, for an insole with this configuration that sends the codes of one scan in `every`.
    pub fn new(setup: Setup, cells: Vec<SetupCell>, every: u8) -> Self {
        let every = u32::from(every.max(1));
        Self { setup, cells, every, last: None, scans: Vec::new(), pressure_kpa: Vec::new(), interpolated: 0 }
    }

    /// True if a scan continues the scans so far, perhaps over a gap that is short enough to be interpolated.
    pub fn is_continued_by(&self, scan: u32) -> bool {
        self.last.as_ref().is_none_or(|(last, _)| {
            let elapsed = scan.wrapping_sub(*last);
            elapsed > 0 && elapsed.is_multiple_of(self.every) && elapsed / self.every <= 1 + MAX_INTERPOLATED
        })
    }

    /// Ends the sequence of scans, so that the next scan may have any number.
    pub fn restart(&mut self) {
        self.last = None;
    }

    /// Adds the codes of a scan that continues the scans so far, one code for each cell.
    pub fn push(&mut self, scan: u32, codes: &[u16]) {
        let kpa = |(cell, &code): (&SetupCell, &u16)| pressure_kpa(&self.setup.sensor, cell, code);
        let new: Vec<f32> = self.cells.iter().zip(codes).map(kpa).collect();
        if let Some((last, before)) = &self.last {
            let intervals = scan.wrapping_sub(*last) / self.every;
            for i in 1..intervals {
                let share = i as f32 / intervals as f32;
                self.pressure_kpa.extend(before.iter().zip(&new).map(|(before, new)| before + share * (new - before)));
                self.scans.push(last.wrapping_add(i * self.every));
                self.interpolated += 1;
            }
        }
        self.pressure_kpa.extend(&new);
        self.scans.push(scan);
        self.last = Some((scan, new));
    }

    /// Number of frames since [`StreamedCells::take`], including interpolated ones.
    pub fn frames(&self) -> usize {
        self.scans.len()
    }

    /// The frames since the last call as a recording, with times since the start of the insole; `None` without frames.
    pub fn take(&mut self, source: &str) -> Option<Recording> {
        let (&first, &last) = (self.scans.first()?, self.scans.last()?);
        let period_s = f64::from(self.setup.period_us) * 1e-6;
        let SensorLaw { full_kpa, exponent } = self.setup.sensor;
        let contact = self.setup.contact;
        let counted = match contact.full_kpa {
            0.0 => "with its whole area".to_owned(),
            full_kpa => format!("with the fraction sqrt(p / {full_kpa} kPa) of its area, at most 1"),
        };
        // Scans are counted from the first one, because their numbers wrap.
        let seconds = |scan: u32| (f64::from(first) + f64::from(scan.wrapping_sub(first))) * period_s;
        let recording = Recording {
            side: self.setup.side,
            layout: layout(&self.setup, &self.cells),
            rate_hz: 1.0 / (period_s * f64::from(self.every)),
            source: format!(
                "{source}, layout {:#010x}, sensor {full_kpa} kPa at full scale with exponent {exponent}, contact on at \
                 {} kPa and off at {} kPa, a cell in contact counts {counted}.{}",
                self.setup.layout_id,
                contact.on_kpa,
                contact.off_kpa,
                if self.interpolated > 0 {
                    let [first_s, last_s] = [first, last].map(seconds);
                    format!(" Interpolated frames from {first_s:.2} s to {last_s:.2} s: {}.", self.interpolated)
                } else {
                    String::new()
                }
            ),
            t_s: self.scans.iter().copied().map(seconds).collect(),
            pressure_kpa: std::mem::take(&mut self.pressure_kpa),
        };
        self.scans.clear();
        self.interpolated = 0;
        Some(recording)
    }
}

/// The cells in the order of the insole.
fn layout(setup: &Setup, cells: &[SetupCell]) -> Layout {
    let cell = |cell: &SetupCell| Cell {
        x_mm: cell.x_mm.into(),
        y_mm: cell.y_mm.into(),
        area_mm2: cell.area_mm2.into(),
        region: cell.region,
    };
    Layout::of_insole(setup.layout_id, cells.iter().map(cell).collect())
}

/// The pressure of a cell, kPa. It is computed by the sensor law itself, because the insole's table of the law is coarse near
/// zero.
fn pressure_kpa(law: &SensorLaw, cell: &SetupCell, code: u16) -> f32 {
    let code = code.saturating_sub(cell.offset);
    let share = f64::from(code) / f64::from(FULL_CODE);
    cell.gain * (f64::from(law.full_kpa) * share.powf(1.0 / f64::from(law.exponent))) as f32
}
