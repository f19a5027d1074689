//! The reasons why a region is not fitted, the steps that a fit uses, its errors on other steps, and its repeatability.

use fit::interval::RESAMPLES;
use fit::quality::Evaluated;
use fit::synthetic::{Noise, curves, walk};
use fit::{Filter, Method, NotFitted, Options, RegionCurves, Step, fit};
use plantar::Side;

const OPTIONS: Options = Options::usual([0.012; 8]);

/// Six steps in which `heel` replaces the curves of the heel.
fn with_heel(heel: impl Fn(RegionCurves) -> RegionCurves) -> Vec<Step> {
    let mut steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    for step in &mut steps {
        step.regions[0] = heel(std::mem::take(&mut step.regions[0]));
    }
    steps
}

fn reason(steps: &[Step]) -> NotFitted {
    let fits = fit(steps, &OPTIONS, &|_| ());
    assert!(fits[1..].iter().all(Result::is_ok), "the other regions are fitted");
    fits[0].clone().expect_err("the heel is not fitted")
}

/// Replaces all areas during contact by `value`.
fn set_all(area_mm2: &mut [f64], value: f64) {
    area_mm2.iter_mut().filter(|a| **a > 0.0).for_each(|a| *a = value);
}

#[test]
fn each_reason_is_recognised() {
    let never = with_heel(|c| RegionCurves { area_mm2: vec![0.0; c.area_mm2.len()], ..c });
    assert_eq!(reason(&never), NotFitted::NeverLoaded);
    let zero = with_heel(|c| RegionCurves { force_n: vec![0.0; c.force_n.len()], ..c });
    assert_eq!(reason(&zero), NotFitted::ZeroForce);
    let weak = with_heel(|c| RegionCurves { force_n: c.force_n.iter().map(|f| f * 0.01).collect(), ..c });
    assert!(matches!(reason(&weak), NotFitted::HardlyLoaded(peak_n) if (1.0..3.0).contains(&peak_n)));
    // Rounded to one decimal, the force would equal the limit.
    assert!(NotFitted::HardlyLoaded(2.96).to_string().contains("at most 2.96 N in any step, at least 3 N are needed"));
    let few = with_heel(|c| {
        let short = |v: &[f64]| v.iter().copied().skip(10).take(8).collect::<Vec<_>>();
        RegionCurves { area_mm2: short(&c.area_mm2), force_n: short(&c.force_n), ..c }
    });
    assert_eq!(reason(&few), NotFitted::TooFewFrames(8));
    let single = with_heel(|c| RegionCurves { has_single_cell: true, ..c });
    assert_eq!(reason(&single), NotFitted::SingleCell);
    let clipped = with_heel(|c| RegionCurves { saturated: true, ..c });
    assert_eq!(reason(&clipped), NotFitted::SaturatedCell);
    let constant = with_heel(|mut c| {
        set_all(&mut c.area_mm2, 2000.0);
        c
    });
    assert_eq!(reason(&constant), NotFitted::ConstantArea);
    let flat = with_heel(|mut c| {
        c.force_n.fill(300.0);
        c
    });
    assert_eq!(reason(&flat), NotFitted::ConstantForce);
    let saturated = with_heel(|mut c| {
        c.area_mm2.iter_mut().for_each(|a| *a = (*a * 5.0).min(2000.0));
        c
    });
    assert!(matches!(reason(&saturated), NotFitted::SaturatedArea(share) if share > 0.8));
    assert!(fit(&[], &OPTIONS, &|_| ()).iter().all(|f| f == &Err(NotFitted::NoSteps)));
}

/// With a thickness of 5 m, the ellipsoid is larger than an insole accepts.
#[test]
fn parameters_outside_of_the_range_of_an_insole_are_rejected() {
    let steps = walk(3, 100.0, Filter::Direct, 0.01, 1);
    let fits = fit(&steps, &Options { thickness_m: [5.0; 8], ..OPTIONS }, &|_| ());
    assert!(fits.iter().all(|f| f == &Err(NotFitted::OutOfRange)));
}

/// On steps that were not used for the fit, the error is the standard deviation of the noise.
#[test]
fn many_steps_are_cross_validated_in_groups() {
    let steps = walk(70, 50.0, Filter::Direct, 0.03, 1);
    for fit in fit(&steps, &OPTIONS, &|_| ()) {
        let fit = fit.expect("fitted");
        assert_eq!(fit.predicted_nrmse.len(), 70);
        let mean = fit.predicted_nrmse.iter().sum::<f64>() / 70.0;
        assert!((0.025..0.035).contains(&mean) && Some(mean) == fit.quality.predicted, "{mean}");
    }
}

