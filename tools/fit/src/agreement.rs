//! Repeatability of the variables of people between trials of the same foot.
//!
//! The two feet are evaluated separately: the feet of a person are not independent, and their difference is not a measurement
//! error.

use crate::repeat::{Repeatability, mdc_confidence, within_person};
use crate::trials::{Moments, Trial};
use crate::variable::Variable;
use plantar::Side;

/// The repeatability of all variables for one foot.
#[derive(Clone, Debug, PartialEq)]
pub struct FootRepeatability {
    /// The foot.
    pub side: Side,
    /// Names of the people with two or more trials.
    pub people: Vec<String>,
    /// Number of trials of each person that are compared: the smallest number of trials of these people.
    pub trials: usize,
    /// The largest number of trials of a person.
    pub most_trials: usize,
    /// The variables, in the order of [`Variable::repeated`].
    pub rows: Vec<VariableRow>,
}

/// A standard error or detectable change below this fraction of the mean is due to rounding, and is reported as 0.
const ROUNDING: f64 = 1e-7;

/// The repeatability of a variable.
#[derive(Clone, Debug, PartialEq)]
pub struct VariableRow {
    /// The variable.
    pub variable: Variable,
    /// The regions, in the order of [`plantar::Region::ALL`]; `None` if there are too few values.
    pub regions: [Option<Agreement>; 8],
}

/// The repeatability of a variable in a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Number of people who have a value in each of the compared trials.
    pub people: usize,
    /// Mean of all values.
    pub mean: f64,
    /// ICC(2,1); `None` for one person, if all values are equal, and if its denominator is not positive.
    pub icc: Option<f64>,
    /// Standard error of measurement, in the unit of the variable.
    pub sem: f64,
    /// Minimal detectable change, 1.96 sqrt(2) SEM, in the unit of the variable; see [`FootRepeatability::mdc_note`].
    pub mdc: f64,
}

impl Agreement {
    /// The agreement of the values of people, in rows with one value for each trial. A single row has a result only if
    /// `is_alone` states that no other person has repeated trials.
    fn of(rows: &[Vec<f64>], is_alone: bool) -> Option<Self> {
        let mean = Moments::of(rows.iter().flatten().copied())?.mean;
        let people = rows.len();
        // The sums of squares of equal values are not exactly 0.
        let rounded = |error: f64| if error > ROUNDING * mean.abs() { error } else { 0.0 };
        let values = rows.iter().flatten();
        let are_equal = values.clone().all(|value| (value - mean).abs() <= ROUNDING * mean.abs());
        if let Some(Repeatability { icc, sem, mdc }) = Repeatability::of(rows) {
            let icc = Some(icc).filter(|_| !are_equal);
            return Some(Self { people, mean, icc, sem: rounded(sem), mdc: rounded(mdc) });
        }
        let (sem, mdc) = within_person(rows).filter(|_| people > 1 || is_alone)?;
        Some(Self { people, mean, icc: None, sem: rounded(sem), mdc: rounded(mdc) })
    }

    /// The minimal detectable change in percent of the mean; `None` for a mean of 0, which has no percentage.
    pub fn mdc_percent(&self) -> Option<f64> {
        (self.mean != 0.0).then(|| self.mdc / self.mean.abs() * 100.0)
    }
}

impl VariableRow {
    /// The median of a number over the regions that have it; `None` if no region has it.
    pub fn median(&self, number: impl Fn(&Agreement) -> Option<f64>) -> Option<f64> {
        let values: Vec<f64> = self.regions.iter().flatten().filter_map(number).collect();
        (!values.is_empty()).then(|| crate::steps::median(values))
    }
}

/// A foot of a person with a single trial, which cannot be compared with another one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SingleTrial {
    /// Name of the person.
    pub person: String,
    /// The foot.
    pub side: Side,
}

