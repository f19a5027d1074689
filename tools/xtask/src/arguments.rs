//! The arguments of `cargo xtask`.

use crate::BOARDS;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Duration of fuzzing in `cargo xtask test`, min.
pub const FUZZ_MINUTES: f64 = 2.0;

/// The tasks of this repository.
#[derive(Parser)]
#[command(bin_name = "cargo xtask")]
pub struct Arguments {
    #[command(subcommand)]
    pub task: Task,
}

#[derive(Subcommand)]
pub enum Task {
    /// Install missing programs and data: Rust targets, QEMU, Node.js, Chromium, a C++ compiler, D-Bus, private copies of
    /// cargo-fuzz and cargo-deny, and a private Python with NumPy, SciPy, bumble and the sample walk.
    Setup,
    /// Build the firmware of all boards and the command line.
    Build,
    /// Build the page for a phone to tools/phone/dist.
    Page,
    /// Identify a walker's parameters from some steps, send them to the firmware in QEMU and play other steps through it, live in
    /// the terminal; then print a table of the steps and serve the page with the same walk.
    Demo(Demo),
    /// Run everything that continuous integration runs.
    Test {
        /// Run only format, lints and host tests, for use after each change. Tests that need firmware, emulator, page, Python or
        /// data are reported as ignored.
        #[arg(long)]
        quick: bool,
    },
    /// Feed every parser with arbitrary bytes. The task ends at the first input that makes a parser fail.
    Fuzz {
        /// Time for all targets together.
        #[arg(long, value_name = "N", default_value_t = FUZZ_MINUTES)]
        minutes: f64,
    },
    /// Test endurance: loss of power in every write, bit errors on the cable, a day of walking. The test takes about an hour.
    Soak(Soak),
    /// Compare the dependencies with RustSec's advisories, which are downloaded from their repository.
    Advisories,
    /// Measure instructions per frame, accuracy, bytes, replay speed, identification and sizes.
    Bench(Json),
    /// Measure flash and RAM of the firmware of all boards.
    Size(Json),
    /// Print the source locations of the calls in an insole's crash report, "panic after ... at ...". The firmware on the insole
    /// must be the last build in this repository.
    Explain {
        /// The board that sent the report.
        #[arg(value_parser = BOARDS)]
        board: String,
        /// The crash report, or only its addresses, innermost call first.
        #[arg(required = true)]
        text: Vec<String>,
    },
    /// Write bootloader and firmware to an STM32WB55 on a debug probe and show the log (needs probe-rs).
    Flash,
    /// Build and sign the firmware of a board, for `plantar update`.
    Image(Image),
    /// Make a key for signing firmware, and print how to build firmware that accepts it.
    Key {
        /// The file for the secret key; it must not exist yet.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

#[derive(Args)]
pub struct Demo {
    /// Play this recording instead of the sample walk.
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,
    /// Play in real time (real), or as fast as the emulator runs (max).
    #[arg(long, default_value = "real", value_parser = ["real", "max"])]
    pub speed: String,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Write the steps and the counters of the live frames to this file; the page is not served then.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// End after the table: neither build nor serve the page. This is the default where stdout is no terminal.
    #[arg(long)]
    pub no_page: bool,
}

#[derive(Args)]
pub struct Soak {
    /// Run only a small part of each test, which takes some minutes.
    #[arg(long)]
    pub short: bool,
    /// Also write the figures to this file, one flat JSON object.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Args)]
pub struct Json {
    /// Also write the figures to this file, one flat JSON object.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Args)]
pub struct Image {
    /// The board.
    #[arg(value_parser = BOARDS)]
    pub board: String,
    /// The file of the secret key [default: the published key for development].
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// The image to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}
