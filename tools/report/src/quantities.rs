//! The mechanical quantities by region, which can be compared between recordings and people.

use crate::drawing::{self, Drawing};
use crate::format::number;
use crate::intervals::{IntervalChart, Mark, Row, unfitted};
use crate::region::{TITLES, fit_of, fitted};
use fit::Study;
use fit::measures::{Measure, Quantity};
use maud::{Markup, html};

/// The quantities that are drawn; the table contains all.
const DRAWN: [Quantity; 6] = [
    Quantity::ForceAtArea,
    Quantity::AreaAtForce(0.5),
    Quantity::SecantStiffness,
    Quantity::SecantModulus,
    Quantity::ViscousModulus,
    Quantity::DissipatedEnergy,
];

/// Name and unit of a quantity.
fn title(quantity: Quantity) -> String {
    let (name, unit) = quantity.title();
    let (first, rest) = name.split_at(1);
    format!("{}{rest}, {}", first.to_uppercase(), unit.replace("mm2", "mm²"))
}

/// One chart for each of the main quantities.
pub fn charts(study: &Study) -> impl Iterator<Item = Drawing> {
    DRAWN.into_iter().map(|quantity| {
        let row = |region: usize| match fit_of(study, region).map(|fit| fit.measure(quantity)) {
            Ok(Some(measure)) => Row::Value {
                value: measure.value,
                mark: if measure.interval.is_none() || measure.is_determined() {
                    Mark::Point
                } else {
                    Mark::Undetermined
                },
                broad: measure.interval,
                thin: None,
            },
            Ok(None) if matches!(quantity, Quantity::AreaAtForce(_)) => Row::Text("not reached by the model".into()),
            Ok(None) => Row::Text("20 % strain is not reached".into()),
            Err(reason) => unfitted(&reason),
        };
        let title = title(quantity);
        let is_logarithmic = quantity != Quantity::DissipatedEnergy;
        IntervalChart { title, is_logarithmic, rows: std::array::from_fn(row) }.draw()
    })
}

/// The legend of the marks.
pub fn legend() -> Vec<Drawing> {
    drawing::legend_entries([
        (Mark::Point.at(12.0, 9.0), "value"),
        (Mark::Undetermined.at(12.0, 9.0), "not determined"),
        (html! { path.jacobian d="M0 9h24" {} }, "95 % interval"),
        (html! { path.fill d="M9 9l5 -3v6z" {} }, "beyond the axis"),
    ])
}

/// The table of all quantities: a row for each quantity, and a column for each region.
pub fn table(study: &Study) -> Markup {
    let has_value = |quantity: &Quantity| fitted(study).any(|(_, fit)| fit.measure(*quantity).is_some());
    html! {
        table.dense.regions #quantities-table {
            caption {
                "Value with 95 % interval. Not determined: the interval is wider than the value. Stiffness, moduli and \
                 energies depend on d₀ and C, which are fixed by other data; forces at areas and areas at forces do not. A \
                 negative dissipated energy means that the same area carries more force in unloading than in loading, which \
                 is no property of tissue."
            }
            thead { tr { th scope="col" { "Quantity" } @for region in 0..8 { th scope="col" { (TITLES[region]) } } } }
            tbody {
                @for quantity in Quantity::all().filter(has_value) {
                    tr {
                        th scope="row" { (title(quantity)) }
                        @for region in 0..8 { td { (cell(fit_of(study, region).ok().and_then(|fit| fit.measure(quantity)))) } }
                    }
                }
            }
        }
    }
}

fn cell(measure: Option<&Measure>) -> Markup {
    html! {
        @match measure {
            None => "–",
            Some(measure) => @match measure.interval {
                None => (number(measure.value)),
                Some([low, high]) if measure.is_determined() => {
                    (number(measure.value)) br; span.range { "(" (number(low)) " to " (number(high)) ")" }
                },
                Some(_) => span.undetermined { "not determined" },
            },
        }
    }
}
