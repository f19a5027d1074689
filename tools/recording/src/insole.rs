//! A virtual insole: it has the cells of a recording, ordered by region as a device requires, and converts recorded pressures to
//! the codes of a sensor.

use crate::Recording;
use plantar::checksum::crc32;
use plantar::pipeline::calibrate::{CellCalibration, Curve, FULL_CODE, SensorLaw};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::region::Cell;
use plantar::pipeline::setup::{Setup, SetupCell};
use plantar::pipeline::stance_rule::{StanceLimits, StanceRule};

/// Exponent of the virtual sensor's power law. It is below 1, because the conductance of a resistive cell increases slightly
/// less than in proportion to pressure. The value is this project's choice.
pub(crate) const EXPONENT: f32 = 0.8;
/// Full scale of the virtual sensor, kPa. [`VirtualInsole::up_to`] doubles it until it exceeds the largest pressure of the
/// recording.
pub(crate) const FULL_KPA: f32 = 1000.0;

/// A virtual insole that converts recorded pressures to codes.
#[derive(Clone, Debug)]
pub struct VirtualInsole {
    /// Configuration for a device or a replay.
    pub setup: Setup,
    /// The cells in the order of the codes.
    pub cells: Vec<SetupCell>,
    /// For each cell of the recording, its index in [`VirtualInsole::cells`].
    insole_index: Vec<usize>,
    /// True if the reading of an unloaded cell is an offset of its code, not of its pressure; see
    /// [`crate::Layout::has_code_offsets`].
    has_code_offsets: bool,
    /// The readings of the unloaded cells, kPa, in the order of the recording. They are subtracted from the pressures. Empty if
    /// no readings were set, and if `has_code_offsets` is true, because the calibration of the cells then contains the offsets.
    zero_kpa: Vec<f32>,
    law: LawTable,
    curve: Curve,
}

/// The sensor law as a table. Before it is rounded, a code is accurate to a hundredth, except that the entry of [`MIN_KPA`]
/// results in the code 0. The leading bits of a pressure, as an f32, select the entry. Without the table, `powf` would take most
/// of the time of a replay.
#[derive(Clone, Debug)]
struct LawTable {
    /// For each value of the leading bits, modulo the length: the straight line that approximates the law, as its code at
    /// pressure 0 and its slope in codes per kPa. The entry of [`MIN_KPA`], which all lower pressures use, is the constant line
    /// with the code 0.
    lines: Box<[(f32, f32); ENTRIES]>,
}

/// Number of trailing bits of a pressure, over which the table interpolates. The nine leading bits of the mantissa select an
/// entry, so that each doubling of the pressure has 2^9 entries.
const INTERPOLATED_BITS: u32 = f32::MANTISSA_DIGITS - 1 - 9;
/// Pressure, kPa, up to which a code of the virtual sensor, with [`EXPONENT`] and a full scale of at least [`FULL_KPA`], is less
/// than a half and rounds to 0: 2^-14.
const MIN_KPA: f32 = 1.0 / 16384.0;
/// Number of entries: enough for 32 doublings of [`MIN_KPA`], which exceed every full scale.
const ENTRIES: usize = 1 << 14;

impl LawTable {
    fn new(law: &SensorLaw) -> Self {
        let code = |kpa: f64| f64::from(FULL_CODE) * (kpa / f64::from(law.full_kpa)).powf(f64::from(law.exponent));
        let kpa_at = |leading_bits: u32| f64::from(f32::from_bits(leading_bits << INTERPOLATED_BITS));
        let [first, last] = [MIN_KPA, law.full_kpa].map(|kpa| kpa.to_bits() >> INTERPOLATED_BITS);
        let mut lines = Box::new([(0.0, 0.0); ENTRIES]);
        for leading_bits in first + 1..=last {
            let (from, to) = (kpa_at(leading_bits), kpa_at(leading_bits + 1));
            let slope = (code(to) - code(from)) / (to - from);
            lines[leading_bits as usize % ENTRIES] = ((code(from) - slope * from) as f32, slope as f32);
        }
        Self { lines }
    }

    /// The code of a cell without an offset under a pressure of at most the full scale. The function has no branch for unloaded
    /// cells, because processors would often predict this branch wrongly.
    #[inline(always)]
    fn code(&self, kpa: f32) -> u16 {
        let selecting_kpa = if kpa > MIN_KPA { kpa } else { MIN_KPA };
        let (base, slope) = self.lines[(selecting_kpa.to_bits() >> INTERPOLATED_BITS) as usize % ENTRIES];
        (base + slope * kpa + 0.5) as u16
    }
}

