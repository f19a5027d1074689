//! The netlist, the files that follow from it, and the firmware describe the same board.

use hardware::files::files;
use hardware::netlist::{GROUND, Netlist, column_net, gate_net, input_net, row_net};
use hardware::schematic::Schematic;
use plantar::firmware::layout::{COLUMNS, ROWS};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The pin of the controller that is connected with this net.
fn controller_pin(board: &Netlist, net: &str) -> &'static str {
    let part = board.part("J1");
    let index = part.nets.iter().position(|pin_net| pin_net == net);
    part.kind.pins[index.unwrap_or_else(|| panic!("the controller is not connected with {net}"))].0
}

#[test]
fn the_committed_files_are_those_of_the_netlist() {
    for (name, text) in files(&Netlist::reference()).expect("the files can be made") {
        assert!(read(&format!("hardware/{name}")) == text, "hardware/{name} is outdated: run `cargo xtask hardware`");
    }
}

#[test]
fn designators_are_unique_and_every_net_connects_parts() {
    let board = Netlist::reference();
    let designators: BTreeSet<_> = board.parts.iter().map(|part| &part.designator).collect();
    assert_eq!(designators.len(), board.parts.len(), "a designator is used twice");
    for (net, pins) in board.nets() {
        assert!(pins.len() >= 2, "{net} has the single pin {pins:?}");
    }
}

#[test]
fn every_row_and_column_of_the_sensor_has_its_parts() {
    let board = Netlist::reference();
    let nets = board.nets();
    let parts = |net: String| nets[&*net].iter().map(|(designator, _)| *designator).collect::<BTreeSet<_>>();
    for column in 0..COLUMNS {
        let (line, input) = (parts(column_net(column)), parts(input_net(column)));
        let quad = format!("U{}", column / 4 + 1);
        for part in [&*quad, &format!("R{}", 100 + column), &format!("C{}", 100 + column), "J2"] {
            assert!(line.contains(part), "column {column} lacks {part}");
        }
        for part in [&*format!("R{}", 200 + column), &format!("C{}", 200 + column), "J1"] {
            assert!(input.contains(part), "the input of column {column} lacks {part}");
        }
    }
    for row in 0..ROWS {
        let switch = format!("Q{}", row / 2 + 1);
        assert_eq!(parts(row_net(row)), BTreeSet::from([&*switch, &*format!("R{}", 300 + row), "J2"]), "row {row}");
        assert_eq!(parts(gate_net(row)), BTreeSet::from([&*switch, "U7"]), "gate of row {row}");
    }
}

#[test]
fn the_schematic_contradicts_a_netlist_with_a_wrong_net() {
    assert_eq!(Schematic::of(&Netlist::reference()).check(), Ok(()));
    let wrong = [
        ("R100", 0, "OUT0"),
        ("C203", 1, "COL0"),
        ("R301", 1, GROUND),
        ("U2", 1, "COL9"),
        ("R200", 0, "a net without a label"),
    ];
    for (designator, pin, net) in wrong {
        let mut board = Netlist::reference();
        let part = board.parts.iter_mut().find(|part| part.designator == designator);
        part.expect("the part exists").nets[pin] = net.into();
        assert!(Schematic::of(&board).check().is_err(), "{designator} is connected with {net} unnoticed");
    }
}

#[test]
fn the_firmware_uses_the_pins_of_the_netlist() {
    let board = Netlist::reference();
    let source = read("boards/wb55/src/main.rs");
    let columns: Vec<_> = source.lines().filter_map(|line| line.trim().strip_suffix(".degrade_adc(),")).collect();
    let expected: Vec<_> =
        (0..COLUMNS).map(|column| format!("p.{}", controller_pin(&board, &input_net(column)))).collect();
    assert_eq!(columns, expected, "pins of the columns in boards/wb55/src/main.rs");
    let address = (0..4).map(|bit| format!("line(p.{}.into())", controller_pin(&board, &format!("ROW_A{bit}"))));
    let address = format!("[{}]", address.collect::<Vec<_>>().join(", "));
    assert!(source.contains(&address), "boards/wb55/src/main.rs lacks {address}");
    for (output, net) in [("rows_off", "ROWS_OFF"), ("front_end", "FE_ON")] {
        let set_up = format!("let {output} = Output::new(p.{}, Level::High", controller_pin(&board, net));
        assert!(source.contains(&set_up), "boards/wb55/src/main.rs lacks {set_up}");
    }
    let pin = |net: &str| format!("p.{}", controller_pin(&board, net));
    let set_ups = [
        format!("Input::new({}, Pull::Up)", pin("SIDE")),
        format!("let select = Output::new({}, Level::High", pin("FLASH_CS")),
        format!("flash::open(p.SPI2, {}, {}, {},", pin("FLASH_CLK"), pin("FLASH_DI"), pin("FLASH_DO")),
    ];
    for set_up in set_ups {
        assert!(source.contains(&set_up), "boards/wb55/src/main.rs lacks {set_up}");
    }
}

#[test]
fn the_wiring_in_the_document_is_that_of_the_netlist() {
    let board = Netlist::reference();
    let document = read("docs/hardware.md");
    let mut rows: Vec<_> = (0..COLUMNS)
        .map(|column| {
            let net = input_net(column);
            format!("| column {column} | {}, {net} |", controller_pin(&board, &net))
        })
        .collect();
    let lines = [
        ("row address 0, least significant", "ROW_A0"),
        ("row address 1", "ROW_A1"),
        ("row address 2", "ROW_A2"),
        ("row address 3", "ROW_A3"),
        ("rows off, active high", "ROWS_OFF"),
        ("front end on, active high", "FE_ON"),
        ("flash chip, select", "FLASH_CS"),
        ("flash chip, clock", "FLASH_CLK"),
        ("flash chip, data out", "FLASH_DO"),
        ("flash chip, data in", "FLASH_DI"),
        ("side", "SIDE"),
    ];
    rows.extend(lines.map(|(signal, net)| format!("| {signal} | {} |", controller_pin(&board, net))));
    for row in rows {
        assert!(document.contains(&row), "docs/hardware.md lacks the row {row}");
    }
}
