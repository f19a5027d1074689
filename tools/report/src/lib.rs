//! The reports on the identification of one person's parameters and on a cohort, for readers who assess the identification: each
//! is available as a self-contained web page and as a picture. There is also a picture of a single step, and a web page on the
//! calibration of an insole. This crate writes no files, and reads only the fonts of the operating system.
//!
//! Each figure is drawn once, as SVG with CSS classes for colours: the page shows it in light, dark and print colours, the
//! picture in light ones. The SVG is written directly, because chart libraries round positions to whole pixels and fix the
//! colours.

mod region;
mod format;
pub mod drawing;
mod foot;
mod curves;
mod bars;
mod intervals;
mod scale_sources;
mod quantities;
mod parameters;
mod sensitivity;
mod literature;
mod protocol;
mod how_to_read;
mod document;
mod page;
mod cohort;
mod calibration;
#[cfg(feature = "png")]
mod picture;
mod step;

pub use calibration::html as calibration_html;
#[cfg(feature = "png")]
pub use cohort::png as cohort_png;
pub use cohort::{Cohort, html as cohort_html};
#[cfg(feature = "png")]
pub use picture::{Error, Result, png};
pub use step::{Forces, StepPicture};

use fit::Study;

/// The report as one HTML file, which loads no other resource and contains no scripts. `study` is the identification of one
/// person's parameters; without steps or without a fit the report is incomplete, but valid.
pub fn html(study: &Study) -> String {
    page::page(study).into_string()
}
