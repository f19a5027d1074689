//! The participants: a table in the form of Table 1 of the paper, by insole size, and a table with a row for each person.

use crate::format::NONE;
use fit::cohort::{Person, SizeGroup};
use fit::trials::Moments;
use maud::{Markup, html};
use parameters::Participant;

/// The titles of the columns of the table by insole size (Table 1 of the paper).
pub const TITLES: [&str; 6] =
    ["Insole size (EU)", "Participants", "Female/male", "Age, years", "Mass, kg", "Height, m"];

/// The rows of the table by insole size, with mean ± standard deviation and, unless all people of the row have a value, the
/// number of those who have one.
pub fn rows(people: &[Person]) -> Vec<[String; 6]> {
    let row = |group: SizeGroup| {
        let text = |moments: Option<Moments>, decimals: usize| {
            moments.map_or(NONE.into(), |moments| {
                plus_minus(&moments, |value| format!("{value:.decimals$}")) + &group.count_unless_all(&moments)
            })
        };
        [
            group.name().replace('-', "–"),
            group.people.len().to_string(),
            group.sexes(),
            text(group.of_settings(|settings| settings.age_years), 1),
            text(group.of_settings(|settings| settings.mass_kg), 1),
            text(group.of_settings(height_m), 2),
        ]
    };
    SizeGroup::all(people).into_iter().map(row).collect()
}

/// Mean ± standard deviation; only the mean if there is a single value.
pub fn plus_minus(moments: &Moments, number: impl Fn(f64) -> String) -> String {
    let deviation = moments.deviation.map_or(String::new(), |sd| format!(" ± {}", number(sd)));
    number(moments.mean) + &deviation
}

fn height_m(settings: &Participant) -> Option<f64> {
    settings.height_cm.map(|cm| cm / 100.0)
}

/// The table by insole size.
pub fn by_size(people: &[Person]) -> Markup {
    html! {
        table #sizes {
            caption {
                "Participants by insole size, mean ± standard deviation, in the form of Table 1 of the paper. If not all \
                 participants of a row have a value, the number of those who have one follows in parentheses"
            }
            thead { tr { @for title in TITLES { th scope="col" { (title) } } } }
            tbody {
                @for [size, rest @ ..] in rows(people) {
                    tr { th scope="row" { (size) } @for value in rest { td { (value) } } }
                }
            }
        }
    }
}

/// The table with a row for each person.
pub fn each(people: &[Person]) -> Markup {
    let known = |value: Option<f64>, decimals: usize| value.map_or(NONE.into(), |value| format!("{value:.decimals$}"));
    html! {
        table #participants {
            caption { "Each participant" }
            thead {
                tr {
                    @for title in ["Participant", "Size (EU)", "Sex", "Age, years", "Mass, kg", "Height, m", "Recordings", "Steps"] {
                        th scope="col" { (title) }
                    }
                }
            }
            tbody {
                @for Person { name, size_eur, settings, steps, trials } in people {
                    tr {
                        th scope="row" { (name) }
                        td { (size_eur) @if settings.size.is_none() { " (assumed)" } }
                        td { (settings.sex.map_or(NONE, |sex| sex.name())) }
                        td { (known(settings.age_years, 1)) }
                        td { (known(settings.mass_kg, 1)) }
                        td { (known(height_m(settings), 2)) }
                        td { (trials.len()) }
                        td { (steps) }
                    }
                }
            }
        }
    }
}
