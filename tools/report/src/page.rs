//! The web page on one person: its sections in order, and the summary.

use crate::document::{document, legend, section, wide};
use crate::format::{NONE, count, percent};
use crate::region::{TITLES, fit_of, fitted};
use crate::{
    bars, curves, foot, how_to_read, literature, parameters, protocol, quantities, scale_sources, sensitivity,
};
use fit::Study;
use maud::{Markup, html};

/// The whole page.
pub fn page(study: &Study) -> Markup {
    let title = format!("Plantar tissue of {}", study.participant);
    let subtitle =
        "Viscoelastic ellipsoids of eight plantar regions, identified from contact area and force in walking";
    document(
        &title,
        subtitle,
        &html! {
            (summary(study))
            (section("quantities", "Mechanical quantities by region", quantity_figures(study)))
            (section("protocol", "Participant and protocol", protocol::protocol(study)))
            (section("foot", "Position of the regions", foot_figure(study)))
            (section("curves", "Area and force in a typical step", curve_figures(study)))
            (section("errors", "Errors by region", error_figure(study)))
            (section("parameters", "Parameters by region", parameter_figures(study)))
            (section("sensitivity", "Sensitivity to the choices of the method", sensitivity::sensitivity(study)))
            (section("literature", "Comparison with published measurements", literature::literature(study)))
            (section("table", "Table of errors", wide("Table of errors", bars::table(study))))
            (section("reading", "How to read this report", how_to_read::instructions(&study.options)))
        },
    )
}

fn summary(study: &Study) -> Markup {
    let fitted: Vec<_> = fitted(study).collect();
    html! {
        section #summary aria-labelledby="summary-title" {
            h2 #summary-title { "Can the parameters be used?" }
            p { (fitted.len()) " of 8 regions were fitted, from " (count(study.steps.len(), "step")) ". " (errors(study)) }
            table.words {
                caption.hidden { "Verdict by region" }
                thead {
                    tr {
                        th scope="col" { "Region" }
                        th.figure scope="col" { "NRMSE of" br; "prediction, %" }
                        th scope="col" { "Verdict" }
                    }
                }
                tbody {
                    @for region in 0..8 {
                        tr {
                            th scope="row" { (TITLES[region]) }
                            @match fit_of(study, region) {
                                Ok(fit) => {
                                    td.figure { (fit.quality.predicted.map_or(NONE.into(), percent)) }
                                    td.prose {
                                        (fit.verdict) "."
                                        @for defect in &fit.defects {
                                            div.reason { strong { "Incomplete: " } (defect) "." }
                                        }
                                    }
                                }
                                Err(reason) => {
                                    td.figure { (NONE) }
                                    td.prose.reason { strong { "Not fitted: " } (reason) "." }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The size of the errors, in sentences.
fn errors(study: &Study) -> String {
    let mut predicted: Vec<(f64, usize)> =
        fitted(study).filter_map(|(region, fit)| Some((fit.quality.predicted?, region))).collect();
    predicted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(sum) = curves::Sum::of(study) else { return String::new() };
    let of_sum = format!(
        "In a typical step, the sum of the model forces over the fitted regions has an NRMSE of {} %.",
        percent(sum.nrmse())
    );
    match &predicted[..] {
        [] => {
            format!("With a single step, the error for a new step cannot be estimated. {of_sum}")
        }
        [(only, region)] => {
            format!(
                "The NRMSE of steps that were not used for the fit is {} % of the peak force of the region ({}). {of_sum}",
                percent(*only),
                TITLES[*region]
            )
        }
        [(least, best), .., (most, worst)] => format!(
            "The NRMSE of steps that were not used for the fit is between {} % ({}) and {} % ({}) of the peak force of the region. \
             {of_sum}",
            percent(*least),
            TITLES[*best],
            percent(*most),
            TITLES[*worst]
        ),
    }
}

fn foot_figure(study: &Study) -> Markup {
    let Some(drawing) = foot::foot(study) else {
        return html! { p { "No recording has a layout of cells, so no cells can be shown." } };
    };
    html! {
        (legend(&foot::legend()))
        figure.beside {
            (drawing.svg())
            figcaption {
                "Soles seen from above, toes up, with the cells of the first recording of each foot, coloured by region. \
                 Solid: the contact ellipse, mean over the steps of that foot, weighted by force. Dashed, in the colour of \
                 the region: the outline of the fitted ellipsoid, drawn at the centre and angle of the contact ellipse. \
                 Each region has one ellipsoid for both feet. An ellipsoid may be much larger than any contact; the drawing \
                 is clipped at the border."
            }
        }
    }
}

fn curve_figures(study: &Study) -> Markup {
    let sum = curves::Sum::of(study);
    html! {
        p {
            "For each region, the step with the median error, with the parameters that were fitted to all steps. \
             All charts have the same time axis; the axes of force and area differ."
        }
        (legend(&curves::legend()))
        div.panels {
            @for region in 0..8 {
                @let typical = curves::Typical::of(study, region);
                figure {
                    h3 { (TITLES[region]) }
                    @if let Some(area) = curves::area(study, region, &typical) { (area.svg()) }
                    (curves::force(study, region, &typical).svg())
                    @if let Ok(typical) = &typical { figcaption { (step(study, typical.step)) } }
                }
            }
            figure {
                h3 { "Sum of the regions" }
                (curves::sum(study, sum.as_ref()).svg())
                @if let Some(sum) = &sum {
                    figcaption {
                        (step(study, sum.step)) ". "
                        @if fitted(study).count() < 8 {
                            "Points and model: sum of the fitted regions, which carry " (percent(sum.share())) " % of the peak \
                             force on the whole foot (dashed)."
                        } @else {
                            "All eight regions."
                        }
                    }
                }
            }
        }
    }
}

/// The name of a step.
fn step(study: &Study, step: usize) -> String {
    let step = &study.steps[step];
    let name = study.sources.get(step.recording).map_or("", |source| &source.name);
    format!("Step {} of {name}, {} foot, at {:.2} s", step.number, step.side.name(), step.start_s)
}

fn error_figure(study: &Study) -> Markup {
    html! {
        (legend(&bars::legend()))
        figure.beside {
            (bars::bars(study).svg())
            figcaption {
                "NRMSE by region against the measured force, mean over the steps: with parameters fitted to all steps \
                 (fitted), to each step alone (own) and to the other steps (predicted), and the smallest error of any \
                 elastic law (floor). Triangles: Table 2 of the paper, one participant; a reference, not a norm."
            }
        }
    }
}

fn quantity_figures(study: &Study) -> Markup {
    html! {
        p {
            "Single parameters of the model can compensate each other. These quantities cannot, so they can be compared \
             between recordings and people."
        }
        p { strong { "Note: " } (study.measures_note()) "." }
        (legend(&quantities::legend()))
        figure { div.panels { @for chart in quantities::charts(study) { (chart.svg()) } } }
        (wide("Mechanical quantities by region", quantities::table(study)))
    }
}

fn parameter_figures(study: &Study) -> Markup {
    html! {
        (wide("Sources of d₀ and C", scale_sources::table(study)))
        (legend(&parameters::legend(study)))
        figure {
            div.panels { @for chart in parameters::charts(study) { (chart.svg()) } }
            figcaption {
                "The five identifiable parameters by region, with their 95 % confidence intervals. The axes of the \
                 product A B, of K and of G are logarithmic. K and G are stiffness and damping at a deformation of C."
            }
        }
        (wide("The five identifiable parameters", parameters::five(study)))
        (wide("The eight parameters", parameters::eight(study)))
        (parameters::warnings(study))
    }
}