/// Computes the repeatability for each foot of which at least `least_people` people have two or more trials. `people` contains
/// the name and the trials of each person. Also returns the feet of people with a single trial.
pub fn repeatability(people: &[(&str, &[Trial])], least_people: usize) -> (Vec<FootRepeatability>, Vec<SingleTrial>) {
    let mut single = Vec::new();
    let mut feet = Vec::new();
    for side in [Side::Left, Side::Right] {
        let mut repeated: Vec<(&str, Vec<&Trial>)> = Vec::new();
        for (name, trials) in people {
            // A trial in which no region could be fitted would exclude the person from the comparison of all fitted variables, so
            // it is not used for the measured loads, either.
            let is_usable = |trial: &&Trial| trial.side == side && trial.is_fitted();
            let of_foot: Vec<&Trial> = trials.iter().filter(is_usable).collect();
            match of_foot.len() {
                0 => (),
                1 => single.push(SingleTrial { person: (*name).into(), side }),
                _ => repeated.push((*name, of_foot)),
            }
        }
        if repeated.len() >= least_people.max(1) {
            feet.push(FootRepeatability::of(side, &repeated));
        }
    }
    (feet, single)
}

/// The reasons why people are left out of the comparison of a foot by [`repeatability`] with the same arguments, with the
/// remedies.
pub fn left_out(people: &[(&str, &[Trial])], least_people: usize) -> Vec<String> {
    let (feet, single) = repeatability(people, 1);
    let single = single.into_iter().map(|SingleTrial { person, side }| {
        let side = side.name();
        format!(
            "{person}, {side} foot: only one usable recording, and repeatability needs two or more: record another trial of the \
             {side} foot"
        )
    });
    // People with repeated trials of a foot of which fewer than `least_people` people have repeated trials.
    let lone = feet.into_iter().filter(|foot| foot.people.len() < least_people);
    let lone = lone.map(|foot| {
        let side = foot.side.name();
        format!(
            "{}, {side} foot: nobody else has two or more usable recordings of the {side} foot: record other people, too, or \
             compare the recordings of this person alone, without other people",
            foot.people.join(", ")
        )
    });
    single.chain(lone).collect()
}

impl FootRepeatability {
    fn of(side: Side, people: &[(&str, Vec<&Trial>)]) -> Self {
        let counts = || people.iter().map(|(_, trials)| trials.len());
        let trials = counts().min().unwrap_or(0);
        let row = |variable: Variable| {
            let index = variable.index();
            let of_region = |region: usize| {
                let person = |(_, all): &(&str, Vec<&Trial>)| -> Option<Vec<f64>> {
                    all.iter().take(trials).map(|trial| trial.regions[region][index]).collect()
                };
                Agreement::of(&people.iter().filter_map(person).collect::<Vec<_>>(), people.len() == 1)
            };
            VariableRow { variable, regions: std::array::from_fn(of_region) }
        };
        Self {
            side,
            people: people.iter().map(|(name, _)| (*name).to_string()).collect(),
            trials,
            most_trials: counts().max().unwrap_or(0),
            rows: Variable::repeated().map(row).collect(),
        }
    }

    fn people_in_words(&self) -> String {
        match self.people.len() {
            1 => "one person".into(),
            people => format!("{people} people"),
        }
    }

    /// A sentence on the confidence of the minimal detectable change, which is less than 95 % for few people and trials.
    pub fn mdc_note(&self) -> String {
        let (people, trials) = (self.people_in_words(), self.trials);
        let percent = mdc_confidence(self.people.len(), trials).map_or(f64::NAN, |confidence| confidence * 100.0);
        format!(
            "With {trials} trials of {people}, {percent:.0} % of the differences between trials of an unchanged person are within \
             the MDC."
        )
    }

