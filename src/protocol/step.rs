//! The step record as a message. The macro `quantities` in `quantities.rs` documents the form of the declarations.
//! Equation numbers are those of the paper that [`crate::pipeline::model`] implements.

use super::quantities::{bits, quantities};
use crate::num::Real;
use crate::pipeline::contact::ContactRule;
use crate::pipeline::measures::FootMeasures;
use crate::pipeline::region::Side;
use crate::pipeline::step::{RegionStep, StepRecord};
use postcard::fixint::le;
use serde::{Deserialize, Serialize};

quantities! {
    /// A [`StepRecord`] in scaled integers.
    #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
    pub struct Step {
        /// Number of the record; continues after a restart as long as the flash chip is the same.
        step: u32 = record.step
            => step [1 per "count"],
            "Steps, load bouts and alerts are numbered together.";
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
            "Frame time; a multiple of it if more than 256 frames passed until toe off was confirmed.";
        /// Number of frames that were missing and bridged by straight lines.
        bridged_frames: u16 = record.bridged_frames
            => bridged_frames [1 per "count"],
            "Gaps in the numbers of scanned frames.";
        /// A cell was saturated, so the forces are lower bounds.
        saturated: u8 = record.saturated,
            flags "The code of a cell reached the end of the scale.";
        /// The contact exceeded the ellipsoid: the deformation was limited to C, a lower bound, and the model force is that at C.
        clamped: u8 = bits(&record.regions, |region| region.clamped),
            flags "The contact area exceeded pi A B.";
        /// The contact rule of the areas.
        contact_rule: ContactRule = record.contact_rule;
        /// The foot.
        foot: StepFoot = StepFoot::new(&record.foot);
        /// The regions, in the order of [`crate::Region::ALL`].
        regions: [StepRegion; 8] = record.regions.each_ref().map(StepRegion::new);
        /// Boots of the insole since the one that recorded this step; `start_s` counts from that boot.
        boots_since: u32 = 0
            => boots_since [1 per "count"],
            "Counted by the insole.";
        /// `start_us` on the wall clock (UTC; local time if Current Time has set it), us since 1970; `None` if it was not set.
        start_unix_us: Option<u64> = None;
        /// K has changed by so much since the identification that the wearer's parameters should be identified again.
        refit: u8 = record.refit(),
            flags "The tracked K differs from the identified one by more than 1.4 times the minimal detectable change of the region.";
    }

    /// Rounds a step of the running boot to the integer units of the message.
    pub fn new<R: Real>(record: &StepRecord<R>);
}

