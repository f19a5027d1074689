//! Tests of [`RegionFit::defects`], the reasons why a part of a region's result is missing or must not be used. A defect of one
//! region does not affect the other regions.

use fit::fixed::Scale;
use fit::results::deformation_scale;
use fit::synthetic::{Noise, curves, law, walk};
use fit::{Filter, Measured, Options, RegionFit, Step, fit, fit_each_step};
use std::f64::consts::PI;

const OPTIONS: Options = Options::usual([0.012; 8]);

fn fitted(steps: &[Step], options: &Options) -> [RegionFit; 8] {
    fit(steps, options, &|_| ()).map(|fit| fit.expect("fitted"))
}

/// Asserts that only the heel has a defect, and returns it.
fn defect_of_heel(fits: &[RegionFit; 8]) -> &str {
    let [heel, others @ ..] = fits;
    others.iter().for_each(|fit| assert!(fit.defects.is_empty(), "{:?}", fit.defects));
    assert_eq!(heel.defects.len(), 1, "{:?}", heel.defects);
    &heel.defects[0]
}

#[test]
fn a_single_step_is_a_defect_and_has_no_predicted_error() {
    let mut steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    assert!(fitted(&steps, &OPTIONS).iter().all(|fit| fit.defects.is_empty()));
    // Only one step can be used for the heel.
    steps[1..].iter_mut().for_each(|step| step.regions[0].saturated = true);
    let fits = fitted(&steps, &OPTIONS);
    assert!(defect_of_heel(&fits).contains("only one step"));
    assert_eq!((fits[0].quality.predicted, fits[0].predicted_nrmse.len()), (None, 0));
    assert!(fits[0].measures.iter().all(|measure| measure.value.is_finite()));
}

#[test]
fn equal_steps_are_a_defect_and_have_finite_results() {
    let mut steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    let heel = steps[0].regions[0].clone();
    steps.iter_mut().for_each(|step| step.regions[0] = heel.clone());
    let fits = fitted(&steps, &OPTIONS);
    assert!(defect_of_heel(&fits).contains("all steps are equal"));
    assert!(fits[0].measures.iter().all(|measure| measure.value.is_finite()));
}

#[test]
fn faulty_cells_of_a_region_are_a_defect() {
    let mut steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    steps[3..].iter_mut().for_each(|step| step.regions[0].record.masked_cells = 2);
    let fits = fitted(&steps, &OPTIONS);
    let expected =
        "the readings of faulty cells (up to 2) were replaced by those of neighbouring cells in 3 of 6 steps; ";
    assert!(defect_of_heel(&fits).starts_with(expected));
    let each = fit_each_step(&steps, 0, &OPTIONS);
    assert_eq!(each.iter().flatten().map(|fit| fit.defects.len()).collect::<Vec<_>>(), [0, 0, 0, 1, 1, 1]);
}

/// Twelve steps with little noise. In the last six, `heel` replaces the curves of the heel; it receives the index of the step
/// and a source of noise.
fn changed(heel: impl Fn(usize, &mut Noise) -> fit::RegionCurves) -> Vec<Step> {
    let mut steps = walk(12, 100.0, Filter::Direct, 0.02, 1);
    let mut noise = Noise::new(7);
    for (i, step) in steps.iter_mut().enumerate().skip(6) {
        step.regions[0] = heel(i, &mut noise);
    }
    steps
}

#[test]
fn a_region_that_changes_within_a_recording_is_named_with_the_remedy() {
    let same = |_, noise: &mut Noise| curves(0, 100.0, Filter::Direct, 1.0, 0.02, noise);
    assert!(fitted(&changed(same), &OPTIONS).iter().all(|fit| fit.defects.is_empty() && fit.change.is_none()));
    // The insole shifted: the cells of the heel measure 1.7 times the force at the same area.
    let shifted = |_, noise: &mut Noise| {
        let mut heel = curves(0, 100.0, Filter::Direct, 1.0, 0.02, noise);
        heel.force_n.iter_mut().for_each(|force| *force *= 1.7);
        heel
    };
    let fits = fitted(&changed(shifted), &OPTIONS);
    let defect = defect_of_heel(&fits);
    assert!(defect.contains("changes within the recording") && defect.contains("--steps"), "{defect}");
    let change = fits[0].change.expect("a change");
    assert!((1.6..1.8).contains(&change.load_ratio), "{change:?}");
    // The tissue follows another law, but carries the same load.
    let other = |_, noise: &mut Noise| {
        let mut heel = curves(0, 100.0, Filter::Direct, 1.0, 0.02, noise);
        let peak_n = heel.force_n.iter().copied().fold(0.0, f64::max);
        heel.force_n.iter_mut().for_each(|force| *force = peak_n * (*force / peak_n).max(0.0).sqrt());
        heel
    };
    let fits = fitted(&changed(other), &OPTIONS);
    assert!(defect_of_heel(&fits).contains("the error of a half"));
    assert!(fits[0].change.is_some_and(|change| change.load_ratio == 1.0 && change.error_ratio > 2.5));
}

/// The exact peak strain and radii of curvature, m, of the heel if its ellipsoid had this C. Computed steps have no contact
/// ellipses, so A = B.
fn measured(steps: &[Step], c_m: f64, thickness_m: f64) -> (f64, [Option<f64>; 2]) {
    let law = law(0);
    let areas_mm2 = steps.iter().flat_map(|step| &step.regions[0].area_mm2);
    let ratio = areas_mm2.fold(0.0f64, |most, &mm2| most.max(mm2)) * 1e-6 / (PI * law.ab_m2);
    let deformation_m = c_m * (1.0 - (1.0 - ratio).sqrt());
    (deformation_m / thickness_m, [Some(law.ab_m2 / c_m); 2])
}

