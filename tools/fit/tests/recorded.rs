//! Fits to recorded steps: their errors agree with an independent reference and with the code of the insole. The recordings are
//! not part of this repository.

use fit::quality::Evaluated;
use fit::steps::ExclusionReason;
use fit::{Bounds, Filter, NotFitted, Options, RegionCurves, Samples, Study};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::region::AreaMoments;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::step::RegionStep;
use plantar::{Region, Side};
use recording::{MAX_CELLS, Recording, VirtualInsole, jiku, pedar};
use std::path::PathBuf;
use std::process::{Command, Stdio};

fn study(recordings: &[Recording], contact: ContactRule) -> Study {
    let mut study = steps_of(recordings, contact, Options::usual([0.012; 8]));
    study.fit(&|_| ());
    study
}

/// A fit by least squares within [`Bounds::PAPER`] and with the paper's smoothing. A region is fitted to the steps that load it
/// with at least 20 N.
fn least_squares(recording: Recording) -> Study {
    let options =
        Options { filter: Filter::Smoothed, bounds: Bounds::PAPER, prior: None, ..Options::usual([0.012; 8]) };
    let mut study = steps_of(&[recording], ContactRule::COUNTED, options);
    for region in study.steps.iter_mut().flat_map(|step| &mut step.regions) {
        if region.force_n.iter().all(|force_n| *force_n < 20.0) {
            *region = RegionCurves::default();
        }
    }
    study.fit(&|_| ());
    study
}

fn steps_of(recordings: &[Recording], contact: ContactRule, options: Options) -> Study {
    let mut study = Study::new("somebody".into(), contact, options);
    for recording in recordings {
        let insole = VirtualInsole::new(recording, contact, StanceRule::ADAPTIVE);
        study.add("a walk".into(), recording, &insole, &mut |_| ()).expect("a valid insole");
    }
    study
}

/// Steps of a walker of the data set SpeedPP2DS.
///
/// # Panics
/// If `PLANTAR_JIKU` does not contain the path of the data set.
fn walker(walker: usize, trials: std::ops::Range<usize>) -> Recording {
    let data = std::env::var_os("PLANTAR_JIKU").expect("PLANTAR_JIKU names the folder SpeedPP2DS of jiku-data");
    jiku::import(PathBuf::from(data), walker, trials, &mut |_, _| ()).expect("jiku-data")
}

/// The root mean square of the NRMSE of each region's steps, %, in fits by SciPy to the same filtered areas within the same
/// bounds. The fits of the study minimise it, too. `None` if the region is not fitted.
fn reference(study: &Study) -> [Option<f64>; 8] {
    let python = std::env::var_os("PLANTAR_PYTHON").expect("PLANTAR_PYTHON names an interpreter with SciPy");
    let is_fitted = |region: &usize| study.fits[*region].is_ok();
    let regions: Vec<_> = (0..8)
        .filter(is_fitted)
        .map(|region| {
            let samples = Samples::new(study.steps.iter().map(|step| &step.regions[region]), Filter::Smoothed);
            let steps: Vec<_> = samples.steps.iter().map(|step| [step.start, step.end]).collect();
            let table: Vec<_> = samples.table().collect();
            serde_json::json!({ "area_max_m2": samples.area_max_m2, "samples": table, "steps": steps })
        })
        .collect();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/least_squares.py");
    let mut child = Command::new(python)
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("Python can be started");
    serde_json::to_writer(child.stdin.take().expect("the standard input is piped"), &regions)
        .expect("the script reads its input");
    let output = child.wait_with_output().expect("the script ends");
    assert!(output.status.success(), "the script fails");
    let text = String::from_utf8(output.stdout).expect("the script prints text");
    let mut percents = text.lines().map(|line| line.parse::<f64>().expect("a number"));
    std::array::from_fn(|region| is_fitted(&region).then(|| percents.next().expect("one line for each region")))
}

/// Asserts that the root mean square of the NRMSE of each fitted region is at most 0.1 percentage points above that of the
/// [`reference`], and at most 0.3 below. The fits of the study use no random starts; the reference is the best
/// of 24 random starts.
fn assert_as_good_as_the_reference(study: &Study) {
    let fitted = study.fits.iter().flatten().count();
    assert!(fitted >= 6, "{fitted} regions of 8 were fitted");
    for (i, reference) in reference(study).into_iter().enumerate() {
        let (region, fit) = (Region::ALL[i], &study.fits[i]);
        match (fit, reference) {
            (Ok(fit), Some(reference)) => {
                let law = fit.ellipsoid.force_law();
                let nrmse = |step: &fit::Step| Some(Evaluated::new(&step.regions[i], Filter::Smoothed, &law)?.nrmse());
                let squares: Vec<f64> = study.steps.iter().filter_map(nrmse).map(|nrmse| nrmse * nrmse).collect();
                let percent = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt() * 100.0;
                println!("{}: {percent:.2} %, by SciPy {reference:.2} %", region.name());
                assert!((reference - 0.3..reference + 0.1).contains(&percent), "{}", region.name());
            }
            (fit, _) => println!("{}: {:?}", region.name(), fit.as_ref().err()),
        }
    }
}

