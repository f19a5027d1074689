//! The report on a cohort: its participants (Table 1 of the paper), errors and values by region and insole size (Figs. 7 and 8),
//! and the repeatability of the values between trials.

mod by_size;
mod page;
mod participants;
#[cfg(feature = "png")]
mod picture;
mod repeatability;

#[cfg(feature = "png")]
pub use picture::png;

use fit::agreement::FootRepeatability;
use fit::cohort::Person;
use fit::variable::Variable;
use plantar::pipeline::contact::ContactRule;

/// A cohort whose steps were fitted individually.
#[derive(Clone, Copy, Debug)]
pub struct Cohort<'c> {
    /// The people.
    pub people: &'c [Person],
    /// The repeatability for the left and for the right foot, each only if enough people have two or more trials of it; see
    /// [`fit::agreement::repeatability`].
    pub feet: &'c [FootRepeatability],
    /// The defects of the fits, with the names of participant, recording and region.
    pub incomplete: &'c [String],
    /// The contact rule by which the areas were measured.
    pub contact: ContactRule,
}

/// The report as one HTML file, which loads no other resource and contains no scripts.
pub fn html(cohort: &Cohort) -> String {
    page::page(cohort).into_string()
}

/// Name and unit of a variable in figures.
fn title(variable: Variable) -> String {
    variable.title_and_unit().replace("mm2", "mm²")
}
