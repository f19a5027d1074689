//! Comparison with published measurements, and with the findings of the paper.

use crate::format::{NONE, number};
use crate::region::{TITLES, fitted};
use fit::fixed::Scale;
use fit::{Method, RegionFit, Study};
use maud::{Markup, html};
use plantar::Region;
use std::fmt;

/// A published measurement of a region.
struct Published {
    quantity: &'static str,
    region: Region,
    value: &'static str,
    conditions: &'static str,
    source: &'static str,
    /// The value of this person, with its origin if it may be an assumption; `None` if the fit has no such value.
    own: fn(&RegionFit) -> Option<String>,
}

const LOADING_HISTORY: &str = "Effect of loading history on material properties of human heel pad: an in-vivo pilot investigation \
    during gait, BMC Musculoskelet. Disord. (2022), doi 10.1186/s12891-022-05197-w";
const CAVANAGH: &str =
    "P. R. Cavanagh, Plantar soft tissue thickness during ground contact in walking, J. Biomech. 32(6) (1999)";
const FLUOROSCOPY: &str = "ten healthy adults, 23 to 72 years, dual fluoroscopy and pressure plate in walking";
const ULTRASOUND: &str = "second metatarsal head of five healthy adults, ultrasound, first step, barefoot";

const PUBLISHED: [Published; 4] = [
    Published {
        quantity: "Thickness, mm",
        region: Region::Heel,
        value: "16.0 (median)",
        conditions: FLUOROSCOPY,
        source: LOADING_HISTORY,
        own: thickness,
    },
    Published {
        quantity: "Thickness, mm",
        region: Region::Heel,
        value: "12.5 to 24.5",
        conditions: "means of several studies with ultrasound, magnetic resonance or radiography, unloaded",
        source: "R. Naemi et al., Viscoelasticity in Foot-Ground Interaction, in: Viscoelastic and Viscoplastic Materials, InTech \
                 (2016), doi 10.5772/64170",
        own: thickness,
    },
    Published {
        quantity: "Thickness, mm",
        region: Region::Metatarsals12,
        value: "15.2 (mean)",
        conditions: ULTRASOUND,
        source: CAVANAGH,
        own: thickness,
    },
    Published {
        quantity: "Peak strain, %",
        region: Region::Metatarsals12,
        value: "45.7 (mean)",
        conditions: ULTRASOUND,
        source: CAVANAGH,
        own: |fit| {
            let strain = number(fit.fixed.compression(&fit.law, fit.area_max_m2) * 100.0);
            let origin = match fit.fixed.scale {
                Scale::PeakStrain(_) => "measured",
                Scale::Curvature(_) => "computed from a measured curvature by Eq. 14",
                Scale::Assumed(_) => "assumed",
                Scale::Searched(_) => "result of the search",
            };
            Some(format!("{strain}, {origin}"))
        },
    },
];

fn thickness(fit: &RegionFit) -> Option<String> {
    let source = if fit.fixed.is_thickness_measured { "measured" } else { "typical for the shoe size" };
    Some(format!("{}, {source}", number(fit.fixed.thickness_m * 1e3)))
}

/// The content of the section.
pub fn literature(study: &Study) -> Markup {
    html! {
        div.wide tabindex="0" role="region" aria-label="Published measurements" {
            table.words {
                caption { "Published measurements of feet without complaints, and the values of this person. None of them is a norm." }
                thead {
                    tr {
                        th scope="col" { "Quantity" }
                        th scope="col" { "Region" }
                        th scope="col" { "Published" }
                        th scope="col" { "This person" }
                        th scope="col" { "Conditions and source" }
                    }
                }
                tbody {
                    @for row in &PUBLISHED {
                        @let own = fitted(study).find(|(region, _)| *region == row.region as usize);
                        tr {
                            th scope="row" { (row.quantity) }
                            td { (TITLES[row.region as usize]) }
                            td.short { (row.value) }
                            td.short { (own.and_then(|(_, fit)| (row.own)(fit)).unwrap_or(NONE.into())) }
                            td.prose { (row.conditions) ". " cite { (row.source) } "." }
                        }
                    }
                }
            }
        }
        p {
            "Viscous modulus and dissipated energy are not comparable with published values of tissue, and therefore not listed: \
             area and force come from the same pressures, so a viscous pressure also increases the deformation that is computed \
             from the area, and both are smaller than those of the tissue."
        }
        (paper(study))
    }
}

/// Values that differ by at most this factor count as uniform.
const UNIFORM: f64 = 2.0;
/// Two radii count as close if they differ by at most this factor, and one is smaller than another one only if it is smaller by
/// more.
const CLOSE: f64 = 1.25;
/// The smallest number of fitted regions for a comparison with the findings of the paper.
const COMPARED_REGIONS: usize = 3;

/// A finding of the paper, and that of this fit.
struct Finding {
    /// The finding of the paper.
    paper: &'static str,
    /// The finding of this fit.
    here: String,
    outcome: Outcome,
}

/// The outcome of the comparison of two findings.
enum Outcome {
    Agrees,
    Contradicts,
    /// The fit has no value of the tissue that could be compared, for this reason.
    NotComparable(&'static str),
}

impl Outcome {
    fn of(agrees: bool) -> Self {
        if agrees { Self::Agrees } else { Self::Contradicts }
    }

    /// The outcome for a parameter of the force law, which is that of the tissue only if the area is that of the contact.
    fn of_law(study: &Study, agrees: bool) -> Self {
        match study.has_effective_area() {
            true => Self::NotComparable("effective area"),
            false => Self::of(agrees),
        }
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Agrees => f.write_str("Agrees."),
            Self::Contradicts => f.write_str("Contradicts."),
            Self::NotComparable(reason) => write!(f, "Not comparable: {reason}."),
        }
    }
}

