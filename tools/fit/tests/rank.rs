//! The identifiability of the paper's eight parameters from a force trace. Five combinations of them are identifiable. In three
//! directions of the parameter space, the force does not change.

use fit::fixed::{FixedParameters, Scale};
use fit::synthetic::law;
use nalgebra::DMatrix;
use plantar::Region;
use plantar::pipeline::model::Ellipsoid;

const FIXED: FixedParameters =
    FixedParameters { aspect: 0.8, thickness_m: 0.012, is_thickness_measured: false, scale: Scale::Assumed(0.457) };
const SAMPLES: usize = 60;
const SAMPLE_S: f64 = 0.01;

/// The force during a stance by Eq. 13, 14 and 16 of the paper, N. `largest_m2` is the largest contact area.
fn force_n(e: &Ellipsoid<f64>, largest_m2: f64) -> Vec<f64> {
    let area_m2 = |i: usize| largest_m2 * (std::f64::consts::PI * (i as f64 + 0.5) / SAMPLES as f64).sin().powf(0.8);
    (0..SAMPLES - 1)
        .map(|i| {
            let rate = e.deformation_rate_between_m_s(area_m2(i), area_m2(i + 1), SAMPLE_S);
            e.force_n(e.deformation_m(area_m2(i)), rate)
        })
        .collect()
}

/// A plausible ellipsoid for a region, and the largest contact area, m2.
fn ellipsoid(region: usize) -> (Ellipsoid<f64>, f64) {
    let law = law(region);
    (FIXED.ellipsoid(&law), 0.75 * std::f64::consts::PI * law.ab_m2)
}

/// An ellipsoid with one of the parameters, in the order of Eq. 17, multiplied by `factor`.
fn with(e: &Ellipsoid<f64>, parameter: usize, factor: f64) -> Ellipsoid<f64> {
    let mut scaled = *e;
    let values = [
        &mut scaled.a_m,
        &mut scaled.b_m,
        &mut scaled.c_m,
        &mut scaled.d0_m,
        &mut scaled.k,
        &mut scaled.n,
        &mut scaled.c,
        &mut scaled.m,
    ];
    *values.into_iter().nth(parameter).expect("eight parameters") *= factor;
    scaled
}

#[test]
fn the_jacobian_of_the_force_has_rank_five_in_every_region() {
    for (region, name) in Region::ALL.iter().enumerate() {
        let (e, largest_m2) = ellipsoid(region);
        let step = 1e-5;
        let columns: Vec<_> = (0..8)
            .map(|p| {
                let (above, below) = (with(&e, p, 1.0 + step), with(&e, p, 1.0 - step));
                let difference = force_n(&above, largest_m2).into_iter().zip(force_n(&below, largest_m2));
                nalgebra::DVector::from_iterator(SAMPLES - 1, difference.map(|(a, b)| (a - b) / (2.0 * step)))
            })
            .collect();
        let mut values: Vec<f64> = DMatrix::from_columns(&columns).singular_values().iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        // The fifth singular value is far above the error of the finite differences, and the sixth is of the size of that error.
        assert!(values[4] > 1e-6 * values[0], "{}: {values:?}", name.name());
        assert!(values[5] < 1e-8 * values[0], "{}: {values:?}", name.name());
    }
}

/// These are the three directions: a change of A/B; a change of C with matching changes of k and c; a change of d0 with matching
/// changes of k and c.
#[test]
fn aspect_c_and_d0_leave_the_force_unchanged() {
    for region in 0..8 {
        let (e, largest_m2) = ellipsoid(region);
        let expected = force_n(&e, largest_m2);
        let peak = expected.iter().copied().fold(0.0, f64::max);
        for other in [
            FixedParameters { aspect: 1.7, ..FIXED },
            FixedParameters { thickness_m: 0.02, ..FIXED },
            FixedParameters { scale: Scale::PeakStrain(0.2), ..FIXED },
            FixedParameters { scale: Scale::Curvature(0.05), ..FIXED },
            FixedParameters { aspect: 0.5, thickness_m: 0.006, scale: Scale::Assumed(0.6), ..FIXED },
        ] {
            let mut law = e.force_law();
            law.c_m = other.c_m(&law, largest_m2);
            let same = other.ellipsoid(&law);
            assert!(same.force_law().c_m != e.c_m || other.aspect != FIXED.aspect);
            for (got, expected) in force_n(&same, largest_m2).iter().zip(&expected) {
                assert!((got - expected).abs() < 1e-10 * peak, "region {region}, {other:?}: {got} for {expected}");
            }
        }
    }
}

#[test]
fn an_ellipsoid_has_the_given_fixed_parameters_and_force_law() {
    for region in 0..8 {
        let truth = law(region);
        // The contact area at which the normalised deformation is 0.6, by Eq. 14.
        let g_max = 0.6;
        let largest_m2 = std::f64::consts::PI * truth.ab_m2 * g_max * (2.0 - g_max);
        let law = plantar::pipeline::model::ForceLaw { c_m: FIXED.c_m(&truth, largest_m2), ..truth };
        let e = FIXED.ellipsoid(&law);
        assert!((e.a_m / e.b_m / FIXED.aspect - 1.0).abs() < 1e-12);
        assert!((e.c_m * g_max / e.d0_m / 0.457 - 1.0).abs() < 1e-12);
        assert_eq!(e.d0_m, FIXED.thickness_m);
        let back = e.force_law();
        for (got, expected) in [
            (back.ab_m2, truth.ab_m2),
            (back.stiffness_pa, truth.stiffness_pa),
            (back.damping_pa_s, truth.damping_pa_s),
            (back.n, truth.n),
            (back.m, truth.m),
        ] {
            assert!((got / expected - 1.0).abs() < 1e-12, "{got} for {expected}");
        }
    }
}
