//! The results of a fit as a parameter file and as JSON.

use crate::fixed::{FixedParameters, Scale};
use crate::interval::{FIVE, Interval};
use crate::measures::{SCALE_CHANGE, ScaleEffect, ScaledValues};
use crate::sensitivity::{MainResults, Sensitivity};
use crate::study::Source;
use crate::{Method, NotFitted, RegionFit, Study};
use parameters::{BOTH, DeformationScale, Identified, InsoleSize, Parameters};
use plantar::{Region, Side};
use serde_json::{Map, Value, json};

/// Formats a value with three significant digits, but with at most three decimal places, and with all digits before the decimal
/// point.
pub fn significant(value: f64) -> String {
    if value.abs() < 5e-4 {
        return "0".into();
    }
    let digits = 2 - value.abs().log10().floor() as i32;
    format!("{value:.*}", digits.clamp(0, 3) as usize)
}

/// The wider of a parameter's two 95 % intervals: from the Jacobian, and from resampled steps (bootstrap).
pub fn widest(interval: &Interval) -> [f64; 2] {
    let width = |[low, high]: [f64; 2]| high - low;
    interval.bootstrap.filter(|b| width(*b) > width(interval.jacobian)).unwrap_or(interval.jacobian)
}

/// Whether measurements or assumptions determine the scale of the deformation. A C that was searched counts as assumed, because
/// it does not follow from a measurement of the tissue. A curvature determines C without the thickness, but by the relation of
/// depth and contact in Eq. 14, which is an assumption on the compression: an elastic half-space of the same curvature and
/// contact would be compressed twice as much (Hertz).
pub fn deformation_scale(fixed: &FixedParameters) -> DeformationScale {
    match (fixed.scale, fixed.is_thickness_measured) {
        (Scale::PeakStrain(_), true) => DeformationScale::Measured,
        (Scale::PeakStrain(_), false) => DeformationScale::AssumedThickness,
        (Scale::Curvature(_), _) | (Scale::Assumed(_), true) => DeformationScale::AssumedCompression,
        (Scale::Assumed(_), false) | (Scale::Searched(_), _) => DeformationScale::Assumed,
    }
}

/// The identified parameters of the wearer. A region that was not fitted has the typical values of the insole size.
pub fn parameters(study: &Study, size: InsoleSize) -> Parameters {
    let mut parameters = Parameters::typical(size);
    parameters.subject.clone_from(&study.participant);
    parameters.personal = true;
    parameters.identified = Some(Identified {
        filter: study.options.filter.name().into(),
        contact: study.contact,
        side: study.side().map_or(BOTH, Side::name).into(),
        steps: study.steps.len() as u32,
        regions: Region::ALL
            .into_iter()
            .zip(&study.fits)
            .filter(|(_, fit)| fit.is_ok())
            .map(|(region, _)| region)
            .collect(),
    });
    for (region, fit) in study.fits.iter().enumerate() {
        if let Ok(fit) = fit {
            parameters.regions[region] = fit.ellipsoid;
            parameters.deformation[region] = deformation_scale(&fit.fixed);
        }
    }
    parameters
}

/// Makes the parameter file. A region that was not fitted has typical values, with a comment that states this.
pub fn to_toml(study: &Study, size: InsoleSize) -> String {
    parameters(study, size)
        .to_toml_with(&|region, name| Some(note(&study.fits[region as usize], name, study.options.method)))
}

