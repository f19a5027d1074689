//! Evaluation of the recordings of a study, one recording at a time, as rows of a table.
//!
//! [`fits::rows`] fits each step of one recording of a [`Person`]. It has no state, so any program can distribute the recordings
//! of a study: the command line over threads, or an engine such as Dask or Spark, which receives the rows through the Python
//! package. [`records`] and [`frames`] have the columns of steps and of frames, [`walk`] finds the steps from which the measures
//! of gait are computed, and [`table`] writes rows as Parquet. [`Search`], [`ContactOptions`] and [`StanceOptions`] are the
//! options. The settings of a participant, zero files (readings of the unloaded cells) and tissue measurements are read through a
//! [`ReadFile`], because the files of a study may be in object storage.

pub mod fits;
pub mod frames;
pub mod records;
pub mod table;
pub mod walk;

mod options;
mod person;

pub use options::{ContactOptions, Search, StanceOptions, virtual_insole};
pub use person::{Person, SETTINGS_FILE};

use std::io;
use std::path::Path;

/// A function that returns the content of a file. If there is no file, the error must be of the kind [`io::ErrorKind::NotFound`]:
/// [`Person::open`] then uses the default settings.
pub type ReadFile<'a> = &'a dyn Fn(&Path) -> io::Result<Vec<u8>>;
