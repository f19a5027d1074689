//! The people of a cohort, and means as in the paper: over the steps of each trial, over the trials of both feet, then over the
//! people of each pair of insole sizes.

use crate::trials::{Moments, Trial, Values, is_fitted, means};
use crate::variable::Variable;
use parameters::{Participant, Sex};
use std::collections::BTreeMap;

/// A person of a cohort.
#[derive(Clone, Debug, PartialEq)]
pub struct Person {
    /// Name of the person, which is that of the folder with the recordings.
    pub name: String,
    /// European shoe size, from the settings or a default.
    pub size_eur: u8,
    /// The content of the person's `participant.toml`.
    pub settings: Participant,
    /// Number of steps of all trials.
    pub steps: usize,
    /// The trials of both feet.
    pub trials: Vec<Trial>,
}

impl Person {
    /// The means over the trials of both feet.
    pub fn region(&self, region: usize) -> Values {
        means(self.trials.iter().map(|trial| &trial.regions[region]))
    }
}

/// The people with sizes of the same pair, such as 37 and 38.
#[derive(Clone, Debug)]
pub struct SizeGroup<'p> {
    /// The smaller size of the pair.
    pub smaller_eur: u8,
    /// The people.
    pub people: Vec<&'p Person>,
    /// The means of each person, by region.
    means: Vec<[Values; 8]>,
}

impl<'p> SizeGroup<'p> {
    /// Groups people by pairs of sizes, as in the paper: 35-36, 37-38 and so on.
    pub fn all(people: &'p [Person]) -> Vec<Self> {
        let mut groups = BTreeMap::<u8, Vec<&Person>>::new();
        for person in people {
            groups.entry(person.size_eur - (person.size_eur + 1) % 2).or_default().push(person);
        }
        let group = |(smaller_eur, people): (u8, Vec<&'p Person>)| {
            let of_person = |person: &&Person| std::array::from_fn(|region| person.region(region));
            Self { smaller_eur, means: people.iter().map(of_person).collect(), people }
        };
        groups.into_iter().map(group).collect()
    }

    /// The name of the pair of sizes: `37-38`.
    pub fn name(&self) -> String {
        format!("{}-{}", self.smaller_eur, self.smaller_eur + 1)
    }

    /// Number of females, males and, unless there are none, others: `5/0` or `5/0/1`. People of unknown sex are not counted.
    pub fn sexes(&self) -> String {
        let count = |sex: Sex| self.people.iter().filter(|person| person.settings.sex == Some(sex)).count();
        match Sex::ALL.map(count) {
            [female, male, 0] => format!("{female}/{male}"),
            [female, male, other] => format!("{female}/{male}/{other}"),
        }
    }

    /// Mean and standard deviation of a value of the settings over the people of whom it is known; `None` if there are none.
    pub fn of_settings(&self, value: impl Fn(&Participant) -> Option<f64>) -> Option<Moments> {
        Moments::of(self.people.iter().filter_map(|person| value(&person.settings)))
    }

    /// Number of people of whom a region was fitted.
    pub fn fitted(&self, region: usize) -> usize {
        self.means.iter().filter(|person| is_fitted(&person[region])).count()
    }

    /// Mean and standard deviation of a variable in a region over the people; `None` if nobody has a value.
    pub fn moments(&self, region: usize, variable: Variable) -> Option<Moments> {
        let i = variable.index();
        Moments::of(self.means.iter().filter_map(|person| person[region][i]))
    }

    /// The number of people with a value as an addition to `moments`, such as ` (3)`; empty if all people of the group have one.
    pub fn count_unless_all(&self, moments: &Moments) -> String {
        if moments.count < self.people.len() { format!(" ({})", moments.count) } else { String::new() }
    }
}
