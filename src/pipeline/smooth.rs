//! The paper's smoothing of a stance (its section 2.3): a three-point moving average, then a polynomial of 5th order over
//! the contact phase, fitted by least squares in the orthogonal (Gram) basis so that single precision is enough.

use crate::num::Real;

/// Degree of the paper's polynomial.
pub const DEGREE: usize = 5;

/// Replaces every sample by the mean of itself and its neighbours; the two ends have one neighbour.
pub fn moving_average<R: Real>(samples: &mut [R]) {
    let Some(&first) = samples.first() else { return };
    let mut before = first;
    let mut have_before = false;
    for i in 0..samples.len() {
        let here = samples[i];
        let (mut sum, mut count) = (here, 1);
        if have_before {
            sum += before;
            count += 1;
        }
        if let Some(&after) = samples.get(i + 1) {
            sum += after;
            count += 1;
        }
        samples[i] = sum / R::of_u32(count);
        (before, have_before) = (here, true);
    }
}

/// Replaces samples on a uniform clock by their least-squares polynomial of 5th order. Short curves get a lower order, at
/// most half as many coefficients as samples: through fewer the polynomial would swing instead of smooth.
pub fn polynomial<R: Real>(samples: &mut [R]) {
    let count = samples.len();
    if count < 4 {
        return;
    }
    let terms = (count / 2).min(DEGREE + 1);
    let basis = Gram::new(count);
    let mut coefficients = [R::ZERO; DEGREE + 1];
    for (i, &sample) in samples.iter().enumerate() {
        for (coefficient, value) in coefficients.iter_mut().zip(basis.at(i)) {
            *coefficient += sample * value;
        }
    }
    for (coefficient, per_norm) in coefficients.iter_mut().zip(basis.per_norm) {
        *coefficient = *coefficient * per_norm;
    }
    for (i, sample) in samples.iter_mut().enumerate() {
        *sample = coefficients.iter().take(terms).zip(basis.at(i)).map(|(&c, v)| c * v).sum();
    }
}

/// Monic polynomials orthogonal on `count` evenly spaced points of -1..=1 (discrete Chebyshev polynomials):
/// P(k+1) = x P(k) - b(k) P(k-1), b(k) = k^2 (N^2 - k^2) / (4 (4 k^2 - 1)) in units of the spacing squared.
struct Gram<R> {
    spacing: R,
    b: [R; DEGREE + 1],
    per_norm: [R; DEGREE + 1],
}

impl<R: Real> Gram<R> {
    fn new(count: usize) -> Self {
        let n = count as f64;
        let spacing = 2.0 / (n - 1.0);
        let mut b = [R::ZERO; DEGREE + 1];
        let mut per_norm = [R::ZERO; DEGREE + 1];
        let mut norm = n;
        per_norm[0] = R::of(1.0 / norm);
        for k in 1..=DEGREE.min(count - 1) {
            let kk = (k * k) as f64;
            let b_k = kk * (n * n - kk) / (4.0 * (4.0 * kk - 1.0)) * spacing * spacing;
            norm *= b_k;
            b[k] = R::of(b_k);
            per_norm[k] = R::of(1.0 / norm);
        }
        Self { spacing: R::of(spacing), b, per_norm }
    }

    /// All polynomials at point `i`.
    fn at(&self, i: usize) -> [R; DEGREE + 1] {
        let x = self.spacing * R::of_u32(i as u32) - R::ONE;
        let mut values = [R::ONE; DEGREE + 1];
        values[1] = x;
        for k in 1..DEGREE {
            values[k + 1] = x * values[k] - self.b[k] * values[k - 1];
        }
        values
    }
}
