//! The tasks of this repository: set-up, builds, demonstration, tests and benchmarks, each as one command.

mod arguments;
mod assure;
mod bench;
mod build;
mod command;
mod demo;
mod fuzz;
mod hardware;
mod image;
mod licences;
mod limits;
mod package;
mod page;
mod provenance;
mod setup;
mod test;

use arguments::{Arguments, Task};
use clap::Parser;
use std::process::ExitCode;

/// The compilation target of the boards.
pub const TARGET: &str = "thumbv7em-none-eabihf";
/// The boards. A board's name is the name of its folder in `boards`, of its package and of its executable. The package of its
/// bootloader has the suffix `-bootloader`.
pub const BOARDS: [&str; 3] = [EMULATED, WB55, NRF52840];
/// The board that runs in the emulator.
pub const EMULATED: &str = "emulated";
/// The reference board.
pub const WB55: &str = "wb55";
/// The board with an nRF52840.
pub const NRF52840: &str = "nrf52840";

fn main() -> ExitCode {
    let result = match Arguments::parse().task {
        Task::Setup => setup::all(),
        Task::Build => build::all(),
        Task::Page => page::build(),
        Task::Demo(demo) => demo.run(),
        Task::Test { quick: true } => test::quick(),
        Task::Test { quick: false } => test::all(),
        Task::Fuzz { minutes } => fuzz::run(minutes),
        Task::Soak(soak) => soak.run(),
        Task::Assure(assure) => assure.run(),
        Task::Advisories => test::deny(&["advisories"]),
        Task::Reproduce => provenance::reproduce(),
        Task::Sbom { out } => provenance::write_sboms(&out),
        Task::Licences { out } => licences::write(&out),
        Task::Bench(file) => bench::bench().and_then(|figures| file.write(&figures)),
        Task::Size(file) => bench::sizes().and_then(|figures| file.write(&figures)),
        Task::Hardware(file) => hardware::run(&file),
        Task::Explain { board, text } => image::explain(&board, &text.join(" ")),
        Task::Flash { board } => build::flash(&board),
        Task::Image(image) => image.make(),
        Task::Key { out } => image::make_key(&out),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
