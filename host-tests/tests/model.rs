//! The ellipsoid model, compared with geometry, quadrature and finite differences in f64. In these tests, `g` is the normalised
//! deformation, which is the deformation divided by C, and `q` is a point of the contact ellipse: 0 at the centre, 1 at the rim.

use plantar::Real;
use plantar::pipeline::live::LiveModel;
use plantar::pipeline::model::{AB_M2, COEFFICIENT, Ellipsoid, ForceLaw, LENGTH_M, MAX_EXPONENT};
use plantar::pipeline::step::RegionStep;
use proptest::prelude::*;
use std::f64::consts::PI;
use testkit::area_moments;

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

/// The ellipsoid of a plantar region, with numbers that f32 represents exactly.
fn ellipsoid() -> impl Strategy<Value = Ellipsoid<f64>> {
    let lengths = (5e-3..50e-3f64, 5e-3..80e-3f64, 3e-3..30e-3f64, 5e-3..25e-3f64);
    // ln K and ln G: 1e4..1e7 Pa and 1..1e6 Pa s.
    let laws = (9.2..16.1f64, 0.0..5.0f64, 0.0..13.8f64, 0.0..5.0f64);
    (lengths, laws).prop_map(|((a_m, b_m, c_m, d0_m), (ln_k, n, ln_g, m))| {
        let k = ln_k.exp() * d0_m.powf(n) / c_m.powf(n + 1.0);
        let c = ln_g.exp() * d0_m.powf(m) / c_m.powf(m + 1.0);
        let [a_m, b_m, c_m, d0_m, k, n, c, m] = [a_m, b_m, c_m, d0_m, k, n, c, m].map(|v| f64::from(v as f32));
        Ellipsoid { a_m, b_m, c_m, d0_m, k, n, c, m }
    })
}

/// Checks that `got` differs from `want` by at most `tolerance` times `scale`.
fn close(got: f64, want: f64, scale: f64, tolerance: f64) -> Result<(), TestCaseError> {
    prop_assert!(
        (got - want).abs() <= tolerance * scale.abs(),
        "{got:e} is not {want:e} within {tolerance:e} x {scale:e}"
    );
    Ok(())
}

/// Area of the section of an ellipsoid at its centre, parallel to the ground.
fn section_m2(e: &Ellipsoid<f64>) -> f64 {
    PI * e.a_m * e.b_m
}

/// Contact area at a deformation: the section of the ellipsoid `x^2/A^2 + y^2/B^2 + z^2/C^2 = 1` by the ground plane.
fn contact_area_m2(e: &Ellipsoid<f64>, deformation_m: f64) -> f64 {
    let z = (e.c_m - deformation_m) / e.c_m;
    section_m2(e) * (1.0 - z * z)
}

