//! A recording worn as an insole: its cells in the device's order, its pressures as the codes of a sensor.

use crate::Recording;
use plantar::calibrate::{CellCalibration, FULL_CODE, SensorLaw};
use plantar::contact::ContactRule;
use plantar::insole::{Setup, SetupCell};
use plantar::region::Cell;
use plantar::stance::StanceRule;
use plantar::wire::checksum;

/// Exponent of the virtual sensor's power law: conductance of a resistive cell rises a little less than in proportion to
/// pressure. Our choice.
const EXPONENT: f32 = 0.8;
/// Full scale of the virtual sensor, kPa; doubled until it holds the recording.
const FULL_KPA: f32 = 1000.0;

/// A virtual insole that feels what was recorded.
#[derive(Clone, Debug)]
pub struct VirtualInsole {
    /// What a device or a replay is set up with.
    pub setup: Setup,
    /// The cells in the order of the codes.
    pub cells: Vec<SetupCell>,
    /// Per cell of the insole its number in the recording.
    order: Vec<usize>,
}

impl VirtualInsole {
    /// The insole of a recording. Its calibration is ideal, so what differs from the recorded pressures is the sensor's
    /// resolution: below 0.1 % above 1 % of full scale.
    pub fn new(recording: &Recording, contact: ContactRule, stance: StanceRule) -> Self {
        let largest_kpa = recording.pressure_kpa.iter().fold(0.0f32, |a, &b| a.max(b));
        let mut sensor = SensorLaw { full_kpa: FULL_KPA, exponent: EXPONENT };
        while sensor.full_kpa <= largest_kpa {
            sensor.full_kpa *= 2.0;
        }
        let mut order: Vec<usize> = (0..recording.cells()).collect();
        order.sort_by_key(|&i| recording.layout.cells[i].region);
        let cells: Vec<_> = order
            .iter()
            .map(|&i| {
                let cell = &recording.layout.cells[i];
                SetupCell {
                    cell: Cell {
                        region: cell.region,
                        x_mm: cell.x_mm as f32,
                        y_mm: cell.y_mm as f32,
                        area_mm2: cell.area_mm2 as f32,
                    },
                    calibration: CellCalibration::IDEAL,
                }
            })
            .collect();
        let geometry: Vec<u8> = cells
            .iter()
            .flat_map(|c| [c.cell.x_mm, c.cell.y_mm, c.cell.area_mm2, c.cell.region as u8 as f32])
            .flat_map(f32::to_le_bytes)
            .collect();
        let setup = Setup {
            side: recording.side,
            layout_id: checksum(&geometry),
            period_us: (1e6 / recording.rate_hz).round() as u32,
            sensor,
            contact,
            stance,
        };
        Self { setup, cells, order }
    }

    /// Frames that this insole feels: those of the recording, whose last one is then held long enough to confirm a toe off.
    pub fn frames(&self, recording: &Recording) -> usize {
        let confirm_us = u32::from(self.setup.stance.min_swing_ms) * 1000;
        recording.frames() + confirm_us.div_ceil(self.setup.period_us) as usize + 1
    }

    /// The codes of frame `i` of [`VirtualInsole::frames`].
    pub fn codes_of(&self, recording: &Recording, i: usize, codes: &mut [u16]) {
        self.codes(recording.frame(i.min(recording.frames() - 1)), codes);
    }

    /// The codes of one frame of the recording, one a cell of the insole, by the sensor's own law.
    pub fn codes(&self, pressure_kpa: &[f32], codes: &mut [u16]) {
        let SensorLaw { full_kpa, exponent } = self.setup.sensor;
        for (code, &i) in codes.iter_mut().zip(&self.order) {
            let p = pressure_kpa[i];
            // Most cells are unloaded most of the time.
            *code = if p > 0.0 { (f32::from(FULL_CODE) * (p / full_kpa).powf(exponent)).round() as u16 } else { 0 };
        }
    }
}
