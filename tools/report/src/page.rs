//! The page: its sections in order, and the summary that says what can be trusted.

use crate::drawing::{Drawing, STYLE};
use crate::format::{NONE, count, percent};
use crate::region::{TITLES, fit_of, fitted};
use crate::{bars, curves, foot, parameters, protocol, reading};
use fit::Study;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// All of it.
pub fn page(study: &Study) -> Markup {
    let title = format!("Plantar tissue of {}", study.participant);
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                // No favicon is asked for.
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(include_str!("style.css"))) }
            }
            body {
                main {
                    header {
                        h1 { (title) }
                        p { "Viscoelastic ellipsoids of eight plantar regions, identified from contact area and force while walking" }
                    }
                    (summary(study))
                    (section("protocol", "Participant and protocol", protocol::protocol(study)))
                    (section("foot", "Where the regions are", foot_figure(study)))
                    (section("curves", "Area and force of a typical step", curve_figures(study)))
                    (section("errors", "Errors by region", error_figure(study)))
                    (section("parameters", "Parameters by region", parameter_figures(study)))
                    (section("table", "Table of errors", wide("Table of errors", bars::table(study))))
                    (section("reading", "How to read this", reading::reading(study.options.method)))
                }
            }
        }
    }
}

fn section(id: &str, title: &str, content: Markup) -> Markup {
    html! { section id=(id) aria-labelledby={ (id) "-title" } { h2 id={ (id) "-title" } { (title) } (content) } }
}

/// A table that may be wider than a telephone.
fn wide(label: &str, table: Markup) -> Markup {
    html! { div.wide tabindex="0" role="region" aria-label=(label) { (table) } }
}

fn summary(study: &Study) -> Markup {
    let fitted: Vec<_> = fitted(study).collect();
    html! {
        section #summary aria-labelledby="summary-title" {
            h2 #summary-title { "Can I trust this?" }
            p { (fitted.len()) " of 8 regions were fitted, from " (count(study.steps.len(), "step")) ". " (errors(study)) }
            table.words {
                caption.hidden { "Verdict by region" }
                thead {
                    tr {
                        th scope="col" { "Region" }
                        th.figure scope="col" { "Predicted" br; "NRMSE, %" }
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
                                    td.prose { (fit.verdict) "." }
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

/// How large errors are, in a sentence.
fn errors(study: &Study) -> String {
    let mut predicted: Vec<(f64, usize)> =
        fitted(study).filter_map(|(region, fit)| Some((fit.quality.predicted?, region))).collect();
    predicted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(sum) = curves::Sum::of(study) else { return String::new() };
    let of_sum = format!("The sum over the fitted regions errs by {} % in a typical step.", percent(sum.nrmse()));
    match &predicted[..] {
        [] => {
            format!("One step cannot be predicted from others, so how well a new one would be is not known. {of_sum}")
        }
        [(only, region)] => {
            format!("It predicts unseen steps of the {} with {} %. {of_sum}", TITLES[*region], percent(*only))
        }
        [(least, best), .., (most, worst)] => format!(
            "A step that was not used is predicted with an error between {} % ({}) and {} % ({}) of the region's peak force. \
             {of_sum}",
            percent(*least),
            TITLES[*best],
            percent(*most),
            TITLES[*worst]
        ),
    }
}

fn foot_figure(study: &Study) -> Markup {
    let Some(drawing) = foot::foot(study) else { return html! { p { "No cells: there is no recording." } } };
    html! {
        (key(&foot::key()))
        figure.beside {
            (drawing.svg())
            figcaption {
                "Soles from above, toes up. Cells are coloured by region; of each foot they are those of its first recording. \
                 The contact ellipse is the mean over the steps of that foot, weighted by force. Dashed, in the region's colour: \
                 the outline of the fitted ellipsoid, at the place and angle of the contact. One ellipsoid a region holds for \
                 both feet. It may be much larger than any contact; what reaches beyond the picture is cut."
            }
        }
    }
}

fn curve_figures(study: &Study) -> Markup {
    let sum = curves::Sum::of(study);
    html! {
        p {
            "Of each region the step whose error is the median of its steps, with the parameters fitted to all steps. \
             All charts share one time axis; each has its own force and area axis."
        }
        (key(&curves::key()))
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
                            "Points and model: the fitted regions, with " (percent(sum.share())) " % of the whole foot's peak \
                             force (dashed)."
                        } @else {
                            "All eight regions."
                        }
                    }
                }
            }
        }
    }
}

/// Which step.
fn step(study: &Study, step: usize) -> String {
    let step = &study.steps[step];
    let name = study.sources.get(step.recording).map_or("", |source| &source.name);
    format!("Step {} of {name}, {} foot, at {:.2} s", step.number, step.side.name(), step.start_s)
}

/// How large a key is, rem per unit of its drawing.
const KEY: f64 = 0.075;

fn key(items: &[Drawing]) -> Markup {
    html! { div.key { @for item in items { span style=(format!("width:{:.1}rem", KEY * item.width)) { (item.svg()) } } } }
}

fn error_figure(study: &Study) -> Markup {
    html! {
        (key(&bars::key()))
        figure.beside {
            (bars::bars(study).svg())
            figcaption {
                "NRMSE by region, raw force, mean over the steps: fitted to all, each step's own, predicted from the others, and \
                 the floor of any elastic law. The triangle above the bars is the paper's Table 2, one participant: a reference, \
                 not a norm."
            }
        }
    }
}

fn parameter_figures(study: &Study) -> Markup {
    html! {
        (key(&parameters::key()))
        figure {
            div.panels { @for chart in parameters::charts(study) { (chart.svg()) } }
            figcaption {
                "The five parameters that force can tell, by region, with their 95 % intervals. A B, K and G are on logarithmic \
                 axes. K and G are stiffness and damping where deformation equals C."
            }
        }
        (wide("The five parameters", parameters::five(study)))
        (wide("The eight parameters", parameters::eight(study)))
        (parameters::warnings(study))
    }
}