impl VirtualInsole {
    /// The insole of a recording. Its calibration is ideal: measured pressures differ from the recorded pressures only by the
    /// rounding of the codes and by the straight segments of [`Curve`], together by less than 0.15 % for pressures above 1 % of
    /// full scale. [`crate::Zero::apply_to`] sets the readings of the unloaded cells, which are subtracted.
    pub fn new(recording: &Recording, contact: ContactRule, stance: StanceRule) -> Self {
        Self::up_to(recording.largest_kpa(), recording, contact, stance)
    }

    /// As [`VirtualInsole::new`], for a recording without its frames in memory: `head` describes it, and its largest pressure is
    /// `largest_kpa`.
    pub fn up_to(largest_kpa: f32, head: &Recording, contact: ContactRule, stance: StanceRule) -> Self {
        let mut sensor = SensorLaw { full_kpa: FULL_KPA, exponent: EXPONENT };
        while sensor.full_kpa <= largest_kpa {
            sensor.full_kpa *= 2.0;
        }
        let mut order: Vec<usize> = (0..head.cells()).collect();
        order.sort_by_key(|&i| head.layout.cells[i].region);
        let cells: Vec<_> = order
            .iter()
            .enumerate()
            .map(|(index, &i)| {
                let cell = &head.layout.cells[i];
                let cell = Cell {
                    region: cell.region,
                    x_mm: cell.x_mm as f32,
                    y_mm: cell.y_mm as f32,
                    area_mm2: cell.area_mm2 as f32,
                };
                // In the emulated matrix, cells are wired in their order, 16 to a row. From cell 256 on the number wraps, which
                // has no effect: an insole with more than 256 cells (`plantar::faults::MATRIX_CELLS`) is not searched for faults
                // of rows and columns.
                SetupCell::new(cell, CellCalibration::IDEAL, index as u8)
            })
            .collect();
        let geometry: Vec<u8> = cells
            .iter()
            .flat_map(|c| [c.x_mm, c.y_mm, c.area_mm2, c.region as u8 as f32])
            .flat_map(f32::to_le_bytes)
            .collect();
        let setup = Setup {
            side: head.side,
            layout_id: crc32(&geometry),
            period_us: (1e6 / head.rate_hz).round() as u32,
            sensor,
            contact,
            stance,
        };
        let mut insole_index = vec![0; order.len()];
        for (index, &i) in order.iter().enumerate() {
            insole_index[i] = index;
        }
        let mut curve = Curve::new();
        curve.set(&setup.sensor);
        let (law, has_code_offsets) = (LawTable::new(&setup.sensor), head.layout.has_code_offsets());
        Self { setup, cells, insole_index, has_code_offsets, zero_kpa: Vec::new(), law, curve }
    }

    /// Number of times that the last frame of a recording is repeated, so that a toe off at its end is confirmed.
    pub fn repetitions(&self) -> usize {
        let confirm_us = u32::from(self.setup.stance.min_swing_ms) * 1000;
        confirm_us.div_ceil(self.setup.period_us) as usize + 1
    }

    /// Largest number of frames from heel strike to the confirmed toe off of a step. The insole rejects a longer contact.
    pub fn longest_step_frames(&self) -> usize {
        StanceLimits::<f32>::new(&self.setup.stance, self.setup.period_us).longest_step_frames() as usize
    }

    /// Index of the frame at a time on the clock of the insole, us. That clock assumes a constant period in whole microseconds,
    /// so it deviates from that of the recording, for example by 90 ms in an hour at 75 Hz. The exact time is that of the frame
    /// with this index in the recording.
    pub fn frame_at(&self, insole_us: u64) -> usize {
        (insole_us / u64::from(self.setup.period_us)) as usize
    }

    /// Number of frames to process: the frames of the recording, and the repetitions of its last frame.
    pub fn frames(&self, recording: &Recording) -> usize {
        recording.frames() + self.repetitions()
    }

    /// Writes the codes of frame `i` to `codes`, which has one element for each cell of the insole. From the last frame of the
    /// recording on, these are the codes of the last frame.
    ///
    /// # Panics
    /// Panics if the recording has no frame.
    pub fn codes_of(&self, recording: &Recording, i: usize, codes: &mut [u16]) {
        self.codes(recording.frame(i.min(recording.frames() - 1)), codes);
    }

    /// For each cell of the insole, its index in the recording.
    pub(crate) fn order(&self) -> Vec<usize> {
        let mut order = vec![0; self.insole_index.len()];
        for (cell, &index) in self.insole_index.iter().enumerate() {
            order[index] = cell;
        }
        order
    }

