//! The front end as a circuit for ngspice, from the netlist and the parts' models.

use crate::data_sheet::{
    CONVERTER_SAMPLE_F, CONVERTER_SWITCH_OHM, DECODER_OUTPUT_OHM, LOAD_SWITCH_OFF_OHM, LOAD_SWITCH_ON_OHM,
    LOAD_SWITCH_SUPPLY_A, SHEET_LINE_F, SHEET_LINE_OHM, SUPPLY_V,
};
use crate::netlist::{GROUND, Netlist, Part, SUPPLY, column_net, input_net, row_net};
use crate::parts::{Amplifier, Model, RowSwitch};
use plantar::firmware::layout::{COLUMNS, ROWS};
use std::collections::BTreeSet;
use std::fmt::{Display, Write};

/// State of a row switch over time, from which the voltage of its gate follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gate {
    /// The row is connected to ground.
    On,
    /// The row is not connected.
    Off,
    /// The row is connected until this time, s.
    OnUntil(f64),
    /// The row is connected from this time on, s.
    OnFrom(f64),
}

/// Rise and fall time of the decoder's outputs, s.
const EDGE_S: f64 = 20e-9;
/// Rise and fall time of the converter's sampling windows, s.
const WINDOW_EDGE_S: f64 = 2e-9;
/// Gate voltage at which a row switch has half of its conductance, V. This voltage and [`HALF_ON_SCALE_V`] are assumptions: a
/// gate is at ground or at the supply, so they only affect the shape of an edge.
const HALF_ON_V: f64 = 1.5;
/// Scale of the logistic curve of the conductance over the gate voltage, V.
const HALF_ON_SCALE_V: f64 = 0.05;

impl Gate {
    fn source(self) -> String {
        let high_v = SUPPLY_V.value;
        match self {
            Self::On => format!("DC {high_v}"),
            Self::Off => "DC 0".into(),
            Self::OnUntil(at_s) => format!("PWL(0 {high_v} {at_s:e} {high_v} {:e} 0)", at_s + EDGE_S),
            Self::OnFrom(at_s) => format!("PWL(0 0 {at_s:e} 0 {:e} {high_v})", at_s + EDGE_S),
        }
    }
}

/// The state of the load switch, which supplies the front end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Power {
    /// Off.
    Off,
    /// On for so long that everything has settled.
    On,
    /// Its output rises linearly from ground to the supply between these times, s.
    Rising {
        /// Beginning of the rise.
        from_s: f64,
        /// End of the rise.
        until_s: f64,
    },
}

/// The conditions of a simulation.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// Resistance of each cell by row and column, ohm; infinite for an open cell.
    pub cell_ohm: [[f64; COLUMNS]; ROWS],
    /// Capacitance of each line of the sheet, farad.
    pub line_f: f64,
    /// Resistance of each line of the sheet, ohm.
    pub line_ohm: f64,
    /// The gate of the row switch of each row.
    pub gates: [Gate; ROWS],
    /// The row switches.
    pub row_switch: RowSwitch,
    /// The amplifiers.
    pub amplifier: Amplifier,
    /// Input offset voltage of each column's amplifier, V.
    pub offset_v: [f64; COLUMNS],
    /// The amplifier, by designator and unit, at whose inverting input a source of 1 V breaks the loop for small signals.
    pub probe: Option<(String, &'static str)>,
    /// The state of the load switch.
    pub power: Power,
    /// Sampling windows of the converter: column, start and end, s. The windows of one column are in the order of time.
    pub samples: Vec<(usize, f64, f64)>,
}

impl Conditions {
    /// All cells open, and one row selected.
    pub fn selected(row: usize) -> Self {
        let mut gates = [Gate::Off; ROWS];
        gates[row] = Gate::On;
        Self { gates, ..Self::idle() }
    }

