//! The step record on the wire.

use crate::num::Real;
use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use crate::pipeline::step::{RegionStep, StepRecord};
use serde::{Deserialize, Serialize};

/// A [`StepRecord`] in scaled integers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Number of the step; continues after a start as long as the flash chip is the same.
    pub step: u32,
    /// Foot.
    pub side: Side,
    /// Time of the first loaded frame since the first scan, us.
    pub start_us: u64,
    /// Heel strike to toe off, us.
    pub duration_us: u32,
    /// Time between samples that the step was computed from, us.
    pub sample_us: u32,
    /// Frames that were missing and bridged.
    pub bridged_frames: u16,
    /// Bit i: a cell of region i was saturated: its forces are lower bounds.
    pub saturated: u8,
    /// Bit i: region i's contact exceeded its ellipsoid.
    pub clamped: u8,
    /// The rule that areas were counted by.
    pub contact_rule: ContactRule,
    /// The regions, in the order of [`crate::Region::ALL`].
    pub regions: [StepRegion; 8],
    /// Boots of the insole since the one that recorded this step; `start_us` counts from that one.
    pub boots_since: u32,
    /// `start_us` on the wall clock, us since 1970, UTC; `None` where the clock was not set.
    pub start_unix_us: Option<u64>,
}

/// One region of a [`Step`].
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct StepRegion {
    /// Largest measured force, 0.1 N.
    #[serde(with = "postcard::fixint::le")]
    pub measured_peak_dn: u16,
    /// Largest model force, 0.1 N.
    #[serde(with = "postcard::fixint::le")]
    pub model_peak_dn: u16,
    /// Force-time integral of the measured force, 0.01 N s.
    #[serde(with = "postcard::fixint::le")]
    pub measured_integral_cns: u16,
    /// Force-time integral of the model force, 0.01 N s.
    #[serde(with = "postcard::fixint::le")]
    pub model_integral_cns: u16,
    /// Largest contact area, mm2.
    #[serde(with = "postcard::fixint::le")]
    pub area_peak_mm2: u16,
    /// Largest deformation, um.
    #[serde(with = "postcard::fixint::le")]
    pub deformation_peak_um: u16,
    /// Largest loading rate of the deformation, 0.1 mm/s.
    #[serde(with = "postcard::fixint::le")]
    pub deformation_rate_peak_dmm_s: u16,
    /// Contact time, ms.
    #[serde(with = "postcard::fixint::le")]
    pub contact_ms: u16,
    /// Time from first contact to the largest measured force, ms.
    #[serde(with = "postcard::fixint::le")]
    pub time_to_peak_ms: u16,
    /// Centre of the contact ellipse at the largest measured force, foot coordinates, 0.1 mm.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_x_dmm: i16,
    /// See `ellipse_x_dmm`.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_y_dmm: i16,
    /// Its radii, 0.01 mm; 0 without contact.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_r_a_cmm: u16,
    /// See `ellipse_r_a_cmm`.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_r_b_cmm: u16,
    /// Its angle, 0.1 degrees.
    #[serde(with = "postcard::fixint::le")]
    pub ellipse_angle_ddeg: i16,
    /// Model against measured force (Eq. 20), 0.01 %.
    #[serde(with = "postcard::fixint::le")]
    pub model_error_bp: u16,
    /// Masked cells at toe off; 255 for more.
    pub masked_cells: u8,
}

impl Step {
    /// Rounds a step of the running boot to the units of the wire.
    pub fn new<R: Real>(record: &StepRecord<R>) -> Self {
        let clamped = record.regions.iter().enumerate().fold(0, |bits, (i, r)| bits | u8::from(r.clamped) << i);
        Self {
            step: record.step,
            side: record.side,
            start_us: record.start_us,
            duration_us: record.duration_us,
            sample_us: record.sample_us,
            bridged_frames: record.bridged_frames,
            saturated: record.saturated,
            clamped,
            contact_rule: record.contact_rule,
            regions: record.regions.each_ref().map(StepRegion::new),
            boots_since: 0,
            start_unix_us: None,
        }
    }
}

impl StepRegion {
    fn new<R: Real>(region: &RegionStep<R>) -> Self {
        let scaled = |value: R, units: f64| (value * R::of(units)).round_u16();
        let mut wire = Self {
            measured_peak_dn: scaled(region.measured_peak_n, 10.0),
            model_peak_dn: scaled(region.model_peak_n, 10.0),
            measured_integral_cns: scaled(region.measured_integral_n_s, 100.0),
            model_integral_cns: scaled(region.model_integral_n_s, 100.0),
            area_peak_mm2: scaled(region.area_peak_mm2, 1.0),
            deformation_peak_um: scaled(region.deformation_peak_m, 1e6),
            deformation_rate_peak_dmm_s: scaled(region.deformation_rate_peak_m_s, 1e4),
            contact_ms: scaled(region.contact_s, 1e3),
            time_to_peak_ms: scaled(region.time_to_peak_s, 1e3),
            model_error_bp: scaled(region.model_error, 1e4),
            masked_cells: region.masked_cells,
            ..Self::default()
        };
        if let Some(ellipse) = &region.ellipse_at_peak {
            wire.ellipse_x_dmm = (ellipse.x_mm * R::of(10.0)).round_i16();
            wire.ellipse_y_dmm = (ellipse.y_mm * R::of(10.0)).round_i16();
            wire.ellipse_r_a_cmm = scaled(ellipse.r_a_mm, 100.0);
            wire.ellipse_r_b_cmm = scaled(ellipse.r_b_mm, 100.0);
            wire.ellipse_angle_ddeg = (ellipse.angle_deg() * 10.0).round_i16();
        }
        wire
    }
}
