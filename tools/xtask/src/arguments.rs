//! The arguments of `cargo xtask`.

use crate::build::CHIPS;
use crate::{BOARDS, WB55};
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// The tasks of this repository.
#[derive(Parser)]
#[command(bin_name = "cargo xtask")]
pub struct Arguments {
    #[command(subcommand)]
    pub task: Task,
}

#[derive(Subcommand)]
pub enum Task {
    /// Install missing programs and data: Rust targets, QEMU, ngspice, Node.js, Chromium, D-Bus, GNU Octave, private copies of
    /// cargo-deny, cargo-nextest and libclang, private Python environments, and recorded walks.
    Setup,
    /// Build the firmware of all boards and the command line.
    Build,
    /// Build the page for a phone in tools/phone/dist.
    Page,
    /// Show a walk on the emulated insole: play it into the sensor matrix of the firmware in QEMU, show the loads live in the
    /// terminal, identify the walker's parameters from the first 24 steps, and send them to the insole. Then print a table of the
    /// later steps, and serve the page for a phone with the same walk.
    Demo(Demo),
    /// Run everything that continuous integration runs, except the proofs with Kani.
    Test {
        /// Check only the format and the lints, and run only the host tests, for use after each change. Tests that need the
        /// firmware, the emulator, the page, Python or data are skipped and counted.
        #[arg(long)]
        quick: bool,
    },
    /// Feed every parser with arbitrary bytes. If an input makes a parser fail, all other targets run nevertheless, and the task
    /// fails at the end and names the input.
    Fuzz {
        /// Time for all fuzz targets together, minutes of one core. As many targets run at the same time as there are cores.
        #[arg(long, value_name = "N", default_value_t = 10.0)]
        minutes: f64,
    },
    /// Test the endurance: power cuts in every write and erase operation, bit errors on the cable, and a day of walking. The test
    /// takes about an hour.
    Soak(Soak),
    /// Assess how thorough the tests are: check properties of the core (the library in src) for all inputs within larger bounds
    /// than `test`, try the orders in which the firmware's loops interrupt each other, skip instructions while a wrong
    /// signature is verified, look for undefined behaviour, and measure the share of the core's lines that tests execute and
    /// the share of changes to protocol, storage, update and supervision that tests notice. The task takes hours, and installs
    /// the programs that it needs.
    Assure(Assure),
    /// Compare the dependencies with RustSec's database of known vulnerabilities, which is downloaded.
    Advisories,
    /// Build the firmware of all boards twice, in two copies of the last commit in different folders, and compare the bytes
    /// that both builds load into flash. The task compiles everything twice.
    Reproduce,
    /// Write software bills of materials in CycloneDX's JSON format, for the firmware of each board and for the command line.
    Sbom {
        /// The folder for the files.
        #[arg(long, value_name = "FOLDER")]
        out: PathBuf,
    },
    /// Write the licences of the libraries that firmware, command line, Python package and page contain: THIRD-PARTY.txt and, for
    /// Rust's standard library, RUST-LIBRARY.html.
    Licences {
        /// The folder for the files.
        #[arg(long, value_name = "FOLDER")]
        out: PathBuf,
    },
    /// Measure the instructions for a frame, the accuracy of steps, the lengths of messages, the speed of a replay, the accuracy
    /// and speed of the identification, the page, and the sizes of the firmware.
    Bench(FiguresFile),
    /// Measure the flash and RAM that the firmware of each board needs.
    Size(FiguresFile),
    /// Simulate the analogue front end of the reference board in ngspice, and write its bill of materials, schematic, plots and
    /// figures to the folder hardware. The task fails if a figure is outside of its limit.
    Hardware(FiguresFile),
    /// Print the source locations of the calls in an insole's crash report, "panic after ... at ...". The firmware that crashed
    /// must be the last build in this repository.
    Explain {
        /// The board that sent the report.
        #[arg(value_parser = BOARDS)]
        board: String,
        /// The crash report, or only its addresses, innermost call first.
        #[arg(required = true)]
        text: Vec<String>,
    },
    /// Write bootloader and firmware to a board through a debug probe, and show its log (needs probe-rs).
    Flash {
        /// The board.
        #[arg(default_value = WB55, value_parser = CHIPS.map(|(board, _)| board))]
        board: String,
    },
    /// Build and sign the firmware of a board, for `plantar update`.
    Image(Image),
    /// Make a key for signing firmware, and print how to build firmware that accepts this key.
    Key {
        /// The file for the secret key; it must not exist yet.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
}

#[derive(Args)]
pub struct Demo {
    /// Play this recording instead of the sample walk. No parameters are identified from it; the insole has typical ones.
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,
    /// Play in real time (real), or as fast as the emulator runs (max).
    #[arg(long, default_value = "real", value_parser = ["real", "max"])]
    pub speed: String,
    /// End the walk after this number of steps. In the sample walk, only steps after the identification count.
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Write the steps and the counters of the live frames to this JSON file. The page is then not served.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// End after the table: neither build nor serve the page. This is the default if stdout is not a terminal.
    #[arg(long)]
    pub no_page: bool,
}

#[derive(Args)]
pub struct Soak {
    /// Run only a small part of each test. This takes a few minutes.
    #[arg(long)]
    pub short: bool,
    /// Also write the figures to this file, as one JSON object with a number for each key.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Args)]
pub struct Assure {
    /// Test one in N of the changes, and skip instructions at one in N places of the signature check. Testing all changes takes
    /// about five hours on two idle cores.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    #[command(flatten)]
    pub figures: FiguresFile,
}

#[derive(Args)]
pub struct FiguresFile {
    /// Also write the figures to this file, as one JSON object with a number for each key.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Args)]
pub struct Image {
    /// The board that the image is for.
    #[arg(value_parser = BOARDS)]
    pub board: String,
    /// The file of the secret key [default: the published key for development].
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// The image to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}
