//! The protocol of the identification: participant, recordings, excluded contacts and the options of the fit.

use crate::drawing::tick;
use crate::format::{count, number};
use fit::{Filter, Method, Options, Study};
use maud::{Markup, html};

/// The content of the section.
pub fn protocol(study: &Study) -> Markup {
    html! {
        dl.facts {
            dt { "Participant" } dd { (study.participant) }
            dt { "Steps used" }
            dd { (count(study.steps.len(), "step")) " of " (count(study.steps.len() + study.excluded_contacts.len(), "contact")) }
            dt { "Contact rule" } dd { (contact(study)) }
            dt { "Filter" } dd { (filter(study.options.filter)) }
            dt { "Method" } dd { (method(&study.options)) }
            @if study.options.method == Method::Projection {
                dt { "Bounds" } dd { (bounds(study)) }
                @if let Some(note) = study.prior_note() { dt { "Prior" } dd { (note) } }
                dt { "Assumed compression" }
                dd {
                    (number(study.options.compression * 100.0)) " % of the thickness: it determines C of regions without a measured \
                     peak strain or curvature"
                }
            }
            dt { "Software" } dd { "Plantar " (env!("PLANTAR_VERSION")) }
        }
        (sources(study))
        (excluded_contacts(study))
    }
}

fn contact(study: &Study) -> String {
    let rule = &study.contact;
    let counted = match rule.full_kpa {
        0.0 => "counts with its whole area".into(),
        full_kpa => format!("counts with the fraction √(p / {full_kpa} kPa) of its area, at most 1"),
    };
    format!(
        "a cell is in contact from {} kPa until its pressure falls below {} kPa, and {counted}; the areas are {}s. The parameters are \
         valid for this rule only",
        rule.on_kpa,
        rule.off_kpa,
        recording::area_title(rule)
    )
}

fn filter(filter: Filter) -> &'static str {
    match filter {
        Filter::Direct => {
            "the filter of the step record: contact area as measured, deformation rate as the difference over 20 ms; force as \
             measured"
        }
        Filter::Smoothed => {
            "the smoothing of the paper: contact area smoothed by a three-point mean and a polynomial of fifth order over the \
             contact phase, deformation rate by Eq. 16"
        }
        Filter::Live => {
            "the filter of the live stream: mean contact area of three frames, deformation rate by the backward difference; force \
             as measured"
        }
    }
}

fn method(options: &Options) -> &'static str {
    match options.method {
        Method::Projection if options.prior.is_some() => {
            "five parameters, the most probable ones given the measured force and their distribution among ten walkers (prior); \
             deterministic"
        }
        Method::Projection => "five parameters by variable projection from a grid of starting points; deterministic",
        Method::Paper => {
            "the method of the paper: eight variables by a general solver from ten random starts; force smoothed by a \
             polynomial of fifth order"
        }
    }
}

fn bounds(study: &Study) -> String {
    if study.options.prior.is_some() {
        return "π A B 1 to 8.4 times the largest contact area, n −0.95 to 9.0, m up to 10; the prior replaces further bounds"
            .into();
    }
    let bounds = &study.options.bounds;
    // The reciprocals of the ratios are pi A B divided by the largest area.
    let [most, least] = bounds.max_ratio.map(f64::recip);
    let range = |[low, high]: [f64; 2], factor: f64| format!("{} to {}", tick(low * factor), tick(high * factor));
    format!(
        "π A B {} times the largest contact area, K {} kPa, G {} kPa s, n {}, m {}; chosen by this software, because the \
         bounds of the paper are not published",
        range([least, most], 1.0),
        range(bounds.stiffness_pa, 1e-3),
        range(bounds.damping_pa_s, 1e-3),
        range(bounds.n, 1.0),
        range(bounds.m, 1.0)
    )
}

fn sources(study: &Study) -> Markup {
    html! {
        @if study.sources.is_empty() { p { "No recording." } } @else {
            div.wide tabindex="0" role="region" aria-label="Recordings" { table.words {
                caption { "Recordings" }
                thead {
                    tr {
                        th scope="col" { "Name" }
                        th scope="col" { "Foot" }
                        th.figure scope="col" { "Rate, Hz" }
                        th.figure scope="col" { "Cells" }
                        th.figure scope="col" { "Steps" }
                        th scope="col" { "Origin" }
                    }
                }
                tbody {
                    @for (i, source) in study.sources.iter().enumerate() {
                        tr {
                            th scope="row" { (source.name) }
                            td { (source.side.name()) }
                            td.figure { (number(source.rate_hz)) }
                            td.figure {
                                @if source.layout.cells.is_empty() { "live stream" } @else { (source.layout.cells.len()) }
                            }
                            td.figure { (study.steps.iter().filter(|step| step.recording == i).count()) }
                            td.prose { (source.origin) }
                        }
                    }
                }
            } }
        }
    }
}

fn excluded_contacts(study: &Study) -> Markup {
    html! {
        @if study.excluded_contacts.is_empty() { p { "No contact was excluded." } } @else {
            table.words {
                caption { "Excluded contacts" }
                thead { tr { th scope="col" { "Recording" } th.figure scope="col" { "Time, s" } th scope="col" { "Reason" } } }
                tbody {
                    @for contact in &study.excluded_contacts {
                        tr {
                            th scope="row" { (study.sources.get(contact.recording).map_or("", |source| &source.name)) }
                            td.figure { (format!("{:.2}", contact.at_s)) }
                            td.prose { (contact.reason) }
                        }
                    }
                }
            }
        }
    }
}
