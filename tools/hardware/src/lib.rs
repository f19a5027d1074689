//! The reference board: its netlist, and the bill of materials, the schematic and the simulations of its analogue front end in
//! ngspice, which are made from the netlist.

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