/// The comment in the parameter file on the value `name` of a region: how the value was determined.
fn note(fit: &Result<RegionFit, NotFitted>, name: &str, method: Method) -> String {
    let fit = match fit {
        Ok(fit) => fit,
        Err(reason) if name == "a_mm" => return format!("typical, NOT identified: {reason}"),
        Err(_) => return "typical".into(),
    };
    let Some(uncertainty) = fit.uncertainty.as_ref().filter(|_| method == Method::Projection) else {
        return "identified together with the other seven, by the paper's search".into();
    };
    let identified = |i: usize, scale: f64, unit: &str| -> String {
        let interval = &uncertainty.intervals[i];
        if !interval.is_identifiable {
            return "NOT determined by the force: close to the usual value of other people, uncertain by a factor of more than \
                    100, or without meaning if G is 0"
                .into();
        }
        let [low, high] = widest(interval).map(|end| significant(end * scale));
        let bound = if interval.at_bound { ", at a bound of the search" } else { "" };
        format!("identified: {low} to {high}{unit} (95 %){bound}")
    };
    let fixed = &fit.fixed;
    match name {
        "a_mm" => format!(
            "A B {}; A / B of the contact within the region's borders: {:.2}",
            identified(0, 1e6, " mm2"),
            fixed.aspect
        ),
        "b_mm" => "see a_mm".into(),
        "c_mm" => format!("fixed, not identified: by {}{}", fixed.scale, effect(fit)),
        "d0_mm" if fixed.is_thickness_measured => "fixed, not identified: measured".into(),
        "d0_mm" => "fixed, not identified: typical for the shoe size".into(),
        "k_n_m3" => format!("K = k C^(n+1) / d0^n, {}", identified(1, 1.0, " Pa")),
        "c_n_s_m3" => format!("G = c C^(m+1) / d0^m, {}", identified(2, 1.0, " Pa s")),
        "n" => identified(3, 1.0, ""),
        _ => identified(4, 1.0, ""),
    }
}

/// How C changes with the value that determines it, in words.
fn effect(fit: &RegionFit) -> String {
    fit.scale_effect.map_or(String::new(), |effect| {
        let mm = |values: &ScaledValues| significant(values.c_m * 1e3);
        let percent = SCALE_CHANGE * 100.0;
        let (less, more) = (mm(&effect.at_less), mm(&effect.at_more));
        format!("; C would be {less} mm if this value were {percent:.0} % smaller, {more} mm if {percent:.0} % larger")
    })
}

/// Makes the JSON object with all results.
pub fn to_json(study: &Study) -> Value {
    let regions: Map<String, Value> = Region::ALL
        .iter()
        .zip(&study.fits)
        .zip(study.counted_nrmse)
        .map(|((region, fit), counted)| (region.name().into(), fit_to_json(fit, counted)))
        .collect();
    json!({
        "participant": study.participant,
        "recordings": study.sources.iter().map(|s| json!({
            "name": s.name, "side": s.side.name(),
            "rate_hz": s.rate_hz, "cells": cells(s), "origin": s.origin,
        })).collect::<Vec<_>>(),
        "contact_rule": {
            "on_kpa": study.contact.on_kpa, "off_kpa": study.contact.off_kpa, "full_kpa": study.contact.full_kpa,
        },
        "filter": study.options.filter.name(),
        "method": study.options.method.name(),
        "prior": study.options.prior.is_some(),
        "steps": study.steps.iter().map(|s| json!({
            "recording": s.recording, "number": s.number, "start_s": s.start_s, "duration_s": s.duration_s,
            "peak_force_n": s.peak_n,
        })).collect::<Vec<_>>(),
        "left_out": study.excluded_contacts.iter().map(|c| json!({
            "recording": c.recording, "at_s": c.at_s, "why": c.reason.to_string(),
        })).collect::<Vec<_>>(),
        "regions": regions,
        "is_complete": study.is_complete(),
        "sensitivity": study.sensitivity.as_ref().map(sensitivity_to_json),
    })
}

/// The number of cells of a recording; `None` for a live stream, which does not contain the cells.
fn cells(source: &Source) -> Option<usize> {
    #[cfg(feature = "recordings")]
    return Some(source.layout.cells.len()).filter(|&cells| cells > 0);
    #[cfg(not(feature = "recordings"))]
    {
        let _ = source;
        None
    }
}

