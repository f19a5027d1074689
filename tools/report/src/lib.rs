//! The report of one person's identification, for people who judge it: a web page without anything from outside, and a
//! picture. Neither reads nor writes a file.
//!
//! Every figure is drawn once, as SVG whose colours are classes: the page shows them in light, dark and print, the picture in
//! light. They are written directly and not through a chart library: its SVG has whole pixels and fixed colours.
#![warn(missing_docs)]

mod region;
mod format;
mod drawing;
mod foot;
mod curves;
mod bars;
mod parameters;
mod protocol;
mod reading;
mod page;
#[cfg(feature = "png")]
mod picture;
mod step;

#[cfg(feature = "png")]
pub use picture::{Error, Result, png};
pub use step::{Forces, StepPicture};

use fit::Study;

/// The report as one HTML file: nothing is loaded, nothing runs. A study without steps or before its fit still gives one.
pub fn html(study: &Study) -> String {
    page::page(study).into_string()
}