/// One of five steps is stiffer than the others, so that the residuals of a fit to all five are larger than those of a fit to the
/// other four. The predicted error of each step must depend on the fit to the others only.
#[test]
fn the_predicted_error_of_a_step_is_that_of_a_separate_fit_to_the_others() {
    let mut steps = walk(5, 100.0, Filter::Direct, 0.02, 1);
    for region in &mut steps[0].regions {
        region.force_n.iter_mut().for_each(|force_n| *force_n *= 1.2);
    }
    let fits = fit(&steps, &OPTIONS, &|_| ());
    for left_out in 0..5 {
        let others: Vec<Step> =
            steps.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, step)| step.clone()).collect();
        for (region, (fit, others)) in fits.iter().zip(fit(&others, &OPTIONS, &|_| ())).enumerate() {
            let law = &others.expect("fitted").law;
            let alone =
                Evaluated::new(&steps[left_out].regions[region], OPTIONS.filter, law).expect("in contact").nrmse();
            let predicted = fit.as_ref().expect("fitted").predicted_nrmse[left_out];
            assert!(
                (predicted / alone - 1.0).abs() < 0.01,
                "step {left_out}, region {region}: {predicted}, alone {alone}"
            );
        }
    }
}

#[test]
fn steps_that_fail_the_screening_are_not_used_for_a_region() {
    let mut steps = walk(6, 100.0, Filter::Direct, 0.01, 1);
    steps[2].regions[0].saturated = true;
    steps[4].regions[0].force_n.iter_mut().for_each(|f| *f *= 0.01);
    let fits = fit(&steps, &OPTIONS, &|_| ());
    assert_eq!(fits[0].as_ref().expect("fitted").steps, [0, 1, 3, 5]);
    assert_eq!(fits[1].as_ref().expect("fitted").steps.len(), 6);
}

/// Recordings disagree if the tissue differs. They do not disagree if only the noise differs.
#[test]
fn recordings_of_two_people_are_recognised() {
    let one = walk(10, 100.0, Filter::Direct, 0.02, 1);
    let mut other = walk(10, 100.0, Filter::Direct, 0.02, 2);
    other.iter_mut().for_each(|step| step.recording = 1);
    let same = [one.clone(), other.clone()].concat();
    let fits = fit(&same, &OPTIONS, &|_| ());
    assert!(fits.iter().all(|f| f.as_ref().is_ok_and(|f| f.recordings_ratio.is_some_and(|r| r < 1.3))));

    let mut noise = Noise::new(3);
    for step in &mut other {
        for region in 0..3 {
            let mut stiffer = curves(region, 100.0, Filter::Direct, 1.0, 0.02, &mut noise);
            stiffer.force_n.iter_mut().for_each(|f| *f *= 1.6);
            step.regions[region] = stiffer;
        }
    }
    let fits = fit(&[one.clone(), other.clone()].concat(), &OPTIONS, &|_| ());
    for (region, fit) in fits.iter().enumerate() {
        assert_eq!(matches!(fit, Err(NotFitted::MixedPeople(_))), region < 3, "region {region}");
    }
    // The two feet of a person may differ.
    other.iter_mut().for_each(|step| step.side = Side::Left);
    assert!(fit(&[one, other].concat(), &OPTIONS, &|_| ()).iter().all(Result::is_ok));
}

/// The same steps result in the same numbers, including the numbers of the bootstrap, with any number of threads.
#[test]
fn a_fit_is_repeatable_and_its_bootstrap_agrees_with_the_jacobian() {
    let steps = walk(12, 100.0, Filter::Direct, 0.01, 4);
    let options = Options { resamples: RESAMPLES, ..OPTIONS };
    let once = fit(&steps, &options, &|_| ());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    assert_eq!(once, pool.install(|| fit(&steps, &options, &|_| ())));
    // The force differs from the model by white noise only, so both kinds of interval have about the same width.
    for (region, fit) in once.iter().enumerate() {
        let uncertainty = fit.as_ref().expect("fitted").uncertainty.as_ref().expect("intervals");
        for interval in &uncertainty.intervals {
            let width = |[low, high]: [f64; 2]| high - low;
            let ratio = width(interval.bootstrap.expect("twelve steps")) / width(interval.jacobian);
            assert!((0.3..3.0).contains(&ratio), "region {region}: {interval:?}");
        }
    }
}

#[test]
fn the_method_of_the_paper_results_in_valid_ellipsoids() {
    let steps = walk(1, 100.0, Filter::Direct, 0.01, 4);
    let fits = fit(&steps, &Options { method: Method::Paper, ..OPTIONS }, &|_| ());
    for (fit, curves) in fits.iter().zip(&steps[0].regions) {
        let fit = fit.as_ref().expect("fitted");
        assert!(fit.ellipsoid.is_valid() && fit.uncertainty.is_none());
        let law = fit.ellipsoid.force_law();
        let nrmse = fit::quality::Evaluated::new(curves, Filter::Direct, &law).expect("contact").nrmse();
        assert!((nrmse - fit.quality.fitted).abs() < 1e-9 && nrmse < 0.5, "{nrmse}: {:?}", fit.quality);
    }
}
