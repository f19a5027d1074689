//! Shared parts of the tests: fixtures, a simulated NOR flash chip with power cuts, walks with sensor faults, and the firmware on
//! a host board in virtual time, with the real client at the other end of its links.

use critical_section as _; // links the host's implementation of the critical sections that the firmware uses

pub mod activity;
pub mod board;
pub mod executor;
pub mod faults;
pub mod fixtures;
pub mod host;
pub mod insole;
pub mod moticon;
pub mod power_cuts;
pub mod scenario;
pub mod store_script;
pub mod virtual_time;
pub mod walk;
pub mod wear;
pub mod world;

pub use fixtures::*;
pub use nor_flash;
