//! The netlist of the reference board: every part, and the net of each of its pins. Bill of materials, schematic and simulation
//! are made from it.

use crate::parts::{
    BUFFER, BULK, CAPACITOR_47P, CAPACITOR_330P, CONNECTOR, CONTROLLER, DECODER, DECOUPLING, DIVIDER_LOWER,
    DIVIDER_UPPER, FEEDBACK, FILTER, FLASH, LOAD_SWITCH, ON_PULL_UP, PULL_UP, PartType, QUAD, RESISTOR_10K, ROW_SWITCH,
    SERIES, SHEET, SIDE,
};
use plantar::firmware::layout::{COLUMNS, ROWS};
use std::collections::BTreeMap;

/// Ground.
pub const GROUND: &str = "GND";
/// The controller's supply.
pub const SUPPLY: &str = "3V3";
/// The front end's supply, behind the load switch.
pub const SWITCHED: &str = "3V3_FE";
/// The virtual ground.
pub const REFERENCE: &str = "VREF";

/// A part on the board.
#[derive(Clone, Debug)]
pub struct Part {
    /// The reference designator.
    pub designator: String,
    /// The type.
    pub kind: &'static PartType,
    /// The net of each pin, in the order of the type's pins.
    pub nets: Vec<String>,
}

impl Part {
    /// The net of the pin with this name.
    ///
    /// # Panics
    /// If the part has no such pin.
    pub fn net(&self, pin: &str) -> &str {
        let index = self.kind.pins.iter().position(|(_, name)| *name == pin);
        &self.nets[index.unwrap_or_else(|| panic!("{} has no pin {pin}", self.designator))]
    }
}

/// The board.
#[derive(Clone, Debug)]
pub struct Netlist {
    /// All parts.
    pub parts: Vec<Part>,
}

/// The net of a column line.
pub fn column_net(column: usize) -> String {
    format!("COL{column}")
}

/// The net of a row line.
pub fn row_net(row: usize) -> String {
    format!("ROW{row}")
}

/// The net of the converter's input for a column.
pub fn input_net(column: usize) -> String {
    format!("IN{}", column + 1)
}

/// The net of the gate of a row's switch.
pub fn gate_net(row: usize) -> String {
    format!("GATE{row}")
}

/// Designator and unit of a column's amplifier.
pub fn amplifier(column: usize) -> (String, &'static str) {
    (format!("U{}", column / 4 + 1), ["A", "B", "C", "D"][column % 4])
}

/// Designator and unit of a row's switch.
pub fn row_switch(row: usize) -> (String, &'static str) {
    (format!("Q{}", row / 2 + 1), ["A", "B"][row % 2])
}