    /// Subtracts these readings of the unloaded cells, kPa, from now on. They are in the order of the insole.
    pub(crate) fn subtract(&mut self, zero_kpa: &[f32]) {
        if self.has_code_offsets {
            for (cell, &kpa) in self.cells.iter_mut().zip(zero_kpa) {
                cell.offset = self.law.code(kpa);
            }
        } else {
            self.zero_kpa = self.insole_index.iter().map(|&index| zero_kpa[index]).collect();
        }
    }

    /// The codes of one cell, given by its index in the recording, under these pressures, kPa.
    pub(crate) fn codes_of_cell(&self, cell: usize, mut pressure_kpa: Vec<f32>) -> Vec<u16> {
        if let Some(zero_kpa) = self.zero_kpa.get(cell) {
            pressure_kpa.iter_mut().for_each(|kpa| *kpa = (*kpa - zero_kpa).max(0.0));
        }
        let mut codes = vec![0; pressure_kpa.len()];
        // As `codes` skips unloaded cells, unloaded frames are skipped eight at a time.
        for (kpa, codes) in pressure_kpa.chunks(8).zip(codes.chunks_mut(8)) {
            if kpa.iter().fold(0, |any, kpa| any | kpa.to_bits()) != 0 {
                kpa.iter().zip(codes).for_each(|(&kpa, code)| *code = self.law.code(kpa));
            }
        }
        codes
    }

    /// Writes the codes of these pressures to `codes`. The pressures, kPa, are in the order of the recording; the codes are in
    /// the order of the insole.
    pub fn codes(&self, pressure_kpa: &[f32], codes: &mut [u16]) {
        if !self.zero_kpa.is_empty() {
            for ((kpa, zero_kpa), &index) in pressure_kpa.iter().zip(&self.zero_kpa).zip(&self.insole_index) {
                codes[index] = self.law.code((kpa - zero_kpa).max(0.0));
            }
            return;
        }
        codes.fill(0);
        // Most cells are unloaded most of the time, so unloaded cells are skipped eight at a time.
        let (kpa_by_8, kpa_left) = pressure_kpa.as_chunks::<8>();
        let (index_by_8, index_left) = self.insole_index.as_chunks::<8>();
        for (kpa, indices) in kpa_by_8.iter().zip(index_by_8) {
            if kpa.iter().fold(0, |any, kpa| any | kpa.to_bits()) != 0 {
                kpa.iter().zip(indices).for_each(|(&kpa, &index)| codes[index] = self.law.code(kpa));
            }
        }
        kpa_left.iter().zip(index_left).for_each(|(&kpa, &index)| codes[index] = self.law.code(kpa));
    }

    /// The pressures that a device measures if these pressures are applied. Both are in kPa and in the order of the recording.
    /// The measured pressures are quantised, and the readings of the unloaded cells are subtracted.
    pub fn measured_kpa(&self, pressure_kpa: &[f32]) -> Vec<f32> {
        let mut codes = vec![0; self.cells.len()];
        self.codes(pressure_kpa, &mut codes);
        self.measured_by_codes_kpa(&codes)
    }

    /// The pressures, kPa, that a device measures with these codes. They are in the order of the recording.
    pub fn measured_by_codes_kpa(&self, codes: &[u16]) -> Vec<f32> {
        let measured = |&index: &usize| {
            let SetupCell { offset, gain, .. } = self.cells[index];
            gain * self.curve.pressure_kpa::<f32>((i32::from(codes[index]) - i32::from(offset)).max(0))
        };
        self.insole_index.iter().map(measured).collect()
    }

    /// The code of a cell without an offset under this pressure.
    pub(crate) fn code(&self, kpa: f32) -> u16 {
        self.law.code(kpa)
    }

    /// The pressure, kPa, at which a cell without an offset has this code. It is computed by the law itself, because a
    /// [`Curve`] is too coarse near zero.
    pub(crate) fn pressure_kpa(&self, code: u16) -> f32 {
        let SensorLaw { full_kpa, exponent } = self.setup.sensor;
        (f64::from(full_kpa) * (f64::from(code) / f64::from(FULL_CODE)).powf(1.0 / f64::from(exponent))) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_the_law_to_within_rounding() {
        for exponent in [0.5, 0.8, 1.3] {
            let law = SensorLaw { full_kpa: 1000.0, exponent };
            let table = LawTable::new(&law);
            for i in 0..100_000 {
                let kpa = 0.01 * i as f32;
                let exact = f64::from(FULL_CODE) * (f64::from(kpa) / 1000.0).powf(f64::from(exponent));
                let code = f64::from(table.code(kpa));
                assert!((code - exact).abs() < 0.52, "{kpa} kPa, exponent {exponent}: {code}, not {exact}");
            }
        }
    }
}
