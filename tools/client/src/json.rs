//! A step as people and programs read it: names with units, values in the wire's resolution.

use plantar::Region;
use plantar::protocol::{Step, StepRegion};
use serde_json::{Map, Value, json};

/// One object per step; regions by name under `regions`. Values are what the wire carries, so a step that a device sent and
/// the same step computed on a host give the same text.
pub fn step_to_json(step: &Step) -> Value {
    let set = |bits: u8, i: usize| bits >> i & 1 == 1;
    let regions: Map<String, Value> = Region::ALL
        .iter()
        .zip(&step.regions)
        .enumerate()
        .map(|(i, (region, r))| {
            let ellipse: Option<Map<String, Value>> = region_ellipse(r)
                .into_iter()
                .map(|(name, value)| Some((name.trim_start_matches("ellipse_").into(), value?.into())))
                .collect();
            let mut value: Map<String, Value> =
                region_quantities(r).into_iter().map(|(name, value)| (name.into(), value.into())).collect();
            value.insert("area_peak_mm2".into(), r.area_peak_mm2.into());
            value.insert("ellipse_at_peak".into(), ellipse.into());
            value.insert("saturated".into(), set(step.saturated, i).into());
            value.insert("clamped".into(), set(step.clamped, i).into());
            value.insert("masked_cells".into(), r.masked_cells.into());
            (region.name().into(), value.into())
        })
        .collect();
    json!({
        "side": step.side.name(),
        "step": step.step,
        "start_s": step.start_us as f64 / 1e6,
        "duration_s": f64::from(step.duration_us) / 1e6,
        "sample_s": f64::from(step.sample_us) / 1e6,
        "bridged_frames": step.bridged_frames,
        "starts_ago": step.boots_since,
        "start_unix_s": step.start_unix_us.filter(|_| step.boots_since > 0).map(|us| us as f64 / 1e6),
        "contact_rule": contact_rule_to_json(step),
        "regions": regions,
    })
}

/// What a step says of a region, under its name with its unit; the peak area is whole mm2 on the wire and left out here.
pub fn region_quantities(r: &StepRegion) -> [(&'static str, f64); 9] {
    [
        ("measured_force_peak_n", scaled(r.measured_peak_dn, 10)),
        ("model_force_peak_n", scaled(r.model_peak_dn, 10)),
        ("measured_force_integral_n_s", scaled(r.measured_integral_cns, 100)),
        ("model_force_integral_n_s", scaled(r.model_integral_cns, 100)),
        ("deformation_peak_mm", scaled(r.deformation_peak_um, 1000)),
        ("deformation_rate_peak_mm_s", scaled(r.deformation_rate_peak_dmm_s, 10)),
        ("contact_time_s", scaled(r.contact_ms, 1000)),
        ("time_to_peak_s", scaled(r.time_to_peak_ms, 1000)),
        ("model_error_nrmse_percent", scaled(r.model_error_bp, 100)),
    ]
}

/// The contact ellipse at the region's largest force; `None` where it had no contact then.
pub fn region_ellipse(r: &StepRegion) -> [(&'static str, Option<f64>); 5] {
    [
        ("ellipse_x_mm", scaled(r.ellipse_x_dmm, 10)),
        ("ellipse_y_mm", scaled(r.ellipse_y_dmm, 10)),
        ("ellipse_r_a_mm", scaled(r.ellipse_r_a_cmm, 100)),
        ("ellipse_r_b_mm", scaled(r.ellipse_r_b_cmm, 100)),
        ("ellipse_angle_deg", scaled(r.ellipse_angle_ddeg, 10)),
    ]
    .map(|(name, value)| (name, (r.ellipse_r_a_cmm > 0).then_some(value)))
}

fn contact_rule_to_json(step: &Step) -> Value {
    let rule = &step.contact_rule;
    json!({
        "rule": if rule.full_kpa > 0.0 { "fractional" } else { "counted" },
        "on_kpa": rule.on_kpa,
        "off_kpa": rule.off_kpa,
        "full_kpa": rule.full_kpa,
    })
}

/// An integer count of `1/units` as a decimal number, exact to its last digit.
fn scaled(value: impl Into<i32>, units: i32) -> f64 {
    f64::from(value.into()) / f64::from(units)
}
