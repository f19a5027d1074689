//! The report on a cohort as one picture.

use crate::cohort::{Cohort, by_size, participants, repeatability};
use crate::drawing::{Drawing, STYLE, legend_row};
use crate::format::count;
use crate::picture::{Result, render};
use fit::cohort::SizeGroup;
use fit::variable::Variable;
use maud::{Markup, PreEscaped, html};

// The following lengths are in units of the drawing. `HEADER`, `TITLE` and `LEGEND` are the heights of the header, of a title
// and of a row of a legend.
const MARGIN: f64 = 24.0;
const GAP: f64 = 18.0;
const HEADER: f64 = 70.0;
const TITLE: f64 = 26.0;
const LEGEND: f64 = 24.0;
/// Height of a row of the table of participants.
const ROW: f64 = 18.0;
/// Positions of the columns of the table of participants.
const COLUMNS: [f64; 6] = [0.0, 120.0, 210.0, 310.0, 420.0, 530.0];
/// Number of rows of the legend of the repeatability.
const LEGEND_ROWS: usize = 3;
/// Number of sizes in a row of the legend of the errors, and in one of a legend of charts.
const SIZES_OF_ERRORS: usize = 3;
const SIZES_OF_CHARTS: usize = 9;
/// Number of charts in a row.
const ACROSS: usize = 4;
const WIDTH: f64 = 2.0 * MARGIN + ACROSS as f64 * (by_size::WIDTH + GAP) - GAP;

/// The picture as PNG, with text in a font of the operating system.
///
/// # Errors
/// If no font is installed, or the drawing cannot be rendered or encoded.
pub fn png(cohort: &Cohort) -> Result<Vec<u8>> {
    render(svg(cohort))
}

/// The picture as SVG.
fn svg(cohort: &Cohort) -> Markup {
    let groups = SizeGroup::all(cohort.people);
    let rows = participants::rows(cohort.people);
    let table_y = HEADER + TITLE;
    let errors_y = table_y + (rows.len() + 1) as f64 * ROW + GAP;
    let errors = by_size::errors(&groups);
    let size_rows = groups.len().div_ceil(SIZES_OF_ERRORS).max(2) as f64;
    let feet: Vec<Drawing> = cohort.feet.iter().map(repeatability::chart).collect();
    let feet_height: f64 = feet.iter().map(|foot| foot.height + GAP).sum::<f64>() + LEGEND_ROWS as f64 * LEGEND;
    let errors_and_repeatability_height =
        (size_rows * LEGEND + errors.height + GAP).max(if feet.is_empty() { 0.0 } else { feet_height });
    let loads = Grid {
        y: errors_y + TITLE + errors_and_repeatability_height,
        charts: by_size::charts(&groups, Variable::loads()),
    };
    let quantities = Grid { y: loads.bottom(&groups), charts: by_size::charts(&groups, Variable::quantities()) };
    let parameters = Grid { y: quantities.bottom(&groups), charts: by_size::charts(&groups, Variable::parameters()) };
    let bottom = parameters.bottom(&groups);
    let steps: usize = cohort.people.iter().map(|person| person.steps).sum();
    html! {
        svg.drawing xmlns="http://www.w3.org/2000/svg" width=(WIDTH) height=(bottom) viewBox={ "0 0 " (WIDTH) " " (bottom) } {
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="#fff" {}
            text.heading x=(MARGIN) y="38" { "Plantar tissue of " (count(cohort.people.len(), "participant")) }
            text x=(MARGIN) y="57" {
                (count(steps, "step")) ", each fitted separately, contact from " (cohort.contact.on_kpa) " kPa; Plantar "
                (env!("PLANTAR_VERSION"))
            }
            (title("Participants by insole size, mean ± standard deviation (participants with a value, if not all)", MARGIN, HEADER))
            (table_row(&participants::TITLES, "strong", table_y))
            @for (i, row) in rows.iter().enumerate() { (table_row(row, "", table_y + (i + 1) as f64 * ROW)) }
            (title("Errors by region and insole size (number of participants)", MARGIN, errors_y))
            @for (i, entries) in by_size::legend(&groups).chunks(SIZES_OF_ERRORS).enumerate() {
                (legend_row(entries, MARGIN, errors_y + TITLE + i as f64 * LEGEND))
            }
            (errors.at(MARGIN, errors_y + TITLE + size_rows * LEGEND))
            @if !feet.is_empty() { (repeated(&feet, errors_y)) }
            (loads.svg("Measured loads by region and insole size", &groups))
            (quantities.svg("Mechanical quantities by region and insole size", &groups))
            (parameters.svg("Parameters by region and insole size", &groups))
        }
    }
}

/// The charts of the repeatability of each foot, with their legend, beside the errors.
fn repeated(feet: &[Drawing], y: f64) -> Markup {
    let x = WIDTH - MARGIN - repeatability::WIDTH;
    let entries = repeatability::legend();
    let mut top = y + TITLE + LEGEND_ROWS as f64 * LEGEND;
    html! {
        (title("Repeatability between trials", x, y))
        @for (i, entries) in entries.chunks(entries.len().div_ceil(LEGEND_ROWS)).enumerate() {
            (legend_row(entries, x, y + TITLE + i as f64 * LEGEND))
        }
        @for foot in feet {
            (foot.at(x, top))
            @let () = top += foot.height + GAP;
        }
    }
}

fn title(text: &str, x: f64, y: f64) -> Markup {
    html! { text.title x=(x) y=(y + 14.0) { (text) } }
}

fn table_row<Text: AsRef<str>>(row: &[Text; 6], class: &str, y: f64) -> Markup {
    html! {
        @for (text, x) in row.iter().zip(COLUMNS) { text class=(class) x=(MARGIN + x) y=(y + 12.0) { (text.as_ref()) } }
    }
}

/// A title, the legend of the sizes, and charts in rows.
struct Grid {
    y: f64,
    charts: Vec<Drawing>,
}

impl Grid {
    fn bottom(&self, groups: &[SizeGroup]) -> f64 {
        let rows = self.charts.len().div_ceil(ACROSS) as f64;
        self.charts_y(groups) + rows * (by_size::height(groups) + GAP) + GAP
    }

    /// The upper edge of the charts, below the legend.
    fn charts_y(&self, groups: &[SizeGroup]) -> f64 {
        self.y + TITLE + groups.len().div_ceil(SIZES_OF_CHARTS).max(1) as f64 * LEGEND
    }

    fn svg(&self, text: &str, groups: &[SizeGroup]) -> Markup {
        html! {
            (title(text, MARGIN, self.y))
            @for (i, entries) in by_size::legend(groups).chunks(SIZES_OF_CHARTS).enumerate() {
                (legend_row(entries, MARGIN, self.y + TITLE + i as f64 * LEGEND))
            }
            @for (i, chart) in self.charts.iter().enumerate() {
                @let (x, y) = ((i % ACROSS) as f64 * (by_size::WIDTH + GAP), (i / ACROSS) as f64 * (by_size::height(groups) + GAP));
                (chart.at(MARGIN + x, self.charts_y(groups) + y))
            }
        }
    }
}
