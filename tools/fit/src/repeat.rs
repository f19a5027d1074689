//! Repeatability of a quantity between recordings of the same people.
//!
//! "Shrout and Fleiss" is Psychol. Bull. 86 (1979) 420-428; "McGraw and Wong" is Psychol. Methods 1 (1996) 30-46; "Weir" is J.
//! Strength Cond. Res. 19 (2005) 231-240.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Repeatability of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeatability {
    /// Intraclass correlation coefficient ICC(2,1): two-way random effects, absolute agreement, single recording (Shrout and
    /// Fleiss). 1 if the recordings of each person agree; 0, or below, if they differ as much as people do.
    pub icc: f64,
    /// Standard error of measurement, in the unit of the quantity: the standard deviation of a recording about the mean of the
    /// person (Weir). Its square is the variance of the recordings plus that of the error, the same estimates as in the
    /// denominator of the ICC (McGraw and Wong), so that ICC = P / (P + SEM^2), where P is the variance between people. The
    /// estimate of the variance of the recordings may be negative; the sum is not.
    pub sem: f64,
    /// Minimal detectable change, 1.96 sqrt(2) SEM, in the unit of the quantity: two recordings that differ by less may be of an
    /// unchanged person (Weir). The confidence is 95 % for many people, and [`mdc_confidence`] for few.
    pub mdc: f64,
}

impl Repeatability {
    /// The repeatability of the values of people, in rows with one value for each recording. `None` for fewer than two people or
    /// recordings, for rows of different lengths, and if the sum of squares or the denominator of the ICC is not positive. For
    /// equal values, rounding can leave a small sum, and the ICC then has no meaning: the caller must detect equal values.
    pub fn of(people: &[Vec<f64>]) -> Option<Self> {
        let (n, k) = (people.len(), people.first()?.len());
        if n < 2 || k < 2 || people.iter().any(|row| row.len() != k) {
            return None;
        }
        let (rows, columns) = (n as f64, k as f64);
        let mean = people.iter().flatten().sum::<f64>() / (rows * columns);
        let row_mean = |row: &[f64]| row.iter().sum::<f64>() / columns;
        let column_mean = |j: usize| people.iter().map(|row| row[j]).sum::<f64>() / rows;
        let all: f64 = people.iter().flatten().map(|value| (value - mean).powi(2)).sum();
        let between_people: f64 = people.iter().map(|row| columns * (row_mean(row) - mean).powi(2)).sum();
        let between_recordings: f64 = (0..k).map(|j| rows * (column_mean(j) - mean).powi(2)).sum();
        let residual = (all - between_people - between_recordings).max(0.0) / ((rows - 1.0) * (columns - 1.0));
        let (people_square, recordings_square) = (between_people / (rows - 1.0), between_recordings / (columns - 1.0));
        let denominator = people_square + (columns - 1.0) * residual + columns * (recordings_square - residual) / rows;
        if all <= 0.0 || denominator <= 0.0 {
            return None;
        }
        // The error of absolute agreement includes the differences between recordings that all people share. This is the mean
        // square within people.
        let sem = (((rows - 1.0) * residual + recordings_square) / rows).sqrt();
        Some(Self { icc: (people_square - residual) / denominator, sem, mdc: mdc(sem) })
    }
}

/// The factor of [`mdc`]: the quantile of the normal distribution.
const MDC_FACTOR: f64 = 1.96;

/// The minimal detectable change that follows from a standard error of measurement.
fn mdc(sem: f64) -> f64 {
    MDC_FACTOR * 2f64.sqrt() * sem
}

/// The share of the differences between two recordings of an unchanged person that are within the minimal detectable change,
/// which was computed from `people` people with `recordings` recordings each. It follows from the t distribution, because the
/// standard error of measurement has `people` times (`recordings` - 1) degrees of freedom. `None` for less than one degree.
pub fn mdc_confidence(people: usize, recordings: usize) -> Option<f64> {
    let freedom = people * recordings.saturating_sub(1);
    let t = StudentsT::new(0.0, 1.0, freedom as f64).ok()?;
    Some(2.0 * t.cdf(MDC_FACTOR) - 1.0)
}