quantities! {
    /// The foot in a [`Step`].
    #[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
    pub struct StepFoot {
        /// Largest total force in a sample.
        #[serde(with = "le")]
        peak_dn: u16 = (foot.peak_n * R::of(10.0)).round_u16()
            => foot_force_peak_n [10 per "N"],
            "Sum of the measured forces of the regions.";
        /// First peak of the total force.
        #[serde(with = "le")]
        first_peak_dn: u16 = (foot.first_peak.force_n * R::of(10.0)).round_u16()
            => foot_first_peak_n [10 per "N"],
            "Largest total force in the first half of stance; in a step with one hump, in the whole stance.";
        /// Time from heel strike to the first peak.
        #[serde(with = "le")]
        first_peak_ms: u16 = (foot.first_peak.t_s * R::of(1e3)).round_u16()
            => foot_first_peak_time_s [1000 per "s"],
            "Largest total force in the first half of stance; in a step with one hump, in the whole stance.";
        /// Valley between the two peaks of the total force.
        #[serde(with = "le")]
        valley_dn: u16 = (foot.valley.force_n * R::of(10.0)).round_u16()
            => foot_valley_n [10 per "N"] if second_peak_dn,
            "Smallest total force between the two peaks, at least 5 % below both.";
        /// Time from heel strike to the valley.
        #[serde(with = "le")]
        valley_ms: u16 = (foot.valley.t_s * R::of(1e3)).round_u16()
            => foot_valley_time_s [1000 per "s"] if second_peak_dn,
            "Smallest total force between the two peaks.";
        /// Second peak of the total force.
        #[serde(with = "le")]
        second_peak_dn: u16 = (foot.second_peak.force_n * R::of(10.0)).round_u16()
            => foot_second_peak_n [10 per "N"] if second_peak_dn,
            "Largest total force in the second half of stance.";
        /// Time from heel strike to the second peak.
        #[serde(with = "le")]
        second_peak_ms: u16 = (foot.second_peak.t_s * R::of(1e3)).round_u16()
            => foot_second_peak_time_s [1000 per "s"] if second_peak_dn,
            "Largest total force in the second half of stance.";
        /// Force-time integral of the total force.
        #[serde(with = "le")]
        integral_dns: u16 = (foot.integral_n_s * R::of(10.0)).round_u16()
            => foot_force_integral_n_s [10 per "N s"],
            "Sum of the samples times the time between them.";
        /// Centre of pressure at 10 % of stance, to the lateral side in foot coordinates.
        #[serde(with = "le")]
        gait_x_10_dmm: i16 = (foot.gait_line_mm[0].0 * R::of(10.0)).round_i16()
            => gait_x_10_mm as "gait_line.x_10_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 10 % of stance, from heel to toe in foot coordinates.
        #[serde(with = "le")]
        gait_y_10_dmm: i16 = (foot.gait_line_mm[0].1 * R::of(10.0)).round_i16()
            => gait_y_10_mm as "gait_line.y_10_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 30 % of stance, to the lateral side in foot coordinates.
        #[serde(with = "le")]
        gait_x_30_dmm: i16 = (foot.gait_line_mm[1].0 * R::of(10.0)).round_i16()
            => gait_x_30_mm as "gait_line.x_30_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 30 % of stance, from heel to toe in foot coordinates.
        #[serde(with = "le")]
        gait_y_30_dmm: i16 = (foot.gait_line_mm[1].1 * R::of(10.0)).round_i16()
            => gait_y_30_mm as "gait_line.y_30_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 50 % of stance, to the lateral side in foot coordinates.
        #[serde(with = "le")]
        gait_x_50_dmm: i16 = (foot.gait_line_mm[2].0 * R::of(10.0)).round_i16()
            => gait_x_50_mm as "gait_line.x_50_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 50 % of stance, from heel to toe in foot coordinates.
        #[serde(with = "le")]
        gait_y_50_dmm: i16 = (foot.gait_line_mm[2].1 * R::of(10.0)).round_i16()
            => gait_y_50_mm as "gait_line.y_50_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 70 % of stance, to the lateral side in foot coordinates.
        #[serde(with = "le")]
        gait_x_70_dmm: i16 = (foot.gait_line_mm[3].0 * R::of(10.0)).round_i16()
            => gait_x_70_mm as "gait_line.x_70_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 70 % of stance, from heel to toe in foot coordinates.
        #[serde(with = "le")]
        gait_y_70_dmm: i16 = (foot.gait_line_mm[3].1 * R::of(10.0)).round_i16()
            => gait_y_70_mm as "gait_line.y_70_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 90 % of stance, to the lateral side in foot coordinates.
        #[serde(with = "le")]
        gait_x_90_dmm: i16 = (foot.gait_line_mm[4].0 * R::of(10.0)).round_i16()
            => gait_x_90_mm as "gait_line.x_90_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure at 90 % of stance, from heel to toe in foot coordinates.
        #[serde(with = "le")]
        gait_y_90_dmm: i16 = (foot.gait_line_mm[4].1 * R::of(10.0)).round_i16()
            => gait_y_90_mm as "gait_line.y_90_mm" [10 per "mm"],
            "Sum over the cells of force times position, divided by the total force.";
        /// Length of the path of the centre of pressure from 10 to 90 % of stance.
        #[serde(with = "le")]
        gait_length_dmm: u16 = (foot.gait_length_mm * R::of(10.0)).round_u16()
            => gait_length_mm as "gait_line.length_mm" [10 per "mm"],
            "Sum of the distances between successive samples.";
        /// Extent of this path along the medial-lateral axis.
        #[serde(with = "le")]
        gait_width_dmm: u16 = (foot.gait_width_mm * R::of(10.0)).round_u16()
            => gait_width_mm as "gait_line.width_mm" [10 per "mm"],
            "Largest minus smallest position.";
        /// Mean velocity of the centre of pressure on this path.
        #[serde(with = "le")]
        gait_velocity_mm_s: u16 = foot.gait_velocity_mm_s.round_u16()
            => gait_velocity_mm_s as "gait_line.velocity_mm_s" [1 per "mm/s"],
            "Length divided by time.";
        // On the wire, 0 stands for no index, and an index that would be rounded to 0 is 0.1 %.
        /// Centre of pressure excursion index; positive if the path is lateral of the line between its ends.
        #[serde(with = "le")]
        excursion_index_dpercent: i16 = foot.excursion_index.map_or(0, |index| match (index * R::of(1e3)).round_i16() {
            0 => 1,
            index => index,
        })
            => cop_excursion_index_percent [10 per "%"] if excursion_index_dpercent,
            "Distance from that line at two thirds of the foot, divided by the width of the forefoot.";
        /// Arch index.
        #[serde(with = "le")]
        arch_index_permille: u16 = (foot.arch_index * R::of(1e3)).round_u16()
            => arch_index_percent [10 per "%"],
            "Largest contact area of the midfoot, divided by the sum of those of heel, midfoot and metatarsals.";
    }

    /// Rounds the measures of a foot to the integer units of the message.
    fn new<R: Real>(foot: &FootMeasures<R>);
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
            => model_force_peak_n [10 per "N"] if model_peak_dn,
            "Eq. 13 with Eq. 14, on the contact area.";
        /// Force-time integral of the measured force.
        #[serde(with = "le")]
        measured_integral_dns: u16 = (region.measured_integral_n_s * R::of(10.0)).round_u16()
            => measured_force_integral_n_s [10 per "N s"],
            "Sum of the samples times the time between them.";
        /// Force-time integral of the model force.
        #[serde(with = "le")]
        model_integral_dns: u16 = (region.model_integral_n_s * R::of(10.0)).round_u16()
            => model_force_integral_n_s [10 per "N s"] if model_peak_dn,
            "Sum of the samples times the time between them.";
        /// Largest contact area; the effective area if the contact rule has covered shares.
        #[serde(with = "le")]
        area_peak_mm2: u16 = (region.area_peak_mm2 * R::of(1.0)).round_u16()
            => area_peak_mm2 [1 per "mm2"],
            "Sum of the areas of the cells in contact; with covered shares, each times its share, which depends on pressure and cell size.";
        /// Largest tissue deformation of the model (scaled by assumption, unless its scale was measured).
        #[serde(with = "le")]
        deformation_peak_um: u16 = (region.deformation_peak_m * R::of(1e6)).round_u16()
            => deformation_peak_mm [1000 per "mm"] if model_peak_dn,
            "Eq. 14, on the contact area.";
        /// Largest rate of the deformation (scaled by assumption as well) under increasing load.
        #[serde(with = "le")]
        deformation_rate_peak_dmm_s: u16 = (region.deformation_rate_peak_m_s * R::of(1e4)).round_u16()
            => deformation_rate_peak_mm_s [10 per "mm/s"] if model_peak_dn,
            "Difference of the deformation over 20 ms, instead of over one sample as in Eq. 16.";
        /// Time from the region's first sample in contact to the end of its last one; a sample lasts until the next one.
        #[serde(with = "le")]
        contact_ms: u16 = (region.contact_s * R::of(1e3)).round_u16()
            => contact_time_s [1000 per "s"],
            "Samples with a contact area above 0.";
        /// Time from the region's first sample in contact to its largest measured force.
        #[serde(with = "le")]
        time_to_peak_ms: u16 = (region.time_to_peak_s * R::of(1e3)).round_u16()
            => time_to_peak_s [1000 per "s"],
            "A frame with the largest measured force; the first one if every frame is a sample.";
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
        /// Radius of the ellipse along the axis nearer to the medial-lateral one; 0 on the wire without contact.
        #[serde(with = "le")]
        ellipse_r_a_cmm: u16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.r_a_mm * R::of(100.0)).round_u16())
            => ellipse_r_a_mm as "ellipse_at_peak.r_a_mm" [100 per "mm"] if ellipse_r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Radius of the ellipse along the axis nearer to the heel-toe one; 0 on the wire without contact.
        #[serde(with = "le")]
        ellipse_r_b_cmm: u16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.r_b_mm * R::of(100.0)).round_u16())
            => ellipse_r_b_mm as "ellipse_at_peak.r_b_mm" [100 per "mm"] if ellipse_r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Angle from the x axis to the axis of the first radius, positive from the x axis to the y axis.
        #[serde(with = "le")]
        ellipse_angle_ddeg: i16 = region.ellipse_at_peak.map_or(0, |ellipse| (ellipse.angle_deg() * 10.0).round_i16())
            => ellipse_angle_deg as "ellipse_at_peak.angle_deg" [10 per "deg"] if ellipse_r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Root mean square of model minus measured force over the contact, relative to the largest measured force.
        #[serde(with = "le")]
        model_error_bp: u16 = (region.model_error * R::of(1e4)).round_u16()
            => model_error_nrmse_percent [100 per "%"] if model_peak_dn,
            "Eq. 20, against the unsmoothed measured force.";
        /// Number of masked cells at toe off; 255 for more.
        masked_cells: u8 = region.masked_cells
            => masked_cells [1 per "count"],
            "Cells that the fault detector replaces by the mean of their neighbours, or by zero.";
        /// Change of K since the identification; 0 without tracking.
        stiffness_change_percent: i8 = (region.stiffness_change * R::of(100.0)).round_i16().clamp(-100, 127) as i8
            => stiffness_change_percent [1 per "%"],
            "Recursive least squares over the recent steps, Eq. 13.";
        /// Largest pressure of a cell.
        #[serde(with = "le")]
        peak_pressure_dkpa: u16 = (region.measures.peak_pressure_kpa * R::of(10.0)).round_u16()
            => peak_pressure_kpa [10 per "kPa"],
            "Largest pressure of any cell of the region in the step.";
        /// Time from heel strike to the largest pressure of a cell.
        #[serde(with = "le")]
        peak_pressure_ms: u16 = (region.measures.peak_pressure_s * R::of(1e3)).round_u16()
            => peak_pressure_time_s [1000 per "s"],
            "A frame with this pressure; the first one if every frame is a sample.";
        /// Pressure-time integral.
        #[serde(with = "le")]
        pressure_integral_dkpas: u16 = (region.measures.pressure_integral_kpa_s * R::of(10.0)).round_u16()
            => pressure_integral_kpa_s [10 per "kPa s"],
            "Largest cell pressure in each sample, times the time between samples, summed.";
        /// Mean pressure at the largest measured force.
        #[serde(with = "le")]
        mean_pressure_dkpa: u16 = (region.measures.mean_pressure_kpa * R::of(10.0)).round_u16()
            => mean_pressure_kpa [10 per "kPa"],
            "Force divided by contact area; with covered shares, by the effective area.";
        /// Loading rate.
        #[serde(with = "le")]
        loading_rate_n_s: u16 = region.measures.loading_rate_n_s.round_u16()
            => loading_rate_n_s [1 per "N/s"],
            "Slope of the force between 20 and 80 % of its first peak.";
        /// Time from heel strike to the region's first sample in contact.
        #[serde(with = "le")]
        contact_start_ms: u16 = (region.measures.contact_start_s * R::of(1e3)).round_u16()
            => contact_start_s [1000 per "s"],
            "First sample with a contact area above 0.";
        /// Force under the lifted foot, which is subtracted from the measured force; 255 for more.
        residual_n: u8 = region.measures.residual_n.round_u16().min(255) as u8
            => residual_force_n [1 per "N"],
            "Sum over the cells of the pressure of their baselines times area.";
        /// Largest contact area by the counted rule, beside the effective area.
        #[serde(with = "le")]
        counted_peak_mm2: u16 = region.counted_peak_mm2.round_u16()
            => counted_area_peak_mm2 [1 per "mm2"],
            "Sum of the areas of the cells in contact, each with its whole area; the largest contact area if the contact rule counts whole cells.";
    }

    /// Rounds a region to the integer units of the message.
    fn new<R: Real>(region: &RegionStep<R>);
}

impl StepRegion {
    /// False if the region has no model force, and none of the other results of the model: the insole has no parameters, or the
    /// region carries almost no load.
    pub fn has_model(&self) -> bool {
        self.model_peak_dn > 0
    }
}