    /// All cells open, and no row selected.
    pub fn idle() -> Self {
        Self {
            cell_ohm: [[f64::INFINITY; COLUMNS]; ROWS],
            line_f: SHEET_LINE_F.value,
            line_ohm: SHEET_LINE_OHM.value,
            gates: [Gate::Off; ROWS],
            row_switch: RowSwitch::FDG6335N,
            amplifier: Amplifier::TLV905X,
            offset_v: [0.0; COLUMNS],
            probe: None,
            power: Power::On,
            samples: Vec::new(),
        }
    }

    /// Sets the amplifiers' offset, V: positive at one column, and negative at all others.
    pub fn with_offset_against(mut self, column: usize, offset_v: f64) -> Self {
        self.offset_v = [-offset_v; COLUMNS];
        self.offset_v[column] = offset_v;
        self
    }

    /// Sets the resistance of a cell, ohm.
    pub fn with_cell(mut self, row: usize, column: usize, ohm: f64) -> Self {
        self.cell_ohm[row][column] = ohm;
        self
    }

    /// Sets the resistance of all cells of a row, ohm.
    pub fn with_row(mut self, row: usize, ohm: f64) -> Self {
        self.cell_ohm[row] = [ohm; COLUMNS];
        self
    }

    /// Sets the resistance of all cells, ohm.
    pub fn with_all(mut self, ohm: f64) -> Self {
        self.cell_ohm = [[ohm; COLUMNS]; ROWS];
        self
    }
}

/// The name of a net in the circuit. ngspice calls ground 0.
pub fn node(net: &str) -> &str {
    if net == GROUND { "0" } else { net }
}

/// The name of the node of an amplifier's inverting input behind the probe.
pub fn probed_node(designator: &str, unit: &str) -> String {
    format!("probe_{designator}{unit}")
}

/// The node of the converter's sampling capacitor.
pub const SAMPLED: &str = "sampled";

/// The source of the board's supply, whose current is that of the front end.
pub const SUPPLY_SOURCE: &str = "Vsupply";

struct Circuit<'a> {
    text: String,
    conditions: &'a Conditions,
}