/// Least squares recovers A B of steps without noise, so that every measurement has to result in the true C.
#[test]
fn c_follows_from_the_measurement_of_a_region() {
    const C_M: f64 = 0.009;
    let steps = walk(6, 100.0, Filter::Direct, 0.0, 1);
    let (strain, curvature_m) = measured(&steps, C_M, 0.012);
    let least_squares = Options { prior: None, ..OPTIONS };
    // The last number is the share of assumption, %: a curvature determines C only with the assumption of Eq. 14.
    for (measurement, name, assumed_percent) in [
        (Measured { peak_strain: Some(strain), ..Measured::NONE }, "peak_strain", 50),
        (Measured { curvature_m, ..Measured::NONE }, "curvature", 50),
        (Measured { curvature_m, has_thickness: true, ..Measured::NONE }, "curvature", 50),
        (Measured { curvature_m: [None, curvature_m[1]], ..Measured::NONE }, "curvature", 50),
        (Measured { peak_strain: Some(strain), curvature_m, has_thickness: true }, "peak_strain", 0),
    ] {
        let mut options = least_squares;
        options.measured[0] = measurement;
        let fits = fitted(&steps, &options);
        assert!(fits.iter().all(|fit| fit.defects.is_empty()));
        assert_eq!(fits[0].fixed.scale.name(), name);
        assert_eq!(deformation_scale(&fits[0].fixed).assumed_percent(), assumed_percent, "{name}");
        assert!((fits[0].ellipsoid.c_m / C_M - 1.0).abs() < 1e-5, "{name}: {} m", fits[0].ellipsoid.c_m);
        assert_eq!(fits[1].fixed.scale, Scale::Assumed(OPTIONS.compression));
        // The force does not depend on C.
        let force_n = fits[0].ellipsoid.force_law().force_n(0.4, 1.0);
        assert!((force_n / law(0).force_n(0.4, 1.0) - 1.0).abs() < 1e-5);
    }
}

#[test]
fn contradicting_measurements_are_named_and_the_assumption_is_used() {
    let steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    let (strain, [medial_lateral_m, _]) = measured(&steps, 0.009, 0.012);
    let mut options = OPTIONS;
    options.measured[0] = Measured {
        peak_strain: Some(strain),
        curvature_m: [medial_lateral_m.map(|m| 3.0 * m), None],
        has_thickness: true,
    };
    let fits = fitted(&steps, &options);
    let defect = defect_of_heel(&fits);
    assert!(defect.contains("contradict each other") && defect.contains("peak strain"), "{defect}");
    assert_eq!(fits[0].fixed.scale, Scale::Assumed(OPTIONS.compression));
}

/// The radius and the peak strain yield values of C that differ by a factor close to the limit of 1.5, so that single steps may
/// be on both sides of it.
#[test]
fn all_steps_of_a_recording_have_the_same_source_of_c() {
    let steps = walk(12, 100.0, Filter::Direct, 0.05, 1);
    let (strain, [medial_lateral_m, _]) = measured(&steps, 0.009, 0.012);
    let sources = |steps: &[Step], factor: f64| {
        let mut options = OPTIONS;
        let curvature_m = [medial_lateral_m.map(|m| factor * m), None];
        options.measured[0] = Measured { peak_strain: Some(strain), curvature_m, has_thickness: true };
        let fits = fit_each_step(steps, 0, &options);
        fits.iter().flatten().map(|fit| fit.fixed.scale.name()).collect::<Vec<_>>()
    };
    let mut differ = 0;
    for percent in (100..200).step_by(5) {
        let factor = f64::from(percent) / 100.0;
        let found = sources(&steps, factor);
        assert!(found.len() == 12 && found.iter().all(|name| *name == found[0]), "{factor}: {found:?}");
        // On their own, as recordings of one step, they can have different sources.
        let alone = steps.iter().flat_map(|step| sources(std::slice::from_ref(step), factor));
        differ += usize::from(alone.collect::<std::collections::BTreeSet<_>>().len() > 1);
    }
    assert!(differ > 0);
}

/// C is proportional to the assumed compression, which is changed by 20 %. The expected secant stiffness and secant modulus
/// follow from the force at the reference strain of 20 %, which is a normalised deformation of 0.2 d0 / C for a tissue of the
/// thickness d0.
#[test]
fn the_scale_effect_follows_from_a_c_that_is_20_percent_smaller_or_larger() {
    let steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    let fit = &fitted(&steps, &OPTIONS)[0];
    let effect = fit.scale_effect.expect("known");
    for (values, factor) in [(effect.at_less, 0.8), (effect.at_more, 1.2)] {
        let c_m = factor * fit.law.c_m;
        assert!((values.c_m / c_m - 1.0).abs() < 1e-12);
        let g = 0.2 * 0.012 / c_m;
        let force_n = fit.law.force_n(g, 0.0);
        let deformation_m = 0.2 * 0.012;
        let stiffness = values.secant_stiffness_n_mm.expect("reached");
        assert!((stiffness / (force_n / deformation_m * 1e-3) - 1.0).abs() < 1e-9);
        let area_m2 = PI * fit.law.ab_m2 * g * (2.0 - g);
        let modulus = values.secant_modulus_kpa.expect("reached");
        assert!((modulus / (force_n / area_m2 / 0.2 * 1e-3) - 1.0).abs() < 1e-9);
    }
}