    /// A sentence on the number of trials that are compared.
    pub fn comparison(&self) -> String {
        let (side, people, trials) = (self.side.name(), self.people_in_words(), self.trials);
        match self.most_trials == trials {
            true => format!("{side} foot: {trials} trials of {people}"),
            false => {
                format!("{side} foot: the first {trials} trials of {people}, who have {trials} to {}", self.most_trials)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plantar::Region;
    use std::io::Write;
    use std::process::{Command, Stdio};

    /// Normally distributed numbers, by the method of Box and Muller.
    fn normal(random: &mut fastrand::Rng) -> f64 {
        (-2.0 * (1.0 - random.f64()).ln()).sqrt() * (std::f64::consts::TAU * random.f64()).cos()
    }

    /// A trial in which only the heel was fitted, and each of its variables has `value`.
    fn trial(side: Side, value: f64) -> Trial {
        let of_region = |region| Variable::all().map(|_| (region == Region::Heel as usize).then_some(value)).collect();
        let regions = std::array::from_fn(of_region);
        Trial { name: String::new(), side, regions }
    }

    /// Trials of the left foot. The means of the people have the standard deviation `between`, and the trials of a person have
    /// the standard deviation `within`.
    fn cohort(people: usize, trials: usize, between: f64, within: f64, random: &mut fastrand::Rng) -> Vec<Vec<Trial>> {
        let person = |_| {
            let usual = 100.0 + between * normal(random);
            (0..trials).map(|_| trial(Side::Left, usual + within * normal(random))).collect()
        };
        (0..people).map(person).collect()
    }

    fn feet(people: &[Vec<Trial>], least_people: usize) -> (Vec<FootRepeatability>, Vec<SingleTrial>) {
        let named: Vec<_> = people.iter().map(|trials| ("ann", &trials[..])).collect();
        repeatability(&named, least_people)
    }

    fn heel(foot: &FootRepeatability) -> Agreement {
        foot.rows[0].regions[Region::Heel as usize].expect("values")
    }

    #[test]
    fn known_variances_between_and_within_people_are_recovered() {
        // Standard deviations 3 and 1.5: ICC = 9 / (9 + 2.25) = 0.8. Its standard error is, by Fisher's approximation,
        // sqrt(2 (1 - r)^2 (1 + (k - 1) r)^2 / (k (n - 1) (k - 1))), and that of SEM is SEM / sqrt(2 n (k - 1)).
        let (people, trials, icc, within) = (400, 3, 0.8_f64, 1.5);
        let (n, k) = (people as f64, trials as f64);
        let icc_error = (2.0 * ((1.0 - icc) * (1.0 + (k - 1.0) * icc)).powi(2) / (k * (n - 1.0) * (k - 1.0))).sqrt();
        let sem_error = within / (2.0 * n * (k - 1.0)).sqrt();
        let mut random = fastrand::Rng::with_seed(5);
        let mut sum = 0.0;
        const COHORTS: usize = 20;
        for _ in 0..COHORTS {
            let (feet, single) = feet(&cohort(people, trials, 3.0, within, &mut random), 2);
            assert_eq!((feet.len(), single.len(), feet[0].trials), (1, 0, trials));
            let found = heel(&feet[0]);
            assert!((found.icc.expect("an ICC") - icc).abs() < 4.0 * icc_error, "{found:?}");
            assert!((found.sem - within).abs() < 4.0 * sem_error, "{found:?}");
            assert!((found.mean - 100.0).abs() < 4.0 * 3.5 / n.sqrt(), "{found:?}");
            sum += found.icc.unwrap_or(f64::NAN);
        }
        assert!((sum / COHORTS as f64 - icc).abs() < 4.0 * icc_error / (COHORTS as f64).sqrt());
    }

    #[test]
    fn the_first_trials_of_all_people_are_compared_for_each_foot_separately() {
        let mut people: Vec<Vec<Trial>> = [[1.0, 2.0], [4.0, 4.5], [9.0, 8.0]]
            .map(|values| values.map(|value| trial(Side::Left, value)).into())
            .into();
        let (expected, _) = feet(&people, 2);
        // A third trial of one person, and trials of the other foot, change nothing.
        people[1].push(trial(Side::Left, 500.0));
        people[0].push(trial(Side::Right, 70.0));
        people[2].extend([trial(Side::Right, 80.0), trial(Side::Right, 90.0)]);
        let (found, single) = feet(&people, 2);
        assert_eq!((found.len(), heel(&found[0])), (1, heel(&expected[0])));
        assert_eq!((found[0].trials, found[0].most_trials), (2, 3));
        assert!(found[0].comparison().contains("the first 2 trials of 3 people"));
        assert_eq!(single, [SingleTrial { person: "ann".into(), side: Side::Right }]);
        assert!(found[0].rows[0].regions[Region::Hallux as usize].is_none());
    }

    #[test]
    fn one_person_has_sem_and_mdc_but_no_icc() {
        let person = vec![[1.0, 2.0, 4.0].map(|value| trial(Side::Right, value)).into()];
        assert!(feet(&person, 2).0.is_empty());
        let (found, _) = feet(&person, 1);
        let agreement = heel(&found[0]);
        // The variance of 1, 2 and 4 is 7/3.
        assert_eq!((agreement.icc, agreement.people), (None, 1));
        assert!((agreement.sem - (7.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((agreement.mdc / agreement.sem - 1.96 * 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn equal_values_have_no_icc() {
        // The mean of these values is not exactly this value.
        let people: Vec<_> = (0..10).map(|_| vec![trial(Side::Left, 9.523809523809526); 2]).collect();
        let agreement = heel(&feet(&people, 2).0[0]);
        assert_eq!((agreement.icc, agreement.sem, agreement.mdc), (None, 0.0, 0.0));
        // Three trials of one person with the thickness d0 of shoe size 39. Their mean is not exactly this thickness, either.
        let person = vec![vec![trial(Side::Left, 12.0 * (39.0 / 42.0) * 1e-3 * 1e3); 3]];
        let agreement = heel(&feet(&person, 1).0[0]);
        assert_eq!((agreement.icc, agreement.sem, agreement.mdc), (None, 0.0, 0.0));
    }

    #[test]
    fn a_mean_of_zero_has_no_percentage() {
        let agreement = |mean| Agreement { people: 2, mean, icc: None, sem: 1.0, mdc: 3.0 };
        assert_eq!([-2.0, 0.0].map(|mean| agreement(mean).mdc_percent()), [Some(150.0), None]);
        let mut regions = [None; 8];
        regions[..3].copy_from_slice(&[0.0, 2.0, 4.0].map(|mean| Some(agreement(mean))));
        let row = VariableRow { variable: Variable::nrmse(), regions };
        assert_eq!(row.median(Agreement::mdc_percent), Some(112.5));
    }

    /// Prints ICC(2,1) by the definition of McGraw and Wong (Psychol. Methods 1 (1996) 30-46, ICC(A,1)) and SEM, from a
    /// least-squares fit of the two-way model with NumPy.
    const SCRIPT: &str = "
import sys, numpy as np
x = np.loadtxt(sys.stdin)
n, k = x.shape
person, trial = np.repeat(np.eye(n), k, 0), np.tile(np.eye(k), (n, 1))
def squares(*design):
    a = np.hstack([np.ones((n * k, 1)), *design])
    return np.sum((x.ravel() - a @ np.linalg.lstsq(a, x.ravel(), rcond=None)[0]) ** 2)
none, both = squares(), squares(person, trial)
r, c, e = (squares(trial) - both) / (n - 1), (squares(person) - both) / (k - 1), both / ((n - 1) * (k - 1))
print((r - e) / (r + (k - 1) * e + k / n * (c - e)), np.sqrt(e + (c - e) / n))
";

    #[test]
    #[ignore = "needs Python with NumPy; PLANTAR_PYTHON contains the path of the interpreter"]
    fn icc_and_sem_are_those_of_numpy() {
        let python =
            std::env::var_os("PLANTAR_PYTHON").expect("PLANTAR_PYTHON contains the path of a Python interpreter");
        let mut random = fastrand::Rng::with_seed(3);
        for (people, trials, within) in [(2, 2, 0.5), (5, 3, 3.0), (12, 4, 1.0), (30, 2, 9.0)] {
            let cohort = cohort(people, trials, 3.0, within, &mut random);
            let found = heel(&feet(&cohort, 2).0[0]);
            let value = |trial: &Trial| trial.regions[0][0].unwrap_or(f64::NAN);
            let lines: Vec<String> = cohort
                .iter()
                .map(|row| row.iter().map(|t| value(t).to_string()).collect::<Vec<_>>().join(" "))
                .collect();
            let mut child = Command::new(&python)
                .args(["-c", SCRIPT])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .expect("Python starts");
            child.stdin.take().expect("a pipe").write_all(lines.join("\n").as_bytes()).expect("written");
            let output = child.wait_with_output().expect("Python ends");
            let text = String::from_utf8(output.stdout).expect("text");
            let numbers: Vec<f64> = text.split_whitespace().map(|word| word.parse().expect("a number")).collect();
            assert!((found.icc.expect("an ICC") - numbers[0]).abs() < 1e-9, "{found:?}, NumPy: {numbers:?}");
            assert!((found.sem - numbers[1]).abs() < 1e-9, "{found:?}, NumPy: {numbers:?}");
        }
    }
}