/// Nodes and weights of the Gauss-Legendre quadrature in the interval from 0 to 1.
fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let legendre = |x: f64| {
        let (mut before, mut here) = (1.0, x);
        for k in 1..count {
            let k = k as f64;
            (before, here) = (here, ((2.0 * k + 1.0) * x * here - k * before) / (k + 1.0));
        }
        (here, count as f64 * (x * here - before) / (x * x - 1.0))
    };
    let node = |i: usize| {
        let mut x = (PI * (i as f64 + 0.75) / (count as f64 + 0.5)).cos();
        for _ in 0..100 {
            let (value, slope) = legendre(x);
            x -= value / slope;
        }
        let (_, slope) = legendre(x);
        ((1.0 + x) / 2.0, 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(node).collect()
}

/// Elastic and viscous force: Eq. 11 and 12 of the paper, integrated over the contact ellipse.
fn quadrature_n(e: &Ellipsoid<f64>, deformation_m: f64, rate_m_s: f64) -> (f64, f64) {
    let z0_m = e.c_m - deformation_m;
    let rim = (1.0 - (z0_m / e.c_m).powi(2)).sqrt();
    let stiffness = e.k * (deformation_m / e.d0_m).powf(e.n);
    let damping = e.c * (deformation_m / e.d0_m).powf(e.m);
    let angles = 24;
    let (mut elastic_n, mut viscous_n) = (0.0, 0.0);
    for (q, weight) in gauss_legendre(100) {
        for i in 0..angles {
            let angle = 2.0 * PI * f64::from(i) / f64::from(angles);
            let (x_m, y_m) = (q * rim * e.a_m * angle.cos(), q * rim * e.b_m * angle.sin());
            let depth_m = e.c_m * (1.0 - (x_m / e.a_m).powi(2) - (y_m / e.b_m).powi(2)).sqrt();
            let element_m2 = weight * q * rim * rim * e.a_m * e.b_m * 2.0 * PI / f64::from(angles);
            elastic_n += stiffness * (depth_m - z0_m) * element_m2;
            viscous_n += damping * rate_m_s * (1.0 - q * q * z0_m / depth_m) * element_m2;
        }
    }
    (elastic_n, viscous_n)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn contact_radii_and_area_belong_to_one_ellipse(e in ellipsoid(), g in 1e-4..0.999f64) {
        let deformation_m = g * e.c_m;
        let (r_a_m, r_b_m) = e.contact_radii_m(deformation_m);
        let area_m2 = contact_area_m2(&e, deformation_m);
        close(PI * r_a_m * r_b_m, area_m2, area_m2, 1e-11)?;
        close(r_a_m / e.a_m, r_b_m / e.b_m, 1.0, 1e-14)?;
        close(e.deformation_m(PI * r_a_m * r_b_m), deformation_m, deformation_m, 1e-10)?;
    }

    #[test]
    fn local_deformation_is_the_surface_below_ground(
        e in ellipsoid(),
        g in 1e-3..0.999f64,
        q in 0.0..1.0f64,
        phi in 0.0..7.0f64,
    ) {
        let deformation_m = g * e.c_m;
        let (r_a_m, r_b_m) = e.contact_radii_m(deformation_m);
        let (x_m, y_m) = (q * r_a_m * phi.cos(), q * r_b_m * phi.sin());
        let depth_m = e.c_m * (1.0 - (x_m / e.a_m).powi(2) - (y_m / e.b_m).powi(2)).max(0.0).sqrt();
        let below_ground_m = depth_m - (e.c_m - deformation_m);
        // Both are square roots of at least (1 - g)^2, which amplifies rounding errors by up to 1 / (2 (1 - g)) = 500.
        close(e.local_deformation_m(deformation_m, q), below_ground_m, e.c_m, 1e-12)?;
        close(e.local_deformation_m(deformation_m, 0.0), deformation_m, e.c_m, 1e-15)?;
        close(e.local_deformation_m(deformation_m, 1.0), 0.0, e.c_m, 1e-12)?;
    }

    #[test]
    fn local_rate_is_the_slope_at_fixed_q(e in ellipsoid(), g in 0.01..0.95f64, q in 0.0..1.0f64, rate_m_s in -1.0..1.0f64) {
        let (deformation_m, h_m) = (g * e.c_m, 1e-5 * e.c_m);
        let rise_m = e.local_deformation_m(deformation_m + h_m, q) - e.local_deformation_m(deformation_m - h_m, q);
        let slope = rise_m / (2.0 * h_m);
        close(e.local_deformation_rate_m_s(deformation_m, rate_m_s, q), slope * rate_m_s, rate_m_s, 1e-6)?;
    }

    #[test]
    fn force_is_the_integral_over_the_contact(e in ellipsoid(), g in 1e-3..0.9f64, rate_m_s in -1.0..1.0f64) {
        let deformation_m = g * e.c_m;
        let (elastic_n, viscous_n) = quadrature_n(&e, deformation_m, rate_m_s);
        let scale_n = elastic_n + viscous_n.abs();
        close(e.force_n(deformation_m, rate_m_s), elastic_n + viscous_n, scale_n, 1e-11)?;
        close(e.force_n(deformation_m, 0.0), elastic_n, elastic_n, 1e-11)?;
    }

    #[test]
    fn the_force_law_gives_the_same_force_without_tension(e in ellipsoid(), g in 1e-3..1.0f64, rate_m_s in -1.0..1.0f64) {
        let (deformation_m, law) = (g * e.c_m, e.force_law());
        let elastic_n = e.force_n(deformation_m, 0.0);
        let full_n = e.force_n(deformation_m, rate_m_s);
        let scale_n = elastic_n + (full_n - elastic_n).abs();
        close(law.force_n(g, rate_m_s / e.c_m), f64::max(full_n, 0.0), scale_n, 1e-12)?;
    }

    #[test]
    fn deformation_rate_is_the_slope_of_deformation(e in ellipsoid(), g in 0.01..0.95f64, area_rate_m2_s in -0.1..0.1f64) {
        let area_m2 = contact_area_m2(&e, g * e.c_m);
        let h_m2 = 1e-5 * (section_m2(&e) - area_m2).min(area_m2);
        let slope_per_m = (e.deformation_m(area_m2 + h_m2) - e.deformation_m(area_m2 - h_m2)) / (2.0 * h_m2);
        let rate_m_s = slope_per_m * area_rate_m2_s;
        close(e.deformation_rate_m_s(area_m2, area_rate_m2_s), rate_m_s, rate_m_s, 1e-7)?;

        let dt_s = h_m2 / area_rate_m2_s.abs();
        let half_m2 = area_rate_m2_s * dt_s / 2.0;
        let between_m_s = e.deformation_rate_between_m_s(area_m2 - half_m2, area_m2 + half_m2, dt_s);
        close(between_m_s, rate_m_s, rate_m_s, 1e-7)?;
    }

    #[test]
    fn the_force_depends_only_on_the_force_law(
        e in ellipsoid(),
        share in 1e-3..0.99f64,
        area_rate_m2_s in -0.1..0.1f64,
        [s_ab, s_c, s_d0] in [0.5..2.0f64, 0.5..2.0f64, 0.5..2.0f64],
    ) {
        // A B, K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m are the same for both ellipsoids.
        let stretched = Ellipsoid {
            a_m: e.a_m * s_ab,
            b_m: e.b_m / s_ab,
            c_m: e.c_m * s_c,
            d0_m: e.d0_m * s_d0,
            k: e.k * s_d0.powf(e.n) / s_c.powf(e.n + 1.0),
            c: e.c * s_d0.powf(e.m) / s_c.powf(e.m + 1.0),
            ..e
        };
        let area_m2 = share * section_m2(&e);
        let force_n = |e: &Ellipsoid<f64>, area_rate_m2_s| {
            e.force_n(e.deformation_m(area_m2), e.deformation_rate_m_s(area_m2, area_rate_m2_s))
        };
        let elastic_n = force_n(&e, 0.0);
        let full_n = force_n(&e, area_rate_m2_s);
        let scale_n = elastic_n + (full_n - elastic_n).abs();
        close(force_n(&stretched, 0.0), elastic_n, elastic_n, 1e-11)?;
        close(force_n(&stretched, area_rate_m2_s), full_n, scale_n, 1e-11)?;
    }

    #[test]
    fn single_precision_agrees_with_double(e in ellipsoid(), share in 1e-3..0.99f64, rate_per_s in -50.0..50.0f64) {
        let law = e.force_law().single();
        let double = ForceLaw::<f64>::of(&law);
        let (area_m2, rate_per_s) = ((share * section_m2(&e)) as f32, rate_per_s as f32);
        let g = law.area_ratio(area_m2).normalised_deformation();
        let double_g = double.area_ratio(f64::from(area_m2)).normalised_deformation();
        close(f64::from(g), double_g, double_g, 1e-5)?;

        // Both force laws are compared at the same g, because the rounding error of g would add to the error of the force.
        let same_g = f64::from(g);
        let elastic_n = double.force_n(same_g, 0.0);
        close(f64::from(law.force_n(g, 0.0)), elastic_n, elastic_n, 1e-5)?;
        let viscous_n = double.force_n(same_g, f64::from(rate_per_s.abs())) - elastic_n;
        let full_n = double.force_n(same_g, f64::from(rate_per_s));
        close(f64::from(law.force_n(g, rate_per_s)), full_n, elastic_n + viscous_n, 1e-5)?;
    }
}

const HEEL: Ellipsoid<f64> =
    Ellipsoid { a_m: 0.026, b_m: 0.033, c_m: 0.012, d0_m: 0.016, k: 2e7, n: 1.2, c: 4e5, m: 0.8 };

#[test]
fn the_deformation_rate_is_half_of_the_printed_equation_15() {
    // In light contact dd/dt = C dAe/dt / (2 pi A B). The printed equation lacks the factor 1/2.
    let rate_m_s = HEEL.deformation_rate_m_s(1e-12, 0.01);
    let expected_m_s = HEEL.c_m * 0.01 / (2.0 * section_m2(&HEEL));
    assert!((rate_m_s / expected_m_s - 1.0).abs() < 1e-8, "{rate_m_s} {expected_m_s}");
}

#[test]
fn full_contact_has_the_radii_of_the_ellipsoid() {
    assert_eq!(HEEL.contact_radii_m(HEEL.c_m), (HEEL.a_m, HEEL.b_m));
    assert_eq!(HEEL.contact_radii_m(0.0), (0.0, 0.0));
}

#[test]
fn the_area_ratio_is_limited_to_0_to_1() {
    let largest_m2 = section_m2(&HEEL);
    // Contact area, expected ratio, and whether the ratio is clamped.
    let cases = [
        (0.0, 0.0, false),
        (-1e-4, 0.0, false),
        (f64::NAN, 0.0, false),
        (largest_m2 * 0.25, 0.25, false),
        (largest_m2 * 1.000_001, 1.0, true),
        (largest_m2 * 3.0, 1.0, true),
        (f64::INFINITY, 1.0, true),
    ];
    for (area_m2, ratio, clamped) in cases {
        let ratios = [HEEL.area_ratio(area_m2), HEEL.force_law().area_ratio(area_m2)];
        for got in ratios {
            assert!((got.ratio - ratio).abs() < 1e-15, "area {area_m2}: {got:?}");
            assert_eq!(got.clamped, clamped, "area {area_m2}");
            assert!(
                (got.normalised_deformation() - (1.0 - (1.0 - ratio).sqrt())).abs() < 1e-15,
                "area {area_m2}: {}",
                got.normalised_deformation()
            );
        }
    }
    assert!(
        (HEEL.deformation_m(largest_m2 * 2.0) - HEEL.c_m).abs() < 1e-17,
        "the deformation of a clamped contact must be C"
    );
}

#[test]
fn without_contact_there_is_no_force() {
    // The ellipsoid takes m and m/s, and the force law takes the normalised deformation and its rate in 1/s.
    for rate in [-10.0, 0.0, 10.0] {
        for deformation in [0.0, -1e-3] {
            assert_eq!(HEEL.force_n(deformation, rate), 0.0);
            assert_eq!(HEEL.force_law().force_n(deformation, rate), 0.0);
        }
    }
}

#[test]
fn only_the_force_law_limits_tension_to_zero() {
    let (g, rate_m_s) = (0.3, -5.0);
    assert!(HEEL.force_n(g * HEEL.c_m, rate_m_s) < 0.0, "the ellipsoid's force must be a tension during this release");
    assert_eq!(HEEL.force_law().force_n(g, rate_m_s / HEEL.c_m), 0.0);
}

#[test]
fn unknown_tissue_gives_no_deformation_and_no_force() {
    for area_m2 in [0.0, 1e-6, 1e-3, 1.0] {
        let ratio = ForceLaw::<f32>::NONE.area_ratio(area_m2);
        assert!(!ratio.clamped);
        assert_eq!(ForceLaw::<f32>::NONE.c_m * ratio.normalised_deformation(), 0.0);
        assert_eq!(ForceLaw::<f32>::NONE.force_n(ratio.normalised_deformation(), 100.0), 0.0);
    }
}

#[test]
fn invalid_parameters_are_refused() {
    assert!(HEEL.is_valid() && HEEL.force_law().is_valid());
    let bad_ellipsoids: [fn(&mut Ellipsoid<f64>); 12] = [
        |e| e.a_m = 0.0,
        |e| e.b_m = -0.01,
        |e| e.c_m = f64::NAN,
        |e| e.d0_m = f64::INFINITY,
        |e| e.k = -1.0,
        |e| e.k = f64::NAN,
        |e| e.c = -1.0,
        |e| e.c = f64::INFINITY,
        |e| e.n = -1.0,
        |e| e.n = f64::INFINITY,
        |e| e.m = -1.5,
        |e| e.m = f64::NAN,
    ];
    for (i, change) in bad_ellipsoids.iter().enumerate() {
        let mut e = HEEL;
        change(&mut e);
        assert!(!e.is_valid(), "ellipsoid {i}: {e:?}");
    }
    let bad_laws: [fn(&mut ForceLaw<f64>); 17] = [
        |law| law.ab_m2 = 0.0,
        |law| law.ab_m2 = f64::NAN,
        |law| law.c_m = -0.01,
        |law| law.c_m = f64::INFINITY,
        |law| law.stiffness_pa = -1.0,
        |law| law.stiffness_pa = f64::INFINITY,
        |law| law.damping_pa_s = -1.0,
        |law| law.damping_pa_s = f64::NAN,
        |law| law.n = -1.0,
        |law| law.m = f64::NEG_INFINITY,
        |law| law.ab_m2 = 0.99e-8,
        |law| law.ab_m2 = 0.0401,
        |law| law.c_m = 0.99e-4,
        |law| law.c_m = 0.201,
        |law| law.stiffness_pa = 1.01e9,
        |law| law.damping_pa_s = 1.01e9,
        |law| law.n = 10.01,
    ];
    for (i, change) in bad_laws.iter().enumerate() {
        let mut law = HEEL.force_law();
        change(&mut law);
        assert!(!law.is_valid(), "law {i}: {law:?}");
    }
    assert!(!ForceLaw::<f32>::NONE.is_valid());
}

/// Force laws in which each number is at its lower or upper limit. The lower limit of an exponent is the smallest f32 above -1.
fn laws_at_their_limits() -> impl Iterator<Item = ForceLaw<f32>> {
    let ends = |limit: &std::ops::RangeInclusive<f64>| [*limit.start() as f32, *limit.end() as f32];
    let exponents = [(-1.0f32).next_up(), MAX_EXPONENT as f32];
    let choices = [ends(&AB_M2), ends(&LENGTH_M), ends(&COEFFICIENT), ends(&COEFFICIENT), exponents, exponents];
    (0..1 << 6).map(move |bits: usize| {
        let [ab_m2, c_m, stiffness_pa, damping_pa_s, n, m] = core::array::from_fn(|i| choices[i][bits >> i & 1]);
        ForceLaw { ab_m2, c_m, stiffness_pa, damping_pa_s, n, m }
    })
}

#[test]
fn the_limits_are_valid_and_the_next_numbers_beyond_them_are_not() {
    for law in laws_at_their_limits() {
        assert!(law.is_valid(), "{law:?}");
        let mut beyond = [law; 6];
        let outwards = |value: f32, limit: f64| if value == limit as f32 { value.next_up() } else { value.next_down() };
        beyond[0].ab_m2 = outwards(law.ab_m2, *AB_M2.end());
        beyond[1].c_m = outwards(law.c_m, *LENGTH_M.end());
        beyond[2].stiffness_pa = outwards(law.stiffness_pa, *COEFFICIENT.end());
        beyond[3].damping_pa_s = outwards(law.damping_pa_s, *COEFFICIENT.end());
        beyond[4].n = outwards(law.n, MAX_EXPONENT);
        beyond[5].m = outwards(law.m, MAX_EXPONENT);
        for beyond in beyond {
            assert!(!beyond.is_valid(), "{beyond:?}");
        }
    }
}

/// The contact area changes abruptly from frame to frame, between 0 and 0.1 m2.
#[test]
fn forces_at_the_limits_of_the_parameters_are_finite_in_single_precision() {
    let areas_mm2: Vec<f32> = (0..256).map(|i| [0.0, 1e5, 1e-3, 600.0, 0.01][i % 5]).collect();
    for law in laws_at_their_limits() {
        for per_s in [20.0f32, 500.0] {
            let mut live = LiveModel::NEW;
            for &area_mm2 in &areas_mm2 {
                let tissue = live.update(&law, area_mm2, per_s);
                assert!((0.0..1e11).contains(&tissue.model_n), "{} N of {law:?}", tissue.model_n);
                assert!((0.0..=0.2).contains(&tissue.deformation_m), "{} m of {law:?}", tissue.deformation_m);
            }
            let forces_n = vec![100.0; areas_mm2.len()];
            let step = RegionStep::new(&law, &areas_mm2, &forces_n, 1.0 / per_s, &area_moments(600.0));
            let numbers = [
                step.model_peak_n,
                step.model_integral_n_s,
                step.model_error,
                step.deformation_peak_m,
                step.deformation_rate_peak_m_s,
            ];
            assert!(numbers.iter().all(|v| v.is_finite() && *v >= 0.0), "{numbers:?} of {law:?}");
        }
    }
}

#[test]
fn square_root_logarithm_and_exponential_are_accurate() {
    for i in 1..2000 {
        let x = f64::from(i) * 0.05;
        let single = x as f32;
        let exact = f64::from(single);
        assert_eq!(Real::sqrt(single), exact.sqrt() as f32, "square root of {single}");
        assert!(
            (f64::from(Real::log2(single)) - exact.log2()).abs() <= 1.2e-7 * exact.log2().abs().max(1.0),
            "base-2 logarithm of {single}"
        );
        let exponent = 2.5 * (single - 50.0);
        let power = f64::from(exponent).exp2();
        assert!((f64::from(Real::exp2(exponent)) - power).abs() <= 2.5e-7 * power, "2 to the power of {exponent}");
    }
}
