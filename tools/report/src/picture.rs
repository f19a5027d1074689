//! The report as one picture with foot, forces, errors and parameters.

use crate::drawing::{Drawing, STYLE, legend_row};
use crate::format::count;
use crate::region::{TITLES, fitted};
use crate::{bars, curves, foot, intervals, parameters};
use fit::Study;
use maud::{Markup, PreEscaped, html};
use resvg::{tiny_skia, usvg};
use std::sync::Arc;

/// The reason why the picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No font is installed, so text cannot be drawn.
    #[error(
        "no fonts are installed, so the picture would have no text; install fonts, for example fonts-dejavu-core on Debian"
    )]
    NoFonts,
    /// The drawing is not valid.
    #[error("cannot draw the picture: {0}")]
    Drawing(#[from] usvg::Error),
    /// The drawing has no size, or the PNG could not be encoded.
    #[error("cannot encode the picture: {0}")]
    Encoding(String),
}

/// The result of making a picture.
pub type Result<T> = std::result::Result<T, Error>;

/// Pixels per unit of the drawing.
const PIXELS: f32 = 2.0;
// The following lengths are in units of the drawing.
const MARGIN: f64 = 24.0;
const GAP: f64 = 18.0;
const HEADER: f64 = 70.0;
/// Height of the title above a panel.
const TITLE: f64 = 22.0;
/// Height of a row of a legend.
const LEGEND: f64 = 28.0;

/// The picture as PNG, with text in a font of the operating system.
///
/// # Errors
/// If no font is installed, or the drawing cannot be rendered or encoded.
pub fn png(study: &Study) -> Result<Vec<u8>> {
    render(svg(study))
}

/// Converts a picture from SVG to PNG.
///
/// # Errors
/// As [`png`].
pub fn render(svg: Markup) -> Result<Vec<u8>> {
    let options = usvg::Options { fontdb: Arc::new(fonts()?), ..usvg::Options::default() };
    let tree = usvg::Tree::from_str(&svg.into_string(), &options)?;
    let size = tree.size().to_int_size().scale_by(PIXELS);
    let pixels = size.and_then(|size| tiny_skia::Pixmap::new(size.width(), size.height()));
    let mut pixels = pixels.ok_or_else(|| Error::Encoding("the drawing has no size".into()))?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(PIXELS, PIXELS), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| Error::Encoding(error.to_string()))
}

/// The fonts of the operating system, with an installed one as the default sans-serif font.
fn fonts() -> Result<usvg::fontdb::Database> {
    const PLAIN: [&str; 6] = ["DejaVu Sans", "Noto Sans", "Liberation Sans", "Arial", "Helvetica", "Segoe UI"];
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_system_fonts();
    let names = || fonts.faces().flat_map(|face| &face.families).map(|(name, _)| name);
    let known = PLAIN.into_iter().find(|plain| names().any(|name| name == plain)).map(String::from);
    let plain = known.or_else(|| names().next().cloned()).ok_or(Error::NoFonts)?;
    fonts.set_sans_serif_family(plain);
    Ok(fonts)
}

/// The picture as SVG.
fn svg(study: &Study) -> Markup {
    let foot = foot::foot(study);
    let foot_width = foot.as_ref().map_or(0.0, |foot| foot.width + 2.0 * GAP);
    let force_grid = Grid { x: MARGIN + foot_width, y: HEADER + LEGEND, height: TITLE + curves::FORCE_HEIGHT + GAP };
    let foot_bottom = HEADER + foot.as_ref().map_or(0.0, |foot| foot.height) + GAP;
    let lower = (force_grid.y + 3.0 * force_grid.height).max(foot_bottom + 2.0 * LEGEND) + GAP;
    let (bars, charts) = (bars::bars(study), parameters::charts(study));
    // The legend of the parameters has two rows.
    let parameter_grid =
        Grid { x: MARGIN + bars.width + 3.0 * GAP, y: lower + 2.0 * LEGEND, height: intervals::HEIGHT + GAP };
    let width = force_grid.width().max(parameter_grid.width());
    let height = (lower + LEGEND + bars.height).max(parameter_grid.y + 2.0 * parameter_grid.height) + MARGIN;
    let sum = curves::Sum::of(study);
    html! {
        svg.drawing xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } {
            style { (PreEscaped(STYLE)) }
            rect width="100%" height="100%" fill="#fff" {}
            text.heading x=(MARGIN) y="38" { "Plantar tissue of " (printable(&study.participant)) }
            text x=(MARGIN) y="57" {
                (fitted(study).count()) " of 8 regions fitted, " (count(study.steps.len(), "step"))
                ", contact from " (study.contact.on_kpa) " kPa; Plantar " (env!("PLANTAR_VERSION"))
            }
            @if let Some(foot) = &foot {
                (foot.at(MARGIN, HEADER))
                @for (i, item) in foot::legend().iter().enumerate() { (item.at(MARGIN, foot_bottom + 22.0 * i as f64)) }
            }
            (legend_row(&curves::legend(), force_grid.x, HEADER))
            @for region in 0..8 {
                @let force = curves::force(study, region, &curves::Typical::of(study, region));
                (force_grid.panel(region, TITLES[region], &force))
            }
            (force_grid.panel(8, "Sum of the regions", &curves::sum(study, sum.as_ref())))
            (legend_row(&bars::legend(), MARGIN, lower))
            (bars.at(MARGIN, lower + LEGEND))
            @for (i, entries) in parameters::legend(study).chunks(3).enumerate() {
                (legend_row(entries, parameter_grid.x, lower + i as f64 * LEGEND))
            }
            @for (i, chart) in charts.iter().enumerate() { (parameter_grid.panel(i, "", chart)) }
        }
    }
}

/// A grid of panels, three in a row.
struct Grid {
    x: f64,
    y: f64,
    height: f64,
}

impl Grid {
    fn width(&self) -> f64 {
        self.x + 3.0 * curves::WIDTH + 2.0 * GAP + MARGIN
    }

    fn panel(&self, i: usize, title: &str, drawing: &Drawing) -> Markup {
        let (x, y) = (self.x + (i % 3) as f64 * (curves::WIDTH + GAP), self.y + (i / 3) as f64 * self.height);
        let below = if title.is_empty() { y } else { y + TITLE };
        html! {
            text.title x=(x + 2.0) y=(y + 13.0) { (title) }
            (drawing.at(x, below))
        }
    }
}

/// Removes control characters, which XML does not allow.
fn printable(name: &str) -> String {
    name.chars().filter(|c| !c.is_control()).collect()
}