/// Standard error of measurement and minimal detectable change from the variation within people alone, for which one person
/// suffices. `people` is as in [`Repeatability::of`]. `None` without people, and if each person has a single recording.
pub fn within_person(people: &[Vec<f64>]) -> Option<(f64, f64)> {
    let mut squares = 0.0;
    let mut freedom = 0;
    for row in people {
        let mean = row.iter().sum::<f64>() / row.len() as f64;
        squares += row.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        freedom += row.len().saturating_sub(1);
    }
    let sem = (squares / freedom as f64).sqrt();
    (freedom > 0).then(|| (sem, mdc(sem)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of Shrout and Fleiss, table 2: six targets, four judges, ICC(2,1) = 0.29.
    #[test]
    fn the_published_example_is_reproduced() {
        let targets = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]];
        let rows = targets.map(|row| row.map(f64::from).to_vec());
        let repeatability = Repeatability::of(&rows).expect("a table");
        assert!((repeatability.icc - 0.2898).abs() < 1e-4, "{repeatability:?}");
        // Their table 3: the mean square of judges is 32.49 and the residual one is 1.02, so SEM^2 = 1.02 + (32.49 - 1.02) / 6.
        assert!((repeatability.sem.powi(2) - (1.0194 + (32.4861 - 1.0194) / 6.0)).abs() < 1e-3, "{repeatability:?}");
        assert!((repeatability.mdc / repeatability.sem - 2.772).abs() < 1e-3);
    }

    /// The mean square of recordings is 0, which is less than that of the residuals, so that the estimated variance of the
    /// recordings is negative. The expected values were computed by hand.
    #[test]
    fn a_negative_variance_of_the_recordings_counts_in_icc_and_sem_alike() {
        // Mean squares: people 8 (means 2, 4 and 6, two recordings), recordings 0 (both means are 4), residuals 1.5. The
        // variances are those of McGraw and Wong: people (8 - 1.5) / 2 = 3.25, recordings (0 - 1.5) / 3 = -0.5, error 1.5.
        let rows = [vec![1.5, 2.5], vec![3.5, 4.5], vec![7.0, 5.0]];
        let found = Repeatability::of(&rows).expect("a table");
        assert!((found.sem.powi(2) - (1.5 - 0.5)).abs() < 1e-12, "{found:?}");
        assert!((found.icc - 3.25 / (3.25 - 0.5 + 1.5)).abs() < 1e-12, "{found:?}");
        assert!((found.mdc - 1.96 * 2f64.sqrt()).abs() < 1e-12, "{found:?}");
        // The standard deviations of the three people about their means have the squares 0.5, 0.5 and 2, with the mean 1.
        let (sem, _) = within_person(&rows).expect("people");
        assert!((found.sem - sem).abs() < 1e-12, "{sem}");
    }

    /// With one degree of freedom, the t distribution is that of Cauchy, of which the distribution function is known; with very
    /// many, it is the normal distribution.
    #[test]
    fn the_confidence_of_the_mdc_is_95_percent_only_for_many_people() {
        let cauchy = 2.0 / std::f64::consts::PI * 1.96_f64.atan();
        assert!((mdc_confidence(1, 2).expect("one degree of freedom") - cauchy).abs() < 1e-9);
        assert!((mdc_confidence(50_000, 3).expect("many degrees") - 0.95).abs() < 1e-4);
        // Tables of the t distribution: with 10 degrees of freedom, 90 % are within 1.812, and 95 % within 2.228.
        assert!((0.90..0.95).contains(&mdc_confidence(5, 3).expect("ten degrees")));
        assert_eq!([mdc_confidence(0, 3), mdc_confidence(3, 1)], [None; 2]);
    }

    #[test]
    fn recordings_that_agree_have_an_icc_of_one_and_incomplete_or_constant_tables_have_none() {
        let same = Repeatability::of(&[vec![1.0, 1.0], vec![2.0, 2.0], vec![5.0, 5.0]]).expect("a table");
        assert_eq!((same.icc, same.sem, same.mdc), (1.0, 0.0, 0.0));
        assert_eq!(Repeatability::of(&[vec![1.0], vec![2.0]]), None);
        assert_eq!(Repeatability::of(&[vec![1.0, 2.0]]), None);
        assert_eq!(Repeatability::of(&[vec![3.0, 3.0], vec![3.0, 3.0]]), None);
        assert_eq!(Repeatability::of(&[vec![3.0, 3.0], vec![3.0]]), None);
    }
}
