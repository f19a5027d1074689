//! Signs firmware, makes keys, and inspects ELF files of firmware. `cargo xtask` runs this program.

mod explain;
mod segments;
mod sign;
mod size;

use clap::{Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Signs firmware, makes keys, and inspects firmware files.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Sign firmware for `plantar update`.
    Sign {
        /// The firmware, an ELF file from the linker.
        firmware: PathBuf,
        /// The file of the secret key [default: the published key for development].
        #[arg(long, value_name = "FILE")]
        key: Option<PathBuf>,
        /// The image to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Make a key for signing firmware.
    Key {
        /// The file for the secret key; it must not exist yet.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Print two numbers: the bytes of firmware in flash, and the bytes of its variables in RAM.
    Size {
        /// The firmware, an ELF file from the linker.
        firmware: PathBuf,
    },
    /// Write the loaded segments of firmware to a file, to compare two builds.
    Segments {
        /// The firmware, an ELF file from the linker.
        firmware: PathBuf,
        /// The file to write.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Print the source locations of the calls in an insole's crash report.
    Explain {
        /// The firmware, an ELF file from the linker.
        firmware: PathBuf,
        /// The crash report, or only its addresses.
        #[arg(required = true)]
        text: Vec<String>,
    },
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Sign { firmware, key, out } => sign::sign(&firmware, key.as_deref(), &out),
        Command::Key { out } => sign::make_key(&out),
        Command::Size { firmware } => {
            size::of(&firmware).map(|size| println!("{} {}", size.flash_bytes, size.ram_bytes))
        }
        Command::Segments { firmware, out } => segments::write(&firmware, &out),
        Command::Explain { firmware, text } => explain::run(&firmware, &text.join(" ")),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
