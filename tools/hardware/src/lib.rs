//! The reference board as a program: its netlist, and what follows from it: the bill of materials, the schematic, and simulations
//! of the analogue front end in ngspice.

pub mod data_sheet;
pub mod parts;
pub mod netlist;
pub mod spice;
pub mod ngspice;
pub mod analyses;
pub mod figures;
pub mod schematic;
pub mod plots;
pub mod files;
