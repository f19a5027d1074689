//! The smoothing of the paper, compared with straightforward implementations.

use fit::smooth;
use proptest::prelude::*;

/// Largest number of samples of a tested curve.
const SAMPLES: usize = 256;

/// The least-squares fit of a polynomial with `terms` coefficients: the projection of the samples onto these polynomials. The
/// Gram-Schmidt orthogonalisation is repeated once for accuracy.
fn projection(samples: &[f64], terms: usize) -> Vec<f64> {
    let count = samples.len();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for power in 0..terms {
        let at = |i: usize| 2.0 * i as f64 / (count - 1) as f64 - 1.0;
        let mut column: Vec<f64> = (0..count).map(|i| at(i).powi(power as i32)).collect();
        for _ in 0..2 {
            for other in &basis {
                let part = dot(&column, other);
                column.iter_mut().zip(other).for_each(|(c, o)| *c -= part * o);
            }
        }
        let norm = dot(&column, &column).sqrt();
        column.iter_mut().for_each(|c| *c /= norm);
        basis.push(column);
    }
    let mut smooth = vec![0.0; count];
    for column in &basis {
        let part = dot(samples, column);
        smooth.iter_mut().zip(column).for_each(|(s, c)| *s += part * c);
    }
    smooth
}

fn naive_moving_average(samples: &[f64]) -> Vec<f64> {
    let mean = |window: &[f64]| window.iter().sum::<f64>() / window.len() as f64;
    (0..samples.len()).map(|i| mean(&samples[i.saturating_sub(1)..(i + 2).min(samples.len())])).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn moving_average_is_the_mean_of_neighbours(samples in prop::collection::vec(-1e3..1e3f64, 0..64)) {
        let mut smoothed = samples.clone();
        smooth::moving_average(&mut smoothed);
        for (smoothed, expected) in smoothed.into_iter().zip(naive_moving_average(&samples)) {
            prop_assert!((smoothed - expected).abs() <= 1e-10);
        }
    }

    #[test]
    fn the_polynomial_is_the_least_squares_fit(samples in prop::collection::vec(0.0..1e3f64, 1..=SAMPLES)) {
        // The polynomial of a short curve has half as many coefficients as the curve has samples. A curve of fewer than four
        // samples is not changed.
        let count = samples.len();
        let expected = if count < 4 { samples.clone() } else { projection(&samples, (count / 2).min(6)) };
        let mut smoothed = samples;
        smooth::polynomial(&mut smoothed);
        for (smoothed, expected) in smoothed.into_iter().zip(expected) {
            prop_assert!((smoothed - expected).abs() <= 1e-9);
        }
    }

    #[test]
    fn a_quintic_is_not_changed(coefficients in prop::array::uniform6(-1.0..1.0f64), count in 12usize..=SAMPLES) {
        let quintic = |i: usize| {
            let x = 2.0 * i as f64 / (count - 1) as f64 - 1.0;
            coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
        };
        let exact: Vec<_> = (0..count).map(quintic).collect();
        let mut smoothed = exact.clone();
        smooth::polynomial(&mut smoothed);
        for (smoothed, exact) in smoothed.into_iter().zip(exact) {
            prop_assert!((smoothed - exact).abs() <= 1e-12);
        }
    }
}
