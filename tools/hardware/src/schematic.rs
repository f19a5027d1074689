//! The schematic, drawn from the netlist: this module places the symbols and the wires; names, values and labels are those of the
//! netlist. [`Schematic::check`] compares what is drawn with the netlist.

use crate::netlist::{GROUND, Netlist, REFERENCE, SUPPLY, SWITCHED, amplifier, row_switch};
use crate::parts::Model;
use maud::{Markup, PreEscaped, html};
use plantar::firmware::layout::{COLUMNS, ROWS};
use report::drawing::STYLE;
use std::collections::{BTreeMap, BTreeSet};

/// A point of the drawing, in units of the view box. Coordinates are integers, so that points can be compared exactly.
type Point = (i32, i32);

/// The direction in which a label extends from its point.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Left,
    Right,
    Up,
    Down,
}

/// The direction of a part with two ends, from its first pin on.
#[derive(Clone, Copy, PartialEq)]
enum Axis {
    Horizontal,
    Vertical,
}

/// SVG path of the symbol of a transistor, relative to the pin of its gate: gate, channel, drain, source, and the arrow of the
/// channel.
const TRANSISTOR: &str = "h22m0 -12v24m6 -28v8m0 4v8m0 4v8m0 -28h12v-18m-12 42h12v12m0 -12v-12h-12m4 -3l-4 3l4 3";

/// Distance between the ends of a resistor or a capacitor, in units of the view box.
const LENGTH: i32 = 40;

/// A pin of a part: designator and number of the pin.
type Pin = (String, &'static str);

/// The drawing, with the pins, wires and labels that [`Schematic::check`] compares with the netlist.
pub struct Schematic<'a> {
    board: &'a Netlist,
    body: Vec<Markup>,
    pins: Vec<(Pin, Point)>,
    wires: Vec<Vec<Point>>,
    labels: Vec<(Point, String)>,
    width: i32,
    height: i32,
}

impl<'a> Schematic<'a> {
    /// Draws the board.
    ///
    /// # Panics
    /// If the board lacks a part or a pin that the schematic has.
    pub fn of(board: &'a Netlist) -> Self {
        let mut sheet = Self {
            board,
            body: Vec::new(),
            pins: Vec::new(),
            wires: Vec::new(),
            labels: Vec::new(),
            width: 1640,
            height: 1620,
        };
        sheet.title(20, 70, "Columns: 16 amplifiers");
        for column in 0..COLUMNS as i32 {
            sheet.column(column as usize, 90 + column % 4 * 400, 170 + column / 4 * 130);
        }
        sheet.title(20, 630, "Rows: 16 switches");
        for row in 0..ROWS as i32 {
            sheet.row(row as usize, 90 + row % 8 * 200, 690 + row / 8 * 140);
        }
        sheet.title(20, 930, "Virtual ground");
        sheet.virtual_ground(120, 970);
        sheet.title(20, 1170, "Supply of the front end");
        sheet.load_switch(120, 1220);
        sheet.title(20, 1400, "Supply pins and decoupling");
        sheet.supplies(60, 1450);
        sheet.title(600, 930, "Row decoder");
        sheet.decoder(660, 960);
        sheet.title(600, 1270, "Flash chip");
        sheet.flash(690, 1300);
        sheet.title(940, 930, "Controller");
        sheet.controller(1010, 960);
        sheet.title(1310, 930, "Sensor sheet");
        sheet.connector(1390, 960);
        sheet
    }

