//! The sources of d0 and C of each region, the dependence of the results on the source of C, and the misfit of an ellipse to the
//! contact.

use crate::format::{NONE, number, signed_percent};
use crate::region::{TITLES, fit_of};
use fit::measures::{Quantity, SCALE_CHANGE};
use fit::results::deformation_scale;
use fit::{RegionFit, Study};
use maud::{Markup, html};

/// The table.
pub fn table(study: &Study) -> Markup {
    let change = format!("{:.0} %", SCALE_CHANGE * 100.0);
    html! {
        table.dense #sources {
            caption {
                "Tissue thickness d₀ and vertical ellipsoid radius C cannot be identified from the force. The table states \
                 their source, and by how much C and the results at 20 % strain change if the value from which C follows is "
                (change) " smaller / larger. Share of assumption: 0 if C rests on measurements only, 50 % if either thickness or \
                 compression is assumed, or if C follows from a curvature, 100 % if both are, or if C results from the search of \
                 the paper. Unless it is 0, stiffness, moduli and energies follow from a deformation (scaled by assumption). \
                 C of a curvature follows from Eq. 14: an elastic half-space (Hertz) would be compressed twice as much. \
                 Ellipse misfit: area of the ellipse with the second moments of the contact, relative to the contact area, \
                 minus 1; it is large for a contact of separate parts, and for light contact if edge cells count with a \
                 fraction of their area."
            }
            thead {
                tr {
                    th scope="col" { "Region" }
                    th scope="col" { "d₀, mm" }
                    th.kind scope="col" { "Source of C" }
                    th scope="col" { "Share of" br; "assumption, %" }
                    th scope="col" { "C, mm" }
                    th scope="col" { "Change of C, %" }
                    th scope="col" { "of secant" br; "stiffness, %" }
                    th scope="col" { "of secant" br; "modulus, %" }
                    th scope="col" { "Ellipse" br; "misfit, %" }
                }
            }
            tbody {
                @for region in 0..8 {
                    tr {
                        th scope="row" { (TITLES[region]) }
                        @match fit_of(study, region) {
                            Ok(fit) => {
                                @let source = if fit.fixed.is_thickness_measured { "measured" } else { "typical" };
                                td { (number(fit.fixed.thickness_m * 1e3)) ", " (source) }
                                td.kind { (fit.fixed.scale) }
                                td { (deformation_scale(&fit.fixed).assumed_percent()) }
                                td { (number(fit.law.c_m * 1e3)) }
                                @for change in changes(fit) { td { (change) } }
                                td { (fit.ellipse_misfit.map_or(NONE.into(), signed_percent)) }
                            }
                            Err(reason) => td.reason colspan="8" { "Not fitted: " (reason) },
                        }
                    }
                }
            }
        }
    }
}

/// The changes of C, secant stiffness and secant modulus with a smaller and a larger source value.
fn changes(fit: &RegionFit) -> [String; 3] {
    let Some(effect) = fit.scale_effect else { return [NONE; 3].map(String::from) };
    let value = |quantity| fit.measure(quantity).map(|m| m.value);
    let both = |fitted: Option<f64>, less: Option<f64>, more: Option<f64>| match (fitted, less, more) {
        (Some(fitted), Some(less), Some(more)) => {
            let change = |to: f64| format!("{:+.0}", (to / fitted - 1.0) * 100.0).replace('-', "−");
            format!("{} / {}", change(less), change(more))
        }
        _ => NONE.into(),
    };
    let (less, more) = (effect.at_less, effect.at_more);
    [
        both(Some(fit.law.c_m), Some(less.c_m), Some(more.c_m)),
        both(value(Quantity::SecantStiffness), less.secant_stiffness_n_mm, more.secant_stiffness_n_mm),
        both(value(Quantity::SecantModulus), less.secant_modulus_kpa, more.secant_modulus_kpa),
    ]
}
