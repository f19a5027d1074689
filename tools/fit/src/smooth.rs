//! The smoothing of a stance as in section 2.3 of the paper, for comparison: a three-point moving average, then a polynomial of
//! 5th order over the contact phase, fitted by least squares in the orthogonal (Gram) basis. No insole uses this smoothing.

/// Degree of the polynomial.
pub const DEGREE: usize = 5;

/// Replaces each sample by the mean of itself and its neighbours. The first and the last sample have one neighbour.
pub fn moving_average(samples: &mut [f64]) {
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
        samples[i] = sum / f64::from(count);
        (before, have_before) = (here, true);
    }
}

/// Replaces uniformly sampled values by their least-squares polynomial of 5th order. With fewer than 12 samples the order is
/// lower, so that there are at least two samples for each coefficient; otherwise the polynomial would oscillate. Fewer than 4
/// samples are not changed.
///
/// ```
/// use fit::smooth::polynomial;
///
/// // A polynomial of 5th order is reproduced.
/// let exact: [f64; 20] = std::array::from_fn(|i| (i as f64 - 7.0).powi(5));
/// let mut smoothed = exact;
/// polynomial(&mut smoothed);
/// assert!(exact.iter().zip(smoothed).all(|(exact, smoothed)| (exact - smoothed).abs() < 1e-6));
/// ```
pub fn polynomial(samples: &mut [f64]) {
    let count = samples.len();
    if count < 4 {
        return;
    }
    let terms = (count / 2).min(DEGREE + 1);
    let basis = Gram::new(count);
    let mut coefficients = [0.0; DEGREE + 1];
    for (i, &sample) in samples.iter().enumerate() {
        for (coefficient, value) in coefficients.iter_mut().zip(basis.at(i)) {
            *coefficient += sample * value;
        }
    }
    for (coefficient, per_norm) in coefficients.iter_mut().zip(basis.per_norm) {
        *coefficient *= per_norm;
    }
    for (i, sample) in samples.iter_mut().enumerate() {
        *sample = coefficients.iter().take(terms).zip(basis.at(i)).map(|(&c, v)| c * v).sum();
    }
}

/// Monic polynomials that are orthogonal on N evenly spaced points of -1..=1 (discrete Chebyshev polynomials):
/// P(k+1) = x P(k) - b(k) P(k-1), with b(k) = k^2 (N^2 - k^2) / (4 (4 k^2 - 1)) in units of the squared spacing.
struct Gram {
    /// Distance between two points.
    spacing: f64,
    /// The coefficients b(k) of the recurrence.
    b: [f64; DEGREE + 1],
    /// One over the squared norm of each polynomial.
    per_norm: [f64; DEGREE + 1],
}

impl Gram {
    /// The basis on `count` points, at least 2.
    fn new(count: usize) -> Self {
        let n = count as f64;
        let spacing = 2.0 / (n - 1.0);
        let mut b = [0.0; DEGREE + 1];
        let mut per_norm = [0.0; DEGREE + 1];
        let mut norm = n;
        per_norm[0] = 1.0 / norm;
        for k in 1..=DEGREE.min(count - 1) {
            let kk = (k * k) as f64;
            let b_k = kk * (n * n - kk) / (4.0 * (4.0 * kk - 1.0)) * spacing * spacing;
            norm *= b_k;
            b[k] = b_k;
            per_norm[k] = 1.0 / norm;
        }
        Self { spacing, b, per_norm }
    }

    /// The values of all polynomials at point `i`.
    fn at(&self, i: usize) -> [f64; DEGREE + 1] {
        let x = self.spacing * i as f64 - 1.0;
        let mut values = [1.0; DEGREE + 1];
        values[1] = x;
        for k in 1..DEGREE {
            values[k + 1] = x * values[k] - self.b[k] * values[k - 1];
        }
        values
    }
}