impl Netlist {
    /// The reference board.
    pub fn reference() -> Self {
        let mut board = Self { parts: Vec::new() };
        for column in 0..COLUMNS {
            let (line, output, input) = (column_net(column), format!("OUT{column}"), input_net(column));
            board.two_ended(format!("R{}", 100 + column), &FEEDBACK, &line, &output);
            board.two_ended(format!("C{}", 100 + column), &CAPACITOR_47P, &line, &output);
            board.two_ended(format!("R{}", 200 + column), &SERIES, &output, &input);
            board.two_ended(format!("C{}", 200 + column), &CAPACITOR_330P, &input, GROUND);
        }
        for quad in 0..COLUMNS / 4 {
            let column = |unit: &str| quad * 4 + "ABCD".find(unit).unwrap_or_default();
            board.add(format!("U{}", quad + 1), &QUAD, |pin| match pin.split_once(' ') {
                Some((unit, "-")) => column_net(column(unit)),
                Some((_, "+")) => REFERENCE.into(),
                Some((unit, _)) => format!("OUT{}", column(unit)),
                None => if pin == "V+" { SWITCHED } else { GROUND }.into(),
            });
        }
        for row in 0..ROWS {
            board.two_ended(format!("R{}", 300 + row), &RESISTOR_10K, &row_net(row), REFERENCE);
        }
        for pair in 0..ROWS / 2 {
            let row = |unit: &str| 2 * pair + usize::from(unit == "B");
            board.add(format!("Q{}", pair + 1), &ROW_SWITCH, |pin| match pin.split_once(' ') {
                Some((unit, "D")) => row_net(row(unit)),
                Some((unit, "G")) => gate_net(row(unit)),
                _ => GROUND.into(),
            });
        }
        board.add("U5".into(), &BUFFER, |pin| {
            match pin {
                "A +" => "DIVIDER",
                "V+" => SWITCHED,
                "V-" => GROUND,
                _ => REFERENCE,
            }
            .into()
        });
        board.two_ended("R1".into(), &DIVIDER_UPPER, SWITCHED, "DIVIDER");
        board.two_ended("R2".into(), &DIVIDER_LOWER, "DIVIDER", GROUND);
        board.two_ended("C1".into(), &FILTER, "DIVIDER", GROUND);
        board.add("U6".into(), &LOAD_SWITCH, |pin| {
            match pin {
                "VIN" => SUPPLY,
                "GND" => GROUND,
                "ON" => "FE_ON",
                "CT" => "RISE",
                _ => SWITCHED,
            }
            .into()
        });
        board.two_ended("R3".into(), &ON_PULL_UP, SUPPLY, "FE_ON");
        board.two_ended("C2".into(), &CAPACITOR_47P, SUPPLY, "RISE");
        board.two_ended("C3".into(), &BULK, SUPPLY, GROUND);
        board.two_ended("C4".into(), &BULK, SWITCHED, GROUND);
        board.add("U7".into(), &DECODER, |pin| match pin {
            "LE" | "VCC" => SUPPLY.into(),
            "GND" => GROUND.into(),
            "/E" => "ROWS_OFF".into(),
            address if address.starts_with('A') => format!("ROW_{address}"),
            output => format!("GATE{}", &output[1..]),
        });
        board.two_ended("R4".into(), &PULL_UP, SUPPLY, "ROWS_OFF");
        board.add("U8".into(), &FLASH, |pin| {
            match pin {
                "/CS" => "FLASH_CS",
                "DO" => "FLASH_DO",
                "DI" => "FLASH_DI",
                "CLK" => "FLASH_CLK",
                "GND" => GROUND,
                _ => SUPPLY,
            }
            .into()
        });
        board.two_ended("R5".into(), &RESISTOR_10K, SUPPLY, "FLASH_CS");
        board.two_ended("R6".into(), &SIDE, "SIDE", GROUND);
        let decoupled = [SWITCHED, SWITCHED, SWITCHED, SWITCHED, SWITCHED, SUPPLY, SUPPLY];
        for (i, supply) in decoupled.into_iter().enumerate() {
            board.two_ended(format!("C{}", 11 + i), &DECOUPLING, supply, GROUND);
        }
        board.add("J1".into(), &CONTROLLER, |pin| match pin {
            "3V3" => SUPPLY.into(),
            "GND" => GROUND.into(),
            "rows off" => "ROWS_OFF".into(),
            "front end on" => "FE_ON".into(),
            "flash select" => "FLASH_CS".into(),
            "flash clock" => "FLASH_CLK".into(),
            "flash data out" => "FLASH_DO".into(),
            "flash data in" => "FLASH_DI".into(),
            "side" => "SIDE".into(),
            other => other.strip_prefix("row address ").map_or(other.into(), |bit| format!("ROW_A{bit}")),
        });
        // Contacts at ground separate the columns from the rows.
        board.add("J2".into(), &CONNECTOR, |pin| match pin.parse::<usize>().unwrap_or_default() {
            contact @ 2..=17 => column_net(contact - 2),
            contact @ 22..=37 => row_net(contact - 22),
            _ => GROUND.into(),
        });
        board.add("SHEET1".into(), &SHEET, |_| String::new());
        board
    }

    /// Adds a part. `net` returns the net of the pin with the given name.
    fn add(&mut self, designator: String, kind: &'static PartType, net: impl Fn(&str) -> String) {
        let nets = kind.pins.iter().map(|(_, name)| net(name)).collect();
        self.parts.push(Part { designator, kind, nets });
    }

    fn two_ended(&mut self, designator: String, kind: &'static PartType, first: &str, second: &str) {
        self.parts.push(Part { designator, kind, nets: vec![first.into(), second.into()] });
    }

    /// The part with this designator.
    ///
    /// # Panics
    /// If there is no such part.
    pub fn part(&self, designator: &str) -> &Part {
        let part = self.parts.iter().find(|part| part.designator == designator);
        part.unwrap_or_else(|| panic!("the board has no part {designator}"))
    }

    /// The nets by name, each with its pins as pairs of the designator of a part and the number of a pin.
    pub fn nets(&self) -> BTreeMap<&str, Vec<(&str, &str)>> {
        let mut nets: BTreeMap<&str, Vec<(&str, &str)>> = BTreeMap::new();
        for part in &self.parts {
            for (net, (number, _)) in part.nets.iter().zip(part.kind.pins) {
                nets.entry(net).or_default().push((&part.designator, number));
            }
        }
        nets
    }
}
