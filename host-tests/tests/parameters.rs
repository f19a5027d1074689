//! Conversion between parameter files and the parameters on an insole: it preserves every bit in either direction.

use parameters::{DeformationScale, InsoleSize, Parameters};
use plantar::pipeline::model::{AB_M2, COEFFICIENT, ForceLaw, LENGTH_M, MAX_EXPONENT};
use plantar::pipeline::tissue::Tissue;
use proptest::prelude::*;
use std::ops::RangeInclusive;
use std::path::Path;

/// Numbers within limits, and often a limit itself. Their bit patterns are evenly distributed, so that all magnitudes occur.
fn within(limit: &RangeInclusive<f64>) -> impl Strategy<Value = f32> + use<> {
    let (least, most) = (*limit.start() as f32, *limit.end() as f32);
    let inside = (least.to_bits()..=most.to_bits()).prop_map(f32::from_bits);
    prop_oneof![8 => inside, 1 => Just(least), 1 => Just(most)]
}

/// Exponents within their limits, above -1.
fn exponent() -> impl Strategy<Value = f32> {
    let negative = within(&(0.0..=f64::from(1.0f32.next_down()))).prop_map(|v| -v);
    prop_oneof![within(&(0.0..=MAX_EXPONENT)), negative]
}

fn tissue() -> impl Strategy<Value = Tissue> {
    let numbers =
        (within(&AB_M2), within(&LENGTH_M), within(&COEFFICIENT), within(&COEFFICIENT), exponent(), exponent());
    let law = numbers.prop_map(|(ab_m2, c_m, stiffness_pa, damping_pa_s, n, m)| ForceLaw {
        ab_m2,
        c_m,
        stiffness_pa,
        damping_pa_s,
        n,
        m,
    });
    prop::array::uniform8(law).prop_map(Tissue::new)
}

/// The parameters after they were written to a file and read again.
fn through_a_file(parameters: &Parameters) -> Parameters {
    Parameters::parse(&parameters.to_toml(), Path::new("pulled.toml")).expect("the file is valid")
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 5000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn valid_parameters_are_read_back_from_a_file_bit_for_bit(tissue in tissue()) {
        prop_assert_eq!(tissue.check(), Ok(()));
        // Equal identifiers show that 0 and -0 were not exchanged, because the identifier depends on every bit.
        prop_assert_eq!(through_a_file(&Parameters::from_tissue(&tissue, None)).tissue(), tissue);
    }
}

#[test]
fn typical_parameters_are_read_back_from_a_file_and_from_an_insole() {
    for size in 20..=52 {
        let typical = Parameters::typical(size.to_string().parse::<InsoleSize>().expect("the size is valid"));
        assert_eq!(typical.tissue().check(), Ok(()), "size {size}");
        assert_eq!(through_a_file(&typical).tissue(), typical.tissue(), "size {size}");
        let pulled = Parameters::from_tissue(&typical.tissue(), None);
        assert_eq!(through_a_file(&pulled).tissue(), typical.tissue(), "size {size}");
    }
}

#[test]
fn only_lengths_within_their_limits_are_accepted() {
    let typical = Parameters::typical(InsoleSize::default()).to_toml();
    let c_of_heel = typical.lines().find(|line| line.starts_with("c_mm")).expect("the file contains a radius");
    for (c_mm, is_accepted) in [("0.1", true), ("200", true), ("200.0", true), ("0.0999", false), ("200.1", false)] {
        let text = typical.replacen(c_of_heel, &format!("c_mm = {c_mm}"), 1);
        let read = Parameters::parse(&text, Path::new("params.toml"));
        assert_eq!(read.is_ok(), is_accepted, "{c_mm}: {read:?}");
        if let Err(error) = read {
            let text = error.to_string();
            assert!(text.contains("line 12") && text.contains("from 0.1 to 200 mm"), "{text}");
        }
    }
}

#[test]
fn the_scale_of_a_deformation_is_read_back_from_a_file_and_assumed_otherwise() {
    let mut parameters = Parameters::typical(InsoleSize::default());
    let assumed = parameters.to_toml();
    assert!(!assumed.contains("deformation_scale"));
    assert_eq!(through_a_file(&parameters).deformation, DeformationScale::ALL_ASSUMED);
    let scales = [DeformationScale::Measured, DeformationScale::AssumedThickness, DeformationScale::AssumedCompression];
    parameters.deformation[..3].copy_from_slice(&scales);
    assert_eq!(through_a_file(&parameters).deformation, parameters.deformation);
    assert_eq!(parameters.deformation.map(DeformationScale::assumed_percent), [0, 50, 50, 100, 100, 100, 100, 100]);
    let wrong = parameters.to_toml().replace("\"assumed_thickness\"", "\"guessed\"");
    let error = Parameters::parse(&wrong, Path::new("params.toml")).expect_err("an unknown name").to_string();
    assert!(error.contains("posterior_midfoot") && error.contains("guessed") && error.contains("measured"), "{error}");
}

/// The subject needs escape sequences, and those of TOML differ from those of Rust. Control characters become blanks, because the
/// subject is printed.
#[test]
fn any_subject_is_read_back_from_a_file_with_blanks_for_control_characters() {
    let subject = "\"a\\b\"\u{0}\n\u{85}\u{301}'\u{1f9b6}";
    let named = Parameters { subject: subject.into(), ..Parameters::typical(InsoleSize::default()) };
    assert_eq!(through_a_file(&named).subject, "\"a\\b\"   \u{301}'\u{1f9b6}");
}
