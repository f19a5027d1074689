//! The step record as a message.

use super::quantities::{bits, quantities};
use crate::num::Real;
use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use crate::pipeline::step::{RegionStep, StepRecord};
use postcard::fixint::le;
use serde::{Deserialize, Serialize};

quantities! {
    /// A [`StepRecord`] in scaled integers.
    #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
    pub struct Step {
        /// Number of the step; continues after a restart as long as the flash chip is the same.
        step: u32 = record.step
            => step [1 per "count"],
            "Counted by the insole at each toe off.";
        /// Foot.
        side: Side = record.side;
        /// Time of the heel strike, the first loaded frame of the step, since the first scan.
        start_us: u64 = record.start_us
            => start_s [1_000_000 per "s"],
            "Heel strike: the total force reaches the threshold.";
        /// Time from heel strike to toe off.
        duration_us: u32 = record.duration_us
            => duration_s [1_000_000 per "s"],
            "Toe off: the total force falls below the threshold.";
        /// Time between the samples that the step was computed from.
        sample_us: u32 = record.sample_us
            => sample_s [1_000_000 per "s"],
            "Frame time; a multiple of it for a stance of more than 256 frames.";
        /// Number of frames that were missing and bridged by straight lines.
        bridged_frames: u16 = record.bridged_frames
            => bridged_frames [1 per "count"],
            "Gaps in the numbers of scanned frames.";
        /// A cell was saturated, so the forces are lower bounds.
        saturated: u8 = record.saturated,
            flags "The code of a cell reached the end of the scale.";
        /// The contact exceeded the ellipsoid, so deformation and model force are lower bounds.
        clamped: u8 = bits(&record.regions, |region| region.clamped),
            flags "The contact area exceeded pi A B.";
        /// The rule that areas were counted by.
        contact_rule: ContactRule = record.contact_rule;
        /// The regions, in the order of [`crate::Region::ALL`].
        regions: [StepRegion; 8] = record.regions.each_ref().map(StepRegion::new);
        /// Boots of the insole since the one that recorded this step; the start time counts from that one.
        boots_since: u32 = 0
            => starts_ago [1 per "count"],
            "Counted by the insole.";
        /// `start_us` on the wall clock, us since 1970, UTC; `None` if the clock was not set.
        start_unix_us: Option<u64> = None;
        /// K has changed by so much since the identification that the wearer should be identified again.
        refit: u8 = record.refit(),
            flags "The tracked K differs from the identified one by more than the minimal detectable change of the region.";
    }

    /// Rounds a step of the running boot to the integer units of the message.
    pub fn new<R: Real>(record: &StepRecord<R>);
}

