//! Limits of those figures of `cargo xtask bench` that are the same on every machine.

use anyhow::{Context, Result, bail};
use serde_json::{Map, Value};

/// Keys of figures, each with its smallest and its largest allowed value.
const LIMITS: [(&str, f64, f64); 52] = [
    ("frame_instructions", 0.0, 10_000.0),
    ("frame_instructions_fractional", 0.0, 16_000.0),
    ("frame_instructions_gains", 0.0, 13_000.0),
    ("cells_instructions", 0.0, 6_000.0),
    ("tracking_instructions", 0.0, 2_000.0),
    ("device_vs_host_force_rel", 0.0, 1e-4),
    ("device_vs_host_area_rel", 0.0, 1e-4),
    ("cells_percent.stance", 0.0, 60.0),
    ("cells_percent.swing", 0.0, 10.0),
    // Errors of a wearer's parameters from an insole's streams, relative to those of parameters from the recorded file.
    ("loop_nrmse_over_file.cells", 0.0, 1.05),
    ("loop_nrmse_over_file.live", 0.0, 1.05),
    ("cells_lost", 0.0, 0.0),
    // The relative difference between parameters that the page and the command line identify.
    ("fit_wasm_equal", 0.0, 1e-6),
    ("live_frame_bytes", 0.0, 112.0),
    ("step_record_bytes", 0.0, 480.0),
    ("bout_record_bytes", 0.0, 200.0),
    ("flash_bytes.emulated", 0.0, 368_640.0),
    ("flash_bytes.nrf52840", 0.0, 368_640.0),
    ("flash_bytes.wb55", 0.0, 368_640.0),
    ("flash_bytes.emulated-bootloader", 0.0, 32_768.0),
    ("flash_bytes.nrf52840-bootloader", 0.0, 32_768.0),
    ("flash_bytes.wb55-bootloader", 0.0, 32_768.0),
    ("ram_bytes.emulated", 0.0, 98_304.0),
    ("ram_bytes.nrf52840", 0.0, 98_304.0),
    ("ram_bytes.wb55", 0.0, 98_304.0),
    ("replay_file_peak_mb", 0.0, 300.0),
    ("fit_evaluations", 0.0, 600.0),
    ("fit_exact_nrmse", 0.0, 0.01),
    ("fit_exact_parameters", 0.0, 1e-4),
    ("fit_coverage", 0.90, 0.99),
    ("nrmse.mean.predicted", 0.0, 9.5),
    ("nrmse.worst.predicted", 0.0, 13.0),
    // The error of parameters from four steps, relative to those from all steps.
    ("nrmse.mean.four_steps", 0.0, 1.15),
    ("fit_at_bound", 0.0, 0.05),
    ("fit_determined", 0.75, 1.0),
    ("repeat.icc.force_at_area", 0.9, 1.0),
    ("repeat.icc.area_at_force", 0.85, 1.0),
    ("repeat.icc.stiffness", 0.8, 1.0),
    // In shoes that press on the insole: the share of the steps that are found, and the number of steps found but not walked.
    ("wear.residual_found", 0.995, 1.0),
    ("wear.residual_extra", 0.0, 0.0),
    ("wear.false_faults", 0.0, 0.0),
    ("wear.force_error", 0.0, 0.02),
    ("wear.unassigned_load", 0.0, 0.001),
    ("wear.kinds_recognised", 0.95, 1.0),
    ("moticon.found", 1.0, 1.0),
    ("moticon.contact_ms", 0.0, 10.0),
    ("moticon.toe_off_ms", 0.0, 15.0),
    ("moticon.peak_force_n", 0.0, 1.0),
    ("moticon.stride_ms", 0.0, 15.0),
    ("moticon.step_ms", 0.0, 15.0),
    ("moticon.double_support_ms", 0.0, 15.0),
    ("moticon.both_phases_ms", 0.0, 35.0),
];

/// Returns an error if a figure is missing or outside of its limits.
pub fn check(figures: &Map<String, Value>) -> Result<()> {
    for (key, least, most) in LIMITS {
        let value = figures.get(key).and_then(Value::as_f64).with_context(|| format!("{key} was not measured"))?;
        if !(least..=most).contains(&value) {
            bail!("{key} is {value}, outside of its limits {least} to {most}");
        }
    }
    Ok(())
}
