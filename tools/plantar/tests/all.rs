//! All integration tests of the command line in one program: each program of its own would have to be linked with the same
//! libraries.

mod bluetooth;
#[cfg(all(target_os = "linux", feature = "ble"))]
mod bluez;
mod board;
mod calibrate;
mod cells;
mod cli;
mod cohort;
mod export;
mod fit;
mod gait;
mod identify;
mod import;
mod lost;
mod lsl;
mod monitor;
mod params;
#[cfg(all(target_os = "linux", feature = "ble"))]
mod radio;
mod repeat;
mod tissue;
mod update;