quantities! {
    /// One region of a [`Step`].
    #[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
    pub struct StepRegion {
        /// Largest measured force.
        #[serde(with = "le")]
        measured_peak_dn: u16 = (region.measured_peak_n * R::of(10.0)).round_u16()
            => measured_force_peak_n [10 per "N"],
            "Sum over the cells of pressure times area.";
        /// Largest model force.
        #[serde(with = "le")]
        model_peak_dn: u16 = (region.model_peak_n * R::of(10.0)).round_u16()
            => model_force_peak_n [10 per "N"],
            "Eq. 13 with Eq. 14, on the contact area.";
        /// Force-time integral of the measured force.
        #[serde(with = "le")]
        measured_integral_cns: u16 = (region.measured_integral_n_s * R::of(100.0)).round_u16()
            => measured_force_integral_n_s [100 per "N s"],
            "Sum of the samples times the time between them.";
        /// Force-time integral of the model force.
        #[serde(with = "le")]
        model_integral_cns: u16 = (region.model_integral_n_s * R::of(100.0)).round_u16()
            => model_force_integral_n_s [100 per "N s"],
            "Sum of the samples times the time between them.";
        /// Largest contact area.
        #[serde(with = "le")]
        area_peak_mm2: u16 = (region.area_peak_mm2 * R::of(1.0)).round_u16()
            => area_peak_mm2 [1 per "mm2"],
            "Area of the cells in contact by the contact rule.";
        /// Largest tissue deformation of the model.
        #[serde(with = "le")]
        deformation_peak_um: u16 = (region.deformation_peak_m * R::of(1e6)).round_u16()
            => deformation_peak_mm [1000 per "mm"],
            "Eq. 14, on the contact area.";
        /// Largest rate of the deformation under increasing load.
        #[serde(with = "le")]
        deformation_rate_peak_dmm_s: u16 = (region.deformation_rate_peak_m_s * R::of(1e4)).round_u16()
            => deformation_rate_peak_mm_s [10 per "mm/s"],
            "Difference of the deformation over 20 ms, instead of over one sample as in Eq. 16.";
        /// Time from the region's first to its last sample in contact.
        #[serde(with = "le")]
        contact_ms: u16 = (region.contact_s * R::of(1e3)).round_u16()
            => contact_time_s [1000 per "s"],
            "Samples with a contact area above 0.";
        /// Time from the region's first sample in contact to its largest measured force.
        #[serde(with = "le")]
        time_to_peak_ms: u16 = (region.time_to_peak_s * R::of(1e3)).round_u16()
            => time_to_peak_s [1000 per "s"],
            "First sample with the largest measured force.";
        /// Centre of the contact ellipse at the largest measured force, to the lateral side in foot coordinates.
        #[serde(with = "le")]
        ellipse_x_dmm: i16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.x_mm * R::of(10.0)).round_i16())
            => ellipse_x_mm as "ellipse_at_peak.x_mm" [10 per "mm"] if ellipse_r_a_cmm,
            "Centroid of the contact area.";
        /// Centre of the contact ellipse at the largest measured force, from heel to toe in foot coordinates.
        #[serde(with = "le")]
        ellipse_y_dmm: i16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.y_mm * R::of(10.0)).round_i16())
            => ellipse_y_mm as "ellipse_at_peak.y_mm" [10 per "mm"] if ellipse_r_a_cmm,
            "Centroid of the contact area.";
        /// Radius of the ellipse along the axis nearer to the medial-lateral one; 0 without contact.
        #[serde(with = "le")]
        ellipse_r_a_cmm: u16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.r_a_mm * R::of(100.0)).round_u16())
            => ellipse_r_a_mm as "ellipse_at_peak.r_a_mm" [100 per "mm"] if ellipse_r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Radius of the ellipse along the axis nearer to the heel-toe one; 0 without contact.
        #[serde(with = "le")]
        ellipse_r_b_cmm: u16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.r_b_mm * R::of(100.0)).round_u16())
            => ellipse_r_b_mm as "ellipse_at_peak.r_b_mm" [100 per "mm"] if ellipse_r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Angle from the x axis to the first radius, counter-clockwise seen from above with x to the right and y forwards.
        #[serde(with = "le")]
        ellipse_angle_ddeg: i16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.angle_deg() * 10.0).round_i16())
            => ellipse_angle_deg as "ellipse_at_peak.angle_deg" [10 per "deg"] if ellipse_r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Root mean square of model minus measured force over the contact, relative to the largest measured force.
        #[serde(with = "le")]
        model_error_bp: u16 = (region.model_error * R::of(1e4)).round_u16()
            => model_error_nrmse_percent [100 per "%"],
            "Eq. 20, against the unsmoothed measured force.";
        /// Number of masked cells at toe off; 255 for more.
        masked_cells: u8 = region.masked_cells
            => masked_cells [1 per "count"],
            "Cells that the fault detector replaces by their neighbours.";
        /// Change of K since the identification; 0 without parameters of the wearer.
        stiffness_change_percent: i8 = (region.stiffness_change * R::of(100.0)).round_i16().clamp(-100, 127) as i8
            => stiffness_change_percent [1 per "%"],
            "Recursive least squares over the recent steps, Eq. 13.";
    }

    /// Rounds a region to the integer units of the message.
    fn new<R: Real>(region: &RegionStep<R>);
}

impl Step {
    /// The step without the field that changes when an insole repeats it after a restart.
    ///
    /// Two records with equal contents describe the same step. The number alone does not identify a step: an insole with a new
    /// flash chip numbers its steps from 0 again.
    #[must_use]
    pub fn content(&self) -> Self {
        Self { boots_since: 0, ..*self }
    }

    /// True if both records describe the same step, even if the insole restarted between them.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        self.content() == other.content()
    }
}
