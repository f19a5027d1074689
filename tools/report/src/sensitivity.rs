//! How the main results depend on the choices of the method.

use crate::format::{NONE, number, percent};
use crate::region::{TITLES, fit_of};
use fit::Study;
use fit::sensitivity::{MainResults, Sensitivity, Variant};
use maud::{Markup, html};

/// A main result.
struct Shown {
    title: &'static str,
    value: fn(&MainResults) -> Option<f64>,
    /// True for an error (NRMSE): its change is a difference, and that of the other results is relative.
    is_error: bool,
}

const SHOWN: [Shown; 4] = [
    Shown { title: "Force at 70 % of the largest area, N", value: |r| r.force_at_area_n, is_error: false },
    Shown { title: "Area at 50 % of the peak force, mm²", value: |r| r.area_at_half_force_mm2, is_error: false },
    Shown { title: "Secant stiffness at 20 % strain, N/mm", value: |r| r.secant_stiffness_n_mm, is_error: false },
    Shown { title: "Error of predicted steps, % of the peak force", value: |r| r.predicted_nrmse, is_error: true },
];

impl Shown {
    /// The change from the fit, with the value `from`, to a variant, as a fraction.
    fn change(&self, from: Option<f64>, variant: &Variant, region: usize) -> Option<f64> {
        let to = (self.value)(variant.regions[region].as_ref()?)?;
        Some(if self.is_error { to - from? } else { to / from? - 1.0 })
    }

    fn table(&self, study: &Study, sensitivity: &Sensitivity) -> Markup {
        let fits: Vec<_> = (0..8).map(|region| fit_of(study, region).ok().map(MainResults::of)).collect();
        let from = |region: usize| fits[region].as_ref().and_then(self.value);
        let unit = if self.is_error { "change in percentage points" } else { "change in %" };
        html! {
            div.wide tabindex="0" role="region" aria-label=(self.title) {
                table.dense.regions.changes {
                    caption { strong { (self.title) } ": as fitted, and " (unit) " with another choice" }
                    thead { tr { th scope="col" { "Choice" } @for title in TITLES { th scope="col" { (title) } } } }
                    tbody {
                        tr {
                            th scope="row" { "as fitted" }
                            @for region in 0..8 {
                                td { (from(region).map_or(NONE.into(), |v| if self.is_error { percent(v) } else { number(v) })) }
                            }
                        }
                        @for variant in &sensitivity.variants {
                            tr {
                                th scope="row" { (variant.choice) }
                                @for region in 0..8 { (cell(self.change(from(region), variant, region), self.is_error)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Larger changes are printed in bold. The limits are fractions: the first for a relative change, the second for the difference
/// of an error.
const LARGE: [f64; 2] = [0.2, 0.02];

fn cell(change: Option<f64>, is_error: bool) -> Markup {
    let large = LARGE[usize::from(is_error)];
    let text = change.map_or(NONE.into(), |change| {
        let digits = usize::from(is_error);
        let rounded = format!("{:+.digits$}", change * 100.0);
        if rounded.trim_start_matches(['+', '-']).parse() == Ok(0.0) { "0".into() } else { rounded.replace('-', "−") }
    });
    html! { td { @if change.is_some_and(|change| change.abs() > large) { strong { (text) } } @else { (text) } } }
}

/// The content of the section.
pub fn sensitivity(study: &Study) -> Markup {
    let Some(sensitivity) = &study.sensitivity else {
        return html! {
            p {
                "The fit was not repeated with other choices of the method. `plantar fit --report` repeats it, with the same \
                 recordings."
            }
        };
    };
    html! {
        @if !sensitivity.variants.is_empty() {
            p {
                "The fit was repeated with other choices of the method. A result that hardly changes does not depend on the \
                 choice; one that changes may be compared only between fits with the same choice. Changes of more than "
                (LARGE[0] * 100.0) " %, and of errors of more than " (LARGE[1] * 100.0) " percentage points, are bold."
            }
        }
        @for sentence in &sensitivity.skipped { p { (sentence) } }
        @if !sensitivity.variants.is_empty() { @for shown in &SHOWN { (shown.table(study, sensitivity)) } }
    }
}