/// What the paper finds about the parameters, and what this fit finds.
fn paper(study: &Study) -> Markup {
    let fits: Vec<(usize, &RegionFit)> = fitted(study).collect();
    if fits.len() < COMPARED_REGIONS {
        return html! { p { "Too few regions were fitted for a comparison with the findings of the paper." } };
    }
    let findings = [
        Some(vertical(&fits)),
        Some(round(&fits)),
        Some(uniform(study, &fits)),
        exponent(study, &fits),
        Some(positive(study, &fits)),
    ];
    html! {
        h3.spaced { "Findings of the paper" }
        ul.findings {
            @for Finding { paper, here, outcome } in findings.into_iter().flatten() {
                li {
                    strong { (outcome) } " "
                    "Paper: " (paper) " Here: " (here)
                }
            }
        }
        p {
            @if study.options.method == Method::Projection {
                "C follows from a measurement or an assumption, and k depends on C and d₀; A B, K and n follow from the force. "
            }
            "The paper's values of C and k follow from bounds and starting points of a search, because force does not determine them."
        }
    }
}

/// The largest divided by the smallest value.
fn largest_over_smallest(values: impl Iterator<Item = f64>) -> f64 {
    let [low, high] = values.fold([f64::MAX, f64::MIN], |[low, high], v| [low.min(v), high.max(v)]);
    high / low
}

/// The titles of the regions that satisfy a condition; "none" if there are none.
fn names(fits: &[(usize, &RegionFit)], of: impl Fn(&RegionFit) -> bool) -> String {
    let names: Vec<_> =
        fits.iter().filter(|(_, fit)| of(fit)).map(|(region, _)| TITLES[*region].to_lowercase()).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// The finding on C relative to A and B.
fn vertical(fits: &[(usize, &RegionFit)]) -> Finding {
    let ratio = |fit: &RegionFit| fit.ellipsoid.c_m / fit.ellipsoid.a_m.min(fit.ellipsoid.b_m);
    let ratios = fits.iter().map(|(_, fit)| ratio(fit)).fold([f64::MAX, f64::MIN], |[l, h], r| [l.min(r), h.max(r)]);
    Finding {
        paper: "C is significantly smaller than A and B.",
        here: format!(
            "C is {} to {} times the smaller of A and B; not smaller by a factor of {CLOSE}: {}.",
            number(ratios[0]),
            number(ratios[1]),
            names(fits, |fit| ratio(fit) * CLOSE >= 1.0)
        ),
        outcome: Outcome::of(ratios[1] * CLOSE < 1.0),
    }
}

/// The finding on the ratio of A and B. A/B is the shape of the contact within the region's borders, which the borders largely
/// determine, because the contact continues beyond them. So it neither agrees with a finding on the tissue nor contradicts it.
fn round(fits: &[(usize, &RegionFit)]) -> Finding {
    let is_long = |fit: &RegionFit| fit.fixed.aspect.ln().abs() > CLOSE.ln();
    let aspects =
        fits.iter().map(|(_, fit)| fit.fixed.aspect).fold([f64::MAX, f64::MIN], |[l, h], a| [l.min(a), h.max(a)]);
    Finding {
        paper: "A and B are close.",
        here: format!(
            "A / B is {} to {}; differing by more than a factor of {CLOSE}: {}.",
            number(aspects[0]),
            number(aspects[1]),
            names(fits, is_long)
        ),
        outcome: Outcome::NotComparable("shape of the contact within the region's borders"),
    }
}

/// The finding on the differences of k between regions.
fn uniform(study: &Study, fits: &[(usize, &RegionFit)]) -> Finding {
    let k = largest_over_smallest(fits.iter().map(|(_, fit)| fit.ellipsoid.k));
    let stiffness = largest_over_smallest(fits.iter().map(|(_, fit)| fit.law.stiffness_pa));
    Finding {
        paper: "the stiffness coefficient k is fairly uniform for all regions.",
        here: format!(
            "the largest k is {} times the smallest (a factor of up to {UNIFORM} counts as uniform), and the largest K, which does \
             not depend on C and d₀, is {} times the smallest.",
            number(k),
            number(stiffness)
        ),
        outcome: Outcome::of_law(study, k <= UNIFORM),
    }
}

/// The finding on the region with the highest n; `None` if no region of the metatarsals was fitted.
fn exponent(study: &Study, fits: &[(usize, &RegionFit)]) -> Option<Finding> {
    let is_metatarsal = |region: usize| [Region::Metatarsals12, Region::Metatarsals35].contains(&Region::ALL[region]);
    let largest = fits.iter().max_by(|a, b| a.1.law.n.total_cmp(&b.1.law.n)).map_or(0, |(region, _)| *region);
    fits.iter().any(|(region, _)| is_metatarsal(*region)).then(|| Finding {
        paper: "the stiffness exponent n is highest at the metatarsals.",
        here: format!("n is highest at: {}.", TITLES[largest].to_lowercase()),
        outcome: Outcome::of_law(study, is_metatarsal(largest)),
    })
}

/// The finding on the sign of n.
fn positive(study: &Study, fits: &[(usize, &RegionFit)]) -> Finding {
    Finding {
        paper: "n is positive.",
        here: format!("n is not positive at: {}.", names(fits, |fit| fit.law.n <= 0.0)),
        outcome: Outcome::of_law(study, fits.iter().all(|(_, fit)| fit.law.n > 0.0)),
    }
}