/// `counted_nrmse` is the value of the region in [`Study::counted_nrmse`].
fn fit_to_json(fit: &Result<RegionFit, NotFitted>, counted_nrmse: Option<f64>) -> Value {
    let fit = match fit {
        Ok(fit) => fit,
        Err(reason) => return json!({ "fitted": false, "reason": reason.to_string() }),
    };
    let (law, e, q) = (&fit.law, &fit.ellipsoid, &fit.quality);
    let intervals = fit.uncertainty.as_ref().map(|uncertainty| {
        let names = ["ab_m2", "stiffness_pa", "damping_pa_s", "n", "m"];
        let interval_to_json = |i: &Interval| {
            json!({ "jacobian": i.jacobian, "bootstrap": i.bootstrap, "at_bound": i.at_bound, "is_identifiable": i.is_identifiable })
        };
        let all: Map<String, Value> =
            names.iter().zip(&uncertainty.intervals).map(|(name, i)| ((*name).into(), interval_to_json(i))).collect();
        json!({ "order": FIVE, "intervals_95": all, "correlation": uncertainty.correlation })
    });
    json!({
        "fitted": true,
        "steps": fit.steps,
        "area_max_mm2": fit.area_max_m2 * 1e6,
        "quantities": fit.measures.iter().map(|m| {
            let measure = json!({ "value": m.value, "interval_95": m.interval, "is_determined": m.is_determined() });
            (m.quantity.name(), measure)
        }).collect::<Map<String, Value>>(),
        "identified": {
            "ab_m2": law.ab_m2, "stiffness_pa": law.stiffness_pa, "damping_pa_s": law.damping_pa_s,
            "n": law.n, "m": law.m,
        },
        "uncertainty": intervals,
        "ellipsoid": {
            "a_mm": e.a_m * 1e3, "b_mm": e.b_m * 1e3, "c_mm": e.c_m * 1e3, "d0_mm": e.d0_m * 1e3,
            "k_n_m3": e.k, "n": e.n, "c_n_s_m3": e.c, "m": e.m,
        },
        "pinned": {
            "aspect": fit.fixed.aspect,
            "d0_mm": fit.fixed.thickness_m * 1e3,
            "d0_by": match fit.fixed.scale {
                Scale::Searched(_) => "search",
                _ if fit.fixed.is_thickness_measured => "measurement",
                _ => "shoe_size",
            },
            "by": fit.fixed.scale.name(),
            "deformation_scale": deformation_scale(&fit.fixed).name(),
            "assumed_percent": deformation_scale(&fit.fixed).assumed_percent(),
            "compression": fit.fixed.compression(law, fit.area_max_m2),
            "effect": fit.scale_effect.as_ref().map(effect_to_json),
        },
        "nrmse_percent": {
            "fitted": q.fitted * 100.0, "fitted_smoothed": q.fitted_smoothed * 100.0,
            "own": q.own * 100.0, "own_smoothed": q.own_smoothed * 100.0,
            "predicted": q.predicted.map(|p| p * 100.0), "predicted_counted": counted_nrmse.map(|p| p * 100.0),
            "floor": q.floor * 100.0,
        },
        "peak_bias_percent": q.peak_bias * 100.0,
        "saturated_share": q.saturated,
        "unseen_percent": fit.predicted_nrmse.iter().map(|share| share * 100.0).collect::<Vec<_>>(),
        "area_levels": fit.area_levels,
        "recordings_ratio": fit.recordings_ratio,
        "change": fit.change.map(|c| json!({ "load_ratio": c.load_ratio, "error_ratio": c.error_ratio })),
        "ellipse_misfit_percent": fit.ellipse_misfit.map(|share| share * 100.0),
        "evaluations": fit.evaluations,
        "verdict": fit.verdict,
        "defects": fit.defects,
        "warnings": fit.warnings,
    })
}

fn effect_to_json(effect: &ScaleEffect) -> Value {
    let values_to_json = |values: &ScaledValues| {
        json!({
            "c_mm": values.c_m * 1e3,
            "secant_stiffness_n_mm": values.secant_stiffness_n_mm,
            "secant_modulus_kpa": values.secant_modulus_kpa,
        })
    };
    let (less, more) = (values_to_json(&effect.at_less), values_to_json(&effect.at_more));
    json!({ "change_percent": SCALE_CHANGE * 100.0, "at_less": less, "at_more": more })
}

fn sensitivity_to_json(sensitivity: &Sensitivity) -> Value {
    let results_to_json = |results: &MainResults| {
        json!({
            "force_at_70_percent_area_n": results.force_at_area_n,
            "area_at_50_percent_force_mm2": results.area_at_half_force_mm2,
            "secant_stiffness_n_mm": results.secant_stiffness_n_mm,
            "predicted_nrmse_percent": results.predicted_nrmse.map(|share| share * 100.0),
        })
    };
    json!({
        "variants": sensitivity.variants.iter().map(|variant| json!({
            "kind": variant.choice.kind(),
            "choice": variant.choice.to_string(),
            "regions": Region::ALL.iter().zip(&variant.regions)
                .map(|(region, results)| (region.name().into(), results.as_ref().map_or(Value::Null, results_to_json)))
                .collect::<Map<String, Value>>(),
        })).collect::<Vec<_>>(),
        "skipped": sensitivity.skipped,
    })
}
