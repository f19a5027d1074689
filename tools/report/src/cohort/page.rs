//! The web page on a cohort.

use crate::cohort::{Cohort, by_size, participants, repeatability};
use crate::document::{document, legend, section, wide};
use crate::format::count;
use fit::cohort::SizeGroup;
use fit::variable::Variable;
use maud::{Markup, html};

/// The whole page.
pub fn page(cohort: &Cohort) -> Markup {
    let groups = SizeGroup::all(cohort.people);
    document(
        &format!("Plantar tissue of {}", count(cohort.people.len(), "participant")),
        "Viscoelastic ellipsoids of eight plantar regions, identified from every single step in walking",
        &html! {
            (section("people", "Participants", people(cohort)))
            (section("errors", "Errors by region and insole size", errors(&groups)))
            (section("loads", "Measured loads by region and insole size", loads(&groups)))
            (section("quantities", "Mechanical quantities by region and insole size", quantities(&groups)))
            (section("parameters", "Parameters by region and insole size", parameters(&groups)))
            (section("repeatability", "Repeatability between trials", repeated(cohort)))
            (section("reading", "How to read this report", reading(cohort)))
        },
    )
}

fn people(cohort: &Cohort) -> Markup {
    html! {
        (wide("Participants by insole size", participants::by_size(cohort.people)))
        (wide("Each participant", participants::each(cohort.people)))
        @if !cohort.incomplete.is_empty() {
            dl.warnings { div { dt { "Incomplete results" } @for defect in cohort.incomplete { dd { (defect) "." } } } }
        }
    }
}

fn errors(groups: &[SizeGroup]) -> Markup {
    html! {
        (legend(&by_size::legend(groups)))
        figure.beside {
            (by_size::errors(groups).svg())
            figcaption {
                "As Fig. 7 of the paper (see Source): NRMSE of the model force against the measured force, each step with \
                 parameters of its own. Bars: mean over the participants of a pair of insole sizes. Lines: one standard \
                 deviation to each side. The number of participants is in parentheses."
            }
        }
        (wide("Errors by region and insole size", by_size::table(groups)))
    }
}

fn loads(groups: &[SizeGroup]) -> Markup {
    html! {
        p {
            "Values of the step records, without the model, also of regions that were not fitted. Mean and standard deviation over \
             participants. Steps in which a region has no contact are not averaged."
        }
        (charts(groups, Variable::loads()))
    }
}

fn quantities(groups: &[SizeGroup]) -> Markup {
    html! {
        p {
            "Values of the force law, which can be compared between people. Mean and standard deviation over participants; a quantity \
             is missing for a region that does not reach the force or strain at which the quantity is defined."
        }
        (charts(groups, Variable::quantities()))
    }
}

fn parameters(groups: &[SizeGroup]) -> Markup {
    html! {
        p {
            "As Fig. 8 of the paper (see Source). Of the eight parameters, the force determines only five combinations. \
             d₀, C and A/B are fixed or measured, and single parameters can compensate each other. Compare people by the \
             quantities above."
        }
        (charts(groups, Variable::parameters()))
    }
}

fn charts(groups: &[SizeGroup], variables: impl Iterator<Item = Variable>) -> Markup {
    html! {
        (legend(&by_size::legend(groups)))
        div.panels { @for chart in by_size::charts(groups, variables) { figure { (chart.svg()) } } }
    }
}

fn repeated(cohort: &Cohort) -> Markup {
    html! {
        @if cohort.feet.is_empty() {
            p {
                "To compare trials, at least two participants with at least two recordings each of the left foot, or each of \
                 the right foot, are needed."
            }
        } @else {
            (legend(&repeatability::legend()))
        }
        @for foot in cohort.feet {
            figure.beside {
                (repeatability::chart(foot).svg())
                figcaption {
                    "Intraclass correlation ICC(2,1) of each variable: 1 if the trials of each participant agree, 0 if they differ as \
                     much as participants do. Points: regions. Arrows: below the scale."
                }
            }
            (wide("Medians over the regions", repeatability::medians(foot)))
            (wide("Repeatability by region", repeatability::by_region(foot)))
        }
    }
}

fn reading(cohort: &Cohort) -> Markup {
    let rule = &cohort.contact;
    html! {
        p {
            strong { "Means. " }
            "Each region of each step is fitted separately. Means are taken over the steps of a recording, then over the recordings of \
             both feet, then over the participants of a pair of insole sizes. All are arithmetic, also those of k and c, in which a few \
             stiff steps can dominate."
        }
        p {
            strong { "Repeatability. " }
            "A trial is one recording of one foot; its value is the mean over the steps. The standard error of measurement \
             (SEM) is the standard deviation of a trial about the mean of the participant. Two trials that differ by less \
             than the minimal detectable change (MDC, 1.96 sqrt(2) SEM) may be of an unchanged person. With few participants the ICC \
             itself is uncertain. The thickness d₀ is assumed or measured, and does not follow from the trials."
        }
        p {
            strong { "Limits. " }
            "A cell is in contact from " (rule.on_kpa) " kPa on, until its pressure falls below " (rule.off_kpa) " kPa; "
            @if rule.full_kpa > 0.0 { "it counts with the fraction √(p / " (rule.full_kpa) " kPa) of its area, at most 1. " }
            @else { "it counts with its whole area. " }
            "Values are comparable only for the same contact rule, sensor, and sources of thickness and C. Deformations, and \
             with them stiffness, moduli and energies, are scaled by assumption unless thickness and strain of the tissue were \
             measured. This is not a medical device; it must not be used for diagnosis."
        }
        p {
            strong { "Source. " }
            cite { "J. DeBerardinis, J. S. Dufek, M. B. Trabia, Journal of Biomechanics 92 (2019) 137–145." }
            " Software: Plantar " (env!("PLANTAR_VERSION")) "."
        }
    }
}