impl Circuit<'_> {
    fn line(&mut self, line: impl Display) {
        // Writing to a string does not fail.
        let _ = writeln!(self.text, "{line}");
    }

    fn part(&mut self, part: &Part) {
        let name = &part.designator;
        let end = |pin: &str| node(part.net(pin));
        match part.kind.model {
            Model::Resistor(ohm) => self.line(format_args!("R_{name} {} {} {ohm:e}", end("1"), end("2"))),
            Model::Capacitor(farad) => self.line(format_args!("C_{name} {} {} {farad:e}", end("1"), end("2"))),
            Model::Amplifiers(units) => units.iter().for_each(|unit| self.amplifier(part, unit)),
            Model::Switches(units) => units.iter().for_each(|unit| self.row_switch(part, unit)),
            Model::LoadSwitch => {
                let on = self.conditions.power != Power::Off;
                let ohm = if on { LOAD_SWITCH_ON_OHM } else { LOAD_SWITCH_OFF_OHM }.value;
                // During the rise, an ideal ramp drives the output: the supply is assumed to deliver the current.
                let input = if let Power::Rising { from_s, until_s } = self.conditions.power {
                    let high_v = SUPPLY_V.value;
                    self.line(format_args!("V_{name}_ramp ramp 0 PWL(0 0 {from_s:e} 0 {until_s:e} {high_v})"));
                    "ramp"
                } else {
                    end("VIN")
                };
                let supply_a = if on { LOAD_SWITCH_SUPPLY_A.value } else { 0.0 };
                self.line(format_args!("R_{name} {input} {} {ohm:e}", end("VOUT")));
                self.line(format_args!("I_{name} {} {} {supply_a:e}", end("VIN"), end("GND")));
                // A node without a path for direct current has no operating point.
                self.line(format_args!("R_{name}_rise {} 0 1e9", end("CT")));
                // A resistor pulls the pin ON up to the supply, unless the controller pulls it down.
                if !on {
                    self.line(format_args!("V_{name} {} 0 0", end("ON")));
                }
            }
            Model::Decoder => {
                for (row, gate) in self.conditions.gates.into_iter().enumerate() {
                    self.line(format_args!("V_{name}_{row} drive{row} 0 {}", gate.source()));
                    let pin = format!("Y{row}");
                    let output = end(&pin);
                    self.line(format_args!("R_{name}_{row} drive{row} {output} {:e}", DECODER_OUTPUT_OHM.value));
                }
            }
            Model::Sheet => self.sheet(),
            Model::Controller => self.controller(),
            Model::None => {}
        }
    }

    fn amplifier(&mut self, part: &Part, unit: &str) {
        let pin = |name: &str| node(part.net(&format!("{unit} {name}")));
        let (plus, minus, output) = (pin("+"), pin("-"), pin("OUT"));
        let (positive, negative) = (node(part.net("V+")), node(part.net("V-")));
        let name = format!("{}{unit}", part.designator);
        self.line(format_args!("C_{name} {minus} 0 {:e}", self.conditions.amplifier.input_f));
        let is_probed = self.conditions.probe.as_ref().is_some_and(|(d, u)| *d == part.designator && *u == unit);
        let mut input = minus.to_string();
        if is_probed {
            input = probed_node(&part.designator, unit);
            self.line(format_args!("V_probe {minus} {input} DC 0 AC 1"));
        }
        let column = (0..COLUMNS).find(|&column| column_net(column) == minus);
        let offset_v = column.map_or(0.0, |column| self.conditions.offset_v[column]);
        self.line(format_args!("X_{name} {plus} {input} {output} {positive} {negative} amplifier offset={offset_v:e}"));
    }

    fn row_switch(&mut self, part: &Part, unit: &str) {
        let pin = |name: &str| node(part.net(&format!("{unit} {name}")));
        let (drain, gate, source) = (pin("D"), pin("G"), pin("S"));
        let name = format!("{}{unit}", part.designator);
        let RowSwitch { on_ohm, off_ohm, drain_f, gate_drain_f, gate_source_f } = self.conditions.row_switch;
        // A current source, because ngspice's own switch is always off in the analysis of noise.
        self.line(format_args!(
            "B_{name} {drain} {source} I=V({drain},{source})\
             *({:e}+{:e}/(1+exp(({HALF_ON_V}-V({gate},{source}))/{HALF_ON_SCALE_V})))",
            1.0 / off_ohm,
            1.0 / on_ohm
        ));
        self.line(format_args!("C_{name}_ds {drain} {source} {drain_f:e}"));
        self.line(format_args!("C_{name}_gd {gate} {drain} {gate_drain_f:e}"));
        self.line(format_args!("C_{name}_gs {gate} {source} {gate_source_f:e}"));
        // The body diode limits the voltage to which the gate pulls a row that is switched off.
        self.line(format_args!("D_{name} {source} {drain} body"));
    }

    /// Lines with their resistance and capacitance, and the cells between them. ngspice does not distinguish upper and lower
    /// case, so the nodes of the lines have a prefix in addition to the name of the row or column.
    fn sheet(&mut self) {
        let Conditions { line_f, line_ohm, cell_ohm, .. } = self.conditions;
        for (kind, count, net) in
            [("row", ROWS, row_net as fn(usize) -> String), ("column", COLUMNS, column_net as fn(usize) -> String)]
        {
            for i in 0..count {
                self.line(format_args!("R_{kind}{i} {} sheet_{kind}{i} {line_ohm:e}", net(i)));
                self.line(format_args!("C_{kind}{i} sheet_{kind}{i} 0 {line_f:e}"));
            }
        }
        for (row, columns) in cell_ohm.iter().enumerate() {
            for (column, ohm) in columns.iter().enumerate().filter(|(_, ohm)| ohm.is_finite()) {
                self.line(format_args!("R_cell{row}_{column} sheet_row{row} sheet_column{column} {ohm:e}"));
            }
        }
    }

    /// The supply, and the converter's sampling capacitor, which is connected to its inputs in turn.
    fn controller(&mut self) {
        // The analysis of noise needs a source for small signals, and that of a loop has one at its probe.
        let small_signal_v = if self.conditions.probe.is_some() { 0 } else { 1 };
        self.line(format_args!("{SUPPLY_SOURCE} {SUPPLY} 0 DC {} AC {small_signal_v}", SUPPLY_V.value));
        let samples = &self.conditions.samples;
        if samples.is_empty() {
            return;
        }
        let inputs: BTreeSet<usize> = samples.iter().map(|(input, ..)| *input).collect();
        let mut lines = Vec::new();
        for input in inputs {
            let windows = samples.iter().filter(|(column, ..)| *column == input).map(|(_, start_s, end_s)| {
                format!(" {start_s:e} 0 {:e} 1 {:e} 1 {end_s:e} 0", start_s + WINDOW_EDGE_S, end_s - WINDOW_EDGE_S)
            });
            lines.push(format!("V_window{input} window{input} 0 PWL(0 0{})", windows.collect::<String>()));
            lines.push(format!("S_window{input} {} {SAMPLED} window{input} 0 sampler", input_net(input)));
        }
        lines.iter().for_each(|line| self.line(line));
        self.line(format_args!("C_sample {SAMPLED} 0 {:e}", CONVERTER_SAMPLE_F.value));
        self.line(format_args!(".model sampler sw(vt=0.5 vh=0.1 ron={} roff=1e12)", CONVERTER_SWITCH_OHM.value));
    }

    /// The amplifiers' macro-model: offset and noise at the input, a stage that limits the slew rate and has the gain bandwidth
    /// product, a limit of its voltage, a second pole, the output impedance, and the supply current. Also the model of the row
    /// switches' body diodes.
    fn models(&mut self) {
        let a = &self.conditions.amplifier;
        // The capacitance of the stage can be chosen freely: the stage's conductance and current are proportional to it.
        let stage_f = 10e-12;
        let conductance = std::f64::consts::TAU * a.gain_bandwidth_hz * stage_f;
        let stage_ohm = a.open_loop_gain / conductance;
        // The largest current of the stage. Beyond the swing, `B_swing` draws 0.1 A/V, so that the stage exceeds the swing by at
        // most 1.5 mV.
        let limit_a = a.slew_v_per_s * stage_f;
        // A resistor of this value has the noise density of the amplifier at 27 °C, the temperature at which ngspice simulates;
        // the constant is Boltzmann's, J/K.
        let noise_ohm = a.noise_v_per_sqrt_hz.powi(2) / (4.0 * 1.380_649e-23 * 300.15);
        let pole_f = 1.0 / (std::f64::consts::TAU * a.second_pole_hz);
        let Amplifier { swing_v, output_ohm, supply_a, .. } = *a;
        self.line(format_args!(
            "\
.subckt amplifier plus minus out positive negative offset=0
V_offset offset_plus plus DC {{offset}}
R_noise noise 0 {noise_ohm:e}
E_noise input offset_plus noise 0 1
B_stage 0 stage I={limit_a:e}*tanh({:e}*V(input,minus))
R_stage stage 0 {stage_ohm:e} noisy=0
C_stage stage 0 {stage_f:e}
B_swing stage 0 I=0.1*(max(V(stage)-{output_ohm:e}*I(V_output)-V(positive)+{swing_v:e},0)
+ +min(V(stage)-{output_ohm:e}*I(V_output)-V(negative)-{swing_v:e},0))
E_pole drive 0 stage 0 1
R_pole drive pole 1 noisy=0
C_pole pole 0 {pole_f:e}
E_output ideal 0 pole 0 1
V_output ideal sensed 0
R_output sensed out {output_ohm:e} noisy=0
B_supply positive negative I={supply_a:e}*min(max(V(positive)-V(negative),0),1)+max(I(V_output),0)
.ends
.model body d(is=1e-12)",
            conductance / limit_a
        ));
    }
}

/// The circuit under these conditions, without analyses.
pub fn circuit(netlist: &Netlist, conditions: &Conditions) -> String {
    let mut circuit = Circuit { text: String::new(), conditions };
    circuit.line("* The analogue front end of the Plantar reference board. `cargo xtask hardware` writes this file.");
    netlist.parts.iter().for_each(|part| circuit.part(part));
    circuit.models();
    circuit.text
}