    /// The drawing as an SVG file.
    pub fn svg(&self) -> String {
        let (width, height) = (self.width, self.height);
        let junctions = self.junctions();
        let wire = |points: &Vec<Point>| {
            let points = points.iter().map(|(x, y)| format!("{x},{y}")).collect::<Vec<_>>();
            html! { polyline.line points=(points.join(" ")) {} }
        };
        let drawing = html! {
            svg.drawing xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) }
                role="img" aria-label="Schematic of the Plantar reference board" {
                style { (PreEscaped(STYLE)) }
                rect width="100%" height="100%" fill="#fff" {}
                text.heading x="20" y="38" { "Plantar reference board" }
                @for part in &self.body { (part) }
                g.c0 { @for points in &self.wires { (wire(points)) } }
                @for (x, y) in junctions { circle.fill cx=(x) cy=(y) r="2.5" {} }
            }
        };
        drawing.into_string() + "\n"
    }

    /// Compares the drawing with the netlist.
    ///
    /// # Errors
    /// If a pin is missing or drawn twice, if pins of different nets are connected, or if pins of a net are neither connected nor
    /// labelled with its name.
    pub fn check(&self) -> Result<(), String> {
        let mut drawn = BTreeSet::new();
        if let Some((designator, number)) = self.pins.iter().map(|(pin, _)| pin).find(|pin| !drawn.insert(*pin)) {
            return Err(format!("pin {number} of {designator} is drawn twice"));
        }
        let mut groups_of_net = BTreeMap::<&str, BTreeSet<usize>>::new();
        let mut net_of_group = BTreeMap::<usize, &str>::new();
        let groups = self.groups();
        for part in &self.board.parts {
            for (net, (number, name)) in part.nets.iter().zip(part.kind.pins) {
                let pin = format!("{} of {}", name, part.designator);
                let found = self.pins.iter().find(|((on, pin), _)| *on == part.designator && pin == number);
                let (_, at) = found.ok_or_else(|| format!("pin {pin} is not drawn"))?;
                // There always is one: a pin without wires is in a group of its own.
                let group = groups.iter().position(|group| group.contains(at));
                let group = group.ok_or_else(|| format!("pin {pin} is not connected"))?;
                let labels = || self.labels.iter().filter(|(point, _)| groups[group].contains(point));
                if let Some((_, label)) = labels().find(|(_, label)| label != net) {
                    return Err(format!("pin {pin} belongs to {net}, but is connected with {label}"));
                }
                if let Some(other) = net_of_group.insert(group, net).filter(|other| other != net) {
                    return Err(format!("pin {pin} belongs to {net}, but is connected with {other}"));
                }
                // All groups with the net's label are one group.
                let id = if labels().next().is_some() { usize::MAX } else { group };
                groups_of_net.entry(net).or_default().insert(id);
            }
        }
        match groups_of_net.into_iter().find(|(_, groups)| groups.len() > 1) {
            Some((net, _)) => Err(format!("the pins of {net} are not all connected")),
            None => Ok(()),
        }
    }

    /// The sets of points that wires connect with each other.
    fn groups(&self) -> Vec<BTreeSet<Point>> {
        let mut groups: Vec<BTreeSet<Point>> = Vec::new();
        let ends = self.pins.iter().map(|(_, at)| *at).chain(self.labels.iter().map(|(at, _)| *at));
        let all: BTreeSet<Point> = ends.chain(self.wires.iter().flatten().copied()).collect();
        let single = all.iter().map(|point| BTreeSet::from([*point]));
        let wired = self.wires.iter().map(|wire| all.iter().filter(|point| is_on(wire, **point)).copied().collect());
        for mut group in single.chain(wired) {
            while let Some(i) = groups.iter().position(|other| !other.is_disjoint(&group)) {
                group.extend(groups.swap_remove(i));
            }
            groups.push(group);
        }
        groups
    }

    /// Points at which a wire ends on another wire, between the ends of that other wire.
    fn junctions(&self) -> Vec<Point> {
        let ends = self.wires.iter().flat_map(|wire| [wire[0], wire[wire.len() - 1]]);
        let inner = |point: Point| {
            let others = self.wires.iter().filter(|wire| wire[0] != point && wire[wire.len() - 1] != point);
            others.into_iter().any(|wire| is_on(wire, point))
        };
        ends.filter(|end| inner(*end)).collect::<BTreeSet<_>>().into_iter().collect()
    }

    fn title(&mut self, x: i32, y: i32, text: &str) {
        self.body.push(html! { text.title x=(x) y=(y) { (text) } });
    }

    fn wire(&mut self, points: &[Point]) {
        self.wires.push(points.to_vec());
    }

    /// Places a pin, and returns its net.
    fn pin(&mut self, designator: &str, number: &str, at: Point) -> String {
        let part = self.board.part(designator);
        let index = part.kind.pins.iter().position(|(pin, _)| *pin == number);
        let index = index.unwrap_or_else(|| panic!("{designator} has no pin {number}"));
        self.pins.push(((designator.into(), part.kind.pins[index].0), at));
        part.nets[index].clone()
    }

    /// Labels a point with a net: supplies and ground have their symbols.
    fn label(&mut self, (x, y): Point, net: &str, side: Side) {
        self.labels.push(((x, y), net.into()));
        let symbol = match (net, side) {
            (GROUND, _) => html! { path.line d={ "M" (x) " " (y) "v5m-7 0h14m-11 3h8m-5 3h2" } {} },
            (SUPPLY | SWITCHED | REFERENCE, Side::Up) => html! {
                path.line d={ "M" (x) " " (y) "v-6m-6 0h12" } {}
                text.small.middle x=(x) y=(y - 9) { (net) }
            },
            (_, Side::Left) => html! { text.small.end x=(x - 3) y=(y + 3) { (net) } },
            (_, Side::Right) => html! { text.small x=(x + 3) y=(y + 3) { (net) } },
            (_, Side::Up) => html! { text.small.middle x=(x) y=(y - 3) { (net) } },
            (_, Side::Down) => html! { text.small.middle x=(x) y=(y + 10) { (net) } },
        };
        self.body.push(html! { g.c1 { (symbol) } });
    }

    /// A resistor or a capacitor with its first pin at a point. Returns the nets of both pins.
    fn two_ended(&mut self, designator: &str, (x, y): Point, axis: Axis) -> [String; 2] {
        let part = self.board.part(designator);
        let value =
            part.kind.value.split(' ').take(2).collect::<Vec<_>>().join(" ").replace("ohm", "Ω").replace('u', "µ");
        let end = if axis == Axis::Horizontal { (x + LENGTH, y) } else { (x, y + LENGTH) };
        let shape = match (part.kind.model, axis) {
            (Model::Capacitor(_), Axis::Horizontal) => format!("M{x} {y}h17m0 -8v16m6 -16v16m0 -8h17"),
            (Model::Capacitor(_), Axis::Vertical) => format!("M{x} {y}v17m-8 0h16m-16 6h16m-8 0v17"),
            (_, Axis::Horizontal) => format!("M{x} {y}h8m0 -5h24v10h-24zm24 5h8"),
            (_, Axis::Vertical) => format!("M{x} {y}v8m-5 0h10v24h-10zm5 24v8"),
        };
        let text = match axis {
            Axis::Horizontal => html! { text.small.middle x=(x + LENGTH / 2) y=(y - 9) { (designator) " " (value) } },
            Axis::Vertical => html! {
                text.small x=(x + 10) y=(y + 16) { (designator) }
                text.small x=(x + 10) y=(y + 27) { (value) }
            },
        };
        self.body.push(html! { path.line d=(shape) {} (text) });
        [self.pin(designator, "1", (x, y)), self.pin(designator, "2", end)]
    }

    /// A vertical resistor or capacitor, with the labels of its two nets.
    fn between(&mut self, designator: &str, at: Point) {
        let [first, second] = self.two_ended(designator, at, Axis::Vertical);
        self.label(at, &first, Side::Up);
        self.label((at.0, at.1 + LENGTH), &second, Side::Down);
    }

    /// The number of a part's pin with this name.
    fn number(&self, designator: &str, name: &str) -> &'static str {
        let pins = self.board.part(designator).kind.pins;
        let found = pins.iter().find(|(_, pin)| *pin == name);
        found.unwrap_or_else(|| panic!("{designator} has no pin {name}")).0
    }

    /// An amplifier: its inverting input is at a point, its non-inverting input 20 units below, and its output 60 to the right,
    /// midway between the inputs.
    fn amplifier(&mut self, (designator, unit): (&str, &str), (x, y): Point) {
        self.body.push(html! {
            path.line d={ "M" (x) " " (y) "h10m-10 20h10M" (x + 10) " " (y - 15) "v50l40 -25zm40 25h10" } {}
            text.small x=(x + 13) y=(y + 4) { "−" }
            text.small x=(x + 13) y=(y + 23) { "+" }
            text.small x=(x + 36) y=(y + 31) { (designator) (unit) }
        });
        for (name, at) in [("-", (x, y)), ("+", (x, y + 20)), ("OUT", (x + 60, y + 10))] {
            let number = self.number(designator, &format!("{unit} {name}"));
            self.pin(designator, number, at);
        }
    }

    /// A part as a box with its upper left corner at a point. All pins are labelled with their nets, and are 12 units apart.
    fn labelled_box(&mut self, designator: &str, (x, y): Point, width: i32, left: &[&str], right: &[&str]) {
        let height = 12 * left.len().max(right.len()) as i32 + 8;
        let part = self.board.part(designator);
        let number = part.kind.number;
        self.body.push(html! {
            rect.line x=(x) y=(y) width=(width) height=(height) {}
            text.small x=(x) y=(y - 4) { (designator) " " (number) }
        });
        for (names, side) in [(left, Side::Left), (right, Side::Right)] {
            for (i, name) in names.iter().enumerate() {
                let at_y = y + 10 + 12 * i as i32;
                let pin = self.number(designator, name);
                let (edge, end) = if side == Side::Left { (x, x - 20) } else { (x + width, x + width + 20) };
                let shown = if *name == pin { (*name).to_string() } else { format!("{pin} {name}") };
                self.body.push(html! {
                    path.line d={ "M" (edge) " " (at_y) "H" (end) } {}
                    @match side {
                        Side::Left => text.small x=(x + 3) y=(at_y + 3) { (shown) },
                        _ => text.small.end x=(x + width - 3) y=(at_y + 3) { (shown) },
                    }
                });
                let net = self.pin(designator, pin, (end, at_y));
                // Ground is labelled with its name, because its symbol would cover the pin below.
                self.labels.push(((end, at_y), net.clone()));
                self.body.push(html! {
                    g.c1 {
                        @match side {
                            Side::Left => text.small.end x=(end - 3) y=(at_y + 3) { (net) },
                            _ => text.small x=(end + 3) y=(at_y + 3) { (net) },
                        }
                    }
                });
            }
        }
    }

    /// A column's amplifier with its feedback and its filter.
    fn column(&mut self, column: usize, x: i32, y: i32) {
        let (designator, unit) = amplifier(column);
        let name = |letter: &str, hundred: usize| format!("{letter}{}", hundred + column);
        self.amplifier((&designator, unit), (x + 40, y));
        let line = self.two_ended(&name("R", 100), (x + 50, y - 30), Axis::Horizontal)[0].clone();
        self.two_ended(&name("C", 100), (x + 50, y - 55), Axis::Horizontal);
        self.label((x, y), &line, Side::Left);
        self.wire(&[(x, y), (x + 40, y)]);
        self.wire(&[(x + 20, y), (x + 20, y - 55), (x + 50, y - 55)]);
        self.wire(&[(x + 20, y - 30), (x + 50, y - 30)]);
        self.label((x + 40, y + 20), REFERENCE, Side::Left);
        let [_, input] = self.two_ended(&name("R", 200), (x + 150, y + 10), Axis::Horizontal);
        self.wire(&[(x + 100, y + 10), (x + 150, y + 10)]);
        self.wire(&[(x + 120, y + 10), (x + 120, y - 55), (x + 90, y - 55)]);
        self.wire(&[(x + 120, y - 30), (x + 90, y - 30)]);
        self.two_ended(&name("C", 200), (x + 220, y + 10), Axis::Vertical);
        self.label((x + 220, y + 50), GROUND, Side::Down);
        self.wire(&[(x + 190, y + 10), (x + 250, y + 10)]);
        self.label((x + 250, y + 10), &input, Side::Right);
    }

    /// A row's switch, and the resistor that returns the row to the virtual ground.
    fn row(&mut self, row: usize, x: i32, y: i32) {
        let (designator, unit) = row_switch(row);
        let resistor = format!("R{}", 300 + row);
        self.two_ended(&resistor, (x + 60, y - 20), Axis::Horizontal);
        self.label((x + 100, y - 20), REFERENCE, Side::Right);
        self.body.push(html! {
            path.line d={ "M" (x) " " (y + 30) (TRANSISTOR) } {}
            text.small x=(x + 46) y=(y + 34) { (designator) (unit) }
        });
        let pins = [("G", (x, y + 30)), ("D", (x + 40, y)), ("S", (x + 40, y + 54))];
        let nets = pins.map(|(name, at)| {
            let number = self.number(&designator, &format!("{unit} {name}"));
            (self.pin(&designator, number, at), at)
        });
        self.label(nets[0].1, &nets[0].0, Side::Left);
        self.label(nets[2].1, &nets[2].0, Side::Down);
        self.wire(&[(x, y - 20), (x + 60, y - 20)]);
        self.wire(&[(x + 40, y), (x + 40, y - 20)]);
        self.label((x, y - 20), &nets[1].0, Side::Left);
    }

    /// The divider and the buffer of the virtual ground.
    fn virtual_ground(&mut self, x: i32, y: i32) {
        self.two_ended("R1", (x, y), Axis::Vertical);
        self.label((x, y), SWITCHED, Side::Up);
        self.two_ended("R2", (x, y + 100), Axis::Vertical);
        self.label((x, y + 140), GROUND, Side::Down);
        self.two_ended("C1", (x + 80, y + 100), Axis::Vertical);
        self.label((x + 80, y + 140), GROUND, Side::Down);
        self.amplifier(("U5", "A"), (x + 140, y + 60));
        self.wire(&[(x, y + 40), (x, y + 100)]);
        self.wire(&[(x, y + 80), (x + 140, y + 80)]);
        self.wire(&[(x + 80, y + 100), (x + 80, y + 80)]);
        self.wire(&[(x + 140, y + 60), (x + 120, y + 60), (x + 120, y + 20), (x + 220, y + 20), (x + 220, y + 70)]);
        self.wire(&[(x + 200, y + 70), (x + 250, y + 70)]);
        self.label((x + 250, y + 70), REFERENCE, Side::Right);
        self.label((x + 40, y + 80), "DIVIDER", Side::Up);
    }

    /// The load switch with its parts.
    fn load_switch(&mut self, x: i32, y: i32) {
        self.labelled_box("U6", (x, y), 90, &["VIN", "ON", "GND"], &["VOUT", "QOD", "CT"]);
        for (i, designator) in ["R3", "C2", "C3", "C4"].into_iter().enumerate() {
            self.between(designator, (x - 60 + 100 * i as i32, y + 90));
        }
    }

    /// The supply pins of the amplifiers, the decoupling capacitors, and the resistor that selects the side.
    fn supplies(&mut self, x: i32, y: i32) {
        for (i, designator) in ["U1", "U2", "U3", "U4", "U5"].into_iter().enumerate() {
            self.labelled_box(designator, (x + 30 + 104 * i as i32, y), 34, &[], &["V+", "V-"]);
        }
        for i in 0..7 {
            self.between(&format!("C{}", 11 + i), (x + 74 * i, y + 80));
        }
        self.between("R6", (x + 74 * 7, y + 80));
    }

    /// The decoder of the row address.
    fn decoder(&mut self, x: i32, y: i32) {
        let outputs: Vec<_> = (0..ROWS).map(|row| format!("Y{row}")).collect();
        let outputs: Vec<_> = outputs.iter().map(String::as_str).collect();
        let inputs = ["A0", "A1", "A2", "A3", "LE", "/E", "VCC", "GND"];
        self.labelled_box("U7", (x, y), 110, &inputs, &outputs);
        self.between("R4", (x - 60, y + 160));
    }

    /// The flash chip.
    fn flash(&mut self, x: i32, y: i32) {
        self.labelled_box("U8", (x, y), 110, &["/CS", "CLK", "DI", "DO"], &["VCC", "/WP", "/HOLD", "GND"]);
        self.between("R5", (x - 20, y + 100));
    }

    /// The headers of the controller's board.
    fn controller(&mut self, x: i32, y: i32) {
        let names: Vec<_> = self.board.part("J1").kind.pins.iter().map(|(_, name)| *name).collect();
        let (left, right) = names.split_at(2 + COLUMNS);
        self.labelled_box("J1", (x, y), 190, left, right);
    }

    /// The connector of the sensor sheet.
    fn connector(&mut self, x: i32, y: i32) {
        let names: Vec<_> = self.board.part("J2").kind.pins.iter().map(|(_, name)| *name).collect();
        let (left, right) = names.split_at(20);
        self.labelled_box("J2", (x, y), 110, left, right);
    }
}

/// True if a point is on a wire.
fn is_on(wire: &[Point], (x, y): Point) -> bool {
    wire.windows(2).any(|ends| {
        let ((ax, ay), (bx, by)) = (ends[0], ends[1]);
        let is_within = (ax.min(bx)..=ax.max(bx)).contains(&x) && (ay.min(by)..=ay.max(by)).contains(&y);
        is_within && (ax == bx || ay == by)
    })
}