#[test]
#[ignore = "needs the data set SpeedPP2DS and Python with SciPy: cargo xtask test"]
fn barefoot_steps_are_fitted_as_well_as_by_the_reference() {
    let study = least_squares(walker(0, 0..6));
    assert_eq!((study.steps.len(), study.excluded_contacts.len()), (6, 0));
    assert_as_good_as_the_reference(&study);
}

/// The errors of each fit equal the errors that the code of the insole computes from the recording with the same parameters.
#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn the_errors_of_a_fit_are_those_of_the_insole() {
    let walk = walker(2, 0..8);
    for contact in [ContactRule::COUNTED, ContactRule::COVERED] {
        let study = study(std::slice::from_ref(&walk), contact);
        let force_laws: Vec<_> =
            study.fits.iter().map(|f| f.as_ref().map_or(ForceLaw::NONE, |f| ForceLaw { c_m: 0.01, ..f.law })).collect();
        let virtual_insole = VirtualInsole::new(&walk, contact, StanceRule::ADAPTIVE);
        let mut insole = Box::new(Insole::<f64, MAX_CELLS>::new());
        insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("a valid insole");
        let mut codes = vec![0; virtual_insole.cells.len()];
        let mut compared = 0;
        for i in 0..virtual_insole.frames(&walk) {
            virtual_insole.codes_of(&walk, i, &mut codes);
            let number = insole.frame(i as u32, &codes).then(|| insole.whole_step().expect("a step").step);
            // Steps and load bouts are numbered together, and a bout gets its number when it is taken. The study takes
            // the bouts, too, so its steps have the same numbers as those of this insole.
            insole.take_bout();
            let Some(number) = number else { continue };
            let step = study.steps.iter().find(|step| step.number == number).expect("the same steps");
            for (region, law) in force_laws.iter().enumerate().filter(|(_, law)| **law != ForceLaw::NONE) {
                let (area_mm2, force_n, sample_s) = insole.curves(region);
                let computed = RegionStep::new(law, area_mm2, force_n, sample_s, &AreaMoments::NONE);
                let Some(evaluated) = Evaluated::new(&step.regions[region], Filter::Direct, law) else { continue };
                let peak_n = evaluated.model_n.iter().copied().fold(0.0, f64::max);
                assert!((peak_n - computed.model_peak_n).abs() < 1e-9 * (1.0 + peak_n));
                assert!((evaluated.nrmse() - computed.model_error).abs() < 1e-12);
                compared += 1;
            }
        }
        assert!(compared > 40, "{compared}");
    }
}

#[test]
#[ignore = "needs the data set SpeedPP2DS: cargo xtask test"]
fn recordings_of_two_walkers_are_rejected_and_those_of_one_walker_are_not() {
    let (one, more, other) = (walker(1, 0..10), walker(1, 20..30), walker(4, 0..10));
    let mixed = study(&[one.clone(), other], ContactRule::COUNTED);
    let mixed_regions = mixed.fits.iter().filter(|f| matches!(f, Err(NotFitted::MixedPeople(_)))).count();
    assert!((2..8).contains(&mixed_regions), "{mixed_regions}");
    let same_walker = study(&[one, more], ContactRule::COUNTED);
    assert!(same_walker.fits.iter().all(|f| !matches!(f, Err(NotFitted::MixedPeople(_)))));
}

/// Tests with recordings of people, which are not public.
mod unpublished {
    use super::*;

    /// A walk in shoes, both feet.
    ///
    /// # Panics
    /// If `PLANTAR_RECORDINGS` does not name the folder of the recordings.
    fn pedar_feet() -> [Recording; 2] {
        let folder = std::env::var_os("PLANTAR_RECORDINGS").expect("PLANTAR_RECORDINGS names a folder");
        let folder = PathBuf::from(folder).join("pedar");
        let (asc, geometry) = (folder.join("pedar_example.asc"), folder.join("geometry.csv"));
        [Side::Left, Side::Right].map(|side| pedar::import(&asc, &geometry, side, &mut |_, _| ()).expect("pedar data"))
    }

    #[test]
    #[ignore = "needs recordings of people, which are not public (PLANTAR_RECORDINGS), and Python with SciPy"]
    fn steps_in_shoes_are_fitted_as_well_as_by_the_reference() {
        let studies = pedar_feet().map(least_squares);
        assert_eq!(studies.each_ref().map(|s| s.steps.len()), [9, 8]);
        // The recording begins while the person stands and ends within a step.
        assert_eq!(studies.each_ref().map(|s| s.excluded_contacts.len()), [1, 2]);
        assert_eq!(
            studies[1].excluded_contacts.iter().map(|contact| contact.reason).collect::<Vec<_>>(),
            [ExclusionReason::NoHeelStrike, ExclusionReason::NoToeOff]
        );
        studies.iter().for_each(assert_as_good_as_the_reference);
        assert!(matches!(studies[0].fits[6], Err(NotFitted::NeverLoaded)));
    }
}
