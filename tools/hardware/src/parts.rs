//! The types of parts on the reference board.

use crate::data_sheet::{
    AMPLIFIER_GAIN_BANDWIDTH_HZ, AMPLIFIER_INPUT_F, AMPLIFIER_NOISE_V_PER_SQRT_HZ, AMPLIFIER_OPEN_LOOP_GAIN,
    AMPLIFIER_OUTPUT_OHM, AMPLIFIER_SECOND_POLE_HZ, AMPLIFIER_SLEW_V_PER_S, AMPLIFIER_SUPPLY_A, AMPLIFIER_SWING_V,
    SWITCH_DRAIN_F, SWITCH_GATE_DRAIN_F, SWITCH_GATE_SOURCE_F, SWITCH_OFF_OHM, SWITCH_ON_OHM,
};
use plantar::firmware::front_end::{FEEDBACK_OHM, REFERENCE_DIVISOR};

/// A type of part: what a buyer needs, its pins, and its model in the simulation.
#[derive(Clone, Copy, Debug)]
pub struct PartType {
    /// The manufacturer's part number.
    pub number: &'static str,
    /// The manufacturer.
    pub manufacturer: &'static str,
    /// Part numbers with the same footprint and function.
    pub alternatives: &'static [&'static str],
    /// The value, or the kind of part.
    pub value: &'static str,
    /// The package.
    pub package: &'static str,
    /// The purpose on this board.
    pub purpose: &'static str,
    /// Numbers and names of the pins.
    pub pins: &'static [(&'static str, &'static str)],
    /// The model in the simulation.
    pub model: Model,
}

/// The model of a part in the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Model {
    /// A resistor between its two pins, ohm.
    Resistor(f64),
    /// A capacitor between its two pins, farad.
    Capacitor(f64),
    /// Operational amplifiers with the pins `-`, `+` and `OUT`, each with the letter of its unit before it.
    Amplifiers(&'static [&'static str]),
    /// Switches to ground with the pins `S`, `G` and `D`, each with the letter of its unit before it.
    Switches(&'static [&'static str]),
    /// The switch of the front end's supply.
    LoadSwitch,
    /// The decoder, which drives the gates of the row switches.
    Decoder,
    /// The sensor sheet, which is simulated at its connector.
    Sheet,
    /// The controller, with supply and converter.
    Controller,
    /// Not simulated: no part of the front end, or represented by another part, as the sheet is by its connector.
    None,
}

/// Parameters of the amplifiers' macro-model.
#[derive(Clone, Copy, Debug)]
pub struct Amplifier {
    /// Gain bandwidth product, Hz.
    pub gain_bandwidth_hz: f64,
    /// Open-loop gain.
    pub open_loop_gain: f64,
    /// Second pole, Hz.
    pub second_pole_hz: f64,
    /// Slew rate, V/s.
    pub slew_v_per_s: f64,
    /// Open-loop output impedance, ohm.
    pub output_ohm: f64,
    /// Smallest distance of the output from either rail, V. The output saturates there.
    pub swing_v: f64,
    /// Input voltage noise density, V/sqrt(Hz).
    pub noise_v_per_sqrt_hz: f64,
    /// Capacitance of the inverting input to ground, farad.
    pub input_f: f64,
    /// Quiescent current, A.
    pub supply_a: f64,
}

impl Amplifier {
    /// The TLV9054 and the TLV9051.
    pub const TLV905X: Self = Self {
        gain_bandwidth_hz: AMPLIFIER_GAIN_BANDWIDTH_HZ.value,
        open_loop_gain: AMPLIFIER_OPEN_LOOP_GAIN.value,
        second_pole_hz: AMPLIFIER_SECOND_POLE_HZ.value,
        slew_v_per_s: AMPLIFIER_SLEW_V_PER_S.value,
        output_ohm: AMPLIFIER_OUTPUT_OHM.value,
        swing_v: AMPLIFIER_SWING_V.value,
        noise_v_per_sqrt_hz: AMPLIFIER_NOISE_V_PER_SQRT_HZ.value,
        input_f: AMPLIFIER_INPUT_F.value,
        supply_a: AMPLIFIER_SUPPLY_A.value,
    };
}

/// Parameters of a row switch.
#[derive(Clone, Copy, Debug)]
pub struct RowSwitch {
    /// On-resistance, ohm.
    pub on_ohm: f64,
    /// Off-resistance, ohm.
    pub off_ohm: f64,
    /// Capacitance from drain to source, farad.
    pub drain_f: f64,
    /// Capacitance from gate to drain, farad.
    pub gate_drain_f: f64,
    /// Capacitance from gate to source, farad.
    pub gate_source_f: f64,
}

impl RowSwitch {
    /// One transistor of the FDG6335N.
    pub const FDG6335N: Self = Self {
        on_ohm: SWITCH_ON_OHM.value,
        off_ohm: SWITCH_OFF_OHM.value,
        drain_f: SWITCH_DRAIN_F.value,
        gate_drain_f: SWITCH_GATE_DRAIN_F.value,
        gate_source_f: SWITCH_GATE_SOURCE_F.value,
    };
}

/// Pins of a part with two equal ends.
const ENDS: &[(&str, &str)] = &[("1", "1"), ("2", "2")];

const fn resistor(
    ohm: f64,
    value: &'static str,
    number: &'static str,
    alternatives: &'static [&'static str],
    purpose: &'static str,
) -> PartType {
    PartType {
        number,
        manufacturer: "Yageo",
        alternatives,
        value,
        package: "0603",
        purpose,
        pins: ENDS,
        model: Model::Resistor(ohm),
    }
}

const fn capacitor(
    farad: f64,
    value: &'static str,
    number: &'static str,
    alternatives: &'static [&'static str],
    purpose: &'static str,
) -> PartType {
    PartType {
        number,
        manufacturer: "Murata",
        alternatives,
        value,
        package: "0603",
        purpose,
        pins: ENDS,
        model: Model::Capacitor(farad),
    }
}

/// Feedback resistor of a column amplifier. The sensitivity of the column has the tolerance of this resistor.
pub const FEEDBACK: PartType = resistor(
    FEEDBACK_OHM as f64,
    "33 kohm 0.1 %",
    "RT0603BRD0733KL",
    &["ERA-3AEB333V", "RC0603FR-0733KL (1 %)"],
    "feedback of a column amplifier",
);
/// Series resistor between a column amplifier and the converter.
pub const SERIES: PartType = resistor(
    150.0,
    "150 ohm 1 %",
    "RC0603FR-07150RL",
    &["ERJ-3EKF1500V", "CRCW0603150RFKEA"],
    "filter at the converter's input",
);
/// Resistor that returns a row to the virtual ground, or pulls the select line of the flash chip up.
pub const RESISTOR_10K: PartType = resistor(
    10_000.0,
    "10 kohm 1 %",
    "RC0603FR-0710KL",
    &["ERJ-3EKF1002V", "CRCW060310K0FKEA"],
    "returns a row to the virtual ground; pull-up",
);
/// Resistance of the lower resistor of the virtual ground's divider, ohm.
const DIVIDER_OHM: f64 = 10_000.0;
/// Upper resistor of the virtual ground's divider.
pub const DIVIDER_UPPER: PartType = resistor(
    DIVIDER_OHM * (REFERENCE_DIVISOR as f64 - 1.0),
    "100 kohm 0.1 %",
    "RT0603BRD07100KL",
    &["ERA-3AEB104V", "RC0603FR-07100KL (1 %)"],
    "divider of the virtual ground",
);
/// Lower resistor of the virtual ground's divider.
pub const DIVIDER_LOWER: PartType = resistor(
    DIVIDER_OHM,
    "10 kohm 0.1 %",
    "RT0603BRD0710KL",
    &["ERA-3AEB103V", "RC0603FR-0710KL (1 %)"],
    "divider of the virtual ground",
);
/// Pull-up resistor of a line that the controller does not drive while it is in reset.
pub const PULL_UP: PartType = resistor(
    100_000.0,
    "100 kohm 1 %",
    "RC0603FR-07100KL",
    &["ERJ-3EKF1003V", "CRCW0603100KFKEA"],
    "pull-up while the controller is in reset",
);
/// Pull-up resistor that switches the front end on while the controller does not drive the line. While the controller switches
/// the front end off, a current flows through this resistor.
pub const ON_PULL_UP: PartType = resistor(
    470_000.0,
    "470 kohm 1 %",
    "RC0603FR-07470KL",
    &["ERJ-3EKF4703V", "CRCW0603470KFKEA"],
    "switches the front end on while the controller is in reset",
);
/// Resistor that selects the side of the insole. Its model has 0.01 ohm, because the simulation divides by resistances.
pub const SIDE: PartType =
    resistor(0.01, "0 ohm", "RC0603JR-070RL", &["ERJ-3GEY0R00V"], "fitted on the board of a right insole only");
/// Feedback capacitor of a column amplifier, or capacitor that determines the rise time of the load switch.
pub const CAPACITOR_47P: PartType = capacitor(
    47e-12,
    "47 pF C0G 5 %",
    "GRM1885C1H470JA01D",
    &["CL10C470JB8NNNC", "CC0603JRNPO9BN470"],
    "stability of a column amplifier; rise time of the load switch",
);
/// Capacitor that filters an input of the converter.
pub const CAPACITOR_330P: PartType = capacitor(
    330e-12,
    "330 pF C0G 5 %",
    "GRM1885C1H331JA01D",
    &["CL10C331JB8NNNC", "CC0603JRNPO9BN331"],
    "filter at the converter's input",
);
/// Capacitor that filters the virtual ground. A capacitor of 10 nF would not be charged within
/// [`START_US`](plantar::firmware::front_end::START_US).
pub const FILTER: PartType = capacitor(
    1e-9,
    "1 nF C0G 5 %",
    "GRM1885C1H102JA01D",
    &["CL10C102JB8NNNC", "CC0603JRNPO9BN102"],
    "noise filter of the virtual ground",
);
/// Decoupling capacitor of an integrated circuit.
pub const DECOUPLING: PartType = capacitor(
    100e-9,
    "100 nF X7R 10 %",
    "GRM188R71H104KA93D",
    &["CL10B104KB8NNNC", "CC0603KRX7R9BB104"],
    "decoupling of an integrated circuit",
);
/// Capacitor at the input or the output of the load switch.
pub const BULK: PartType = capacitor(
    1e-6,
    "1 uF X5R 10 %",
    "GRM188R61E105KA12D",
    &["CL10A105KB8NNNC", "CC0603KRX5R8BB105"],
    "input and output of the load switch",
);
/// Four column amplifiers.
pub const QUAD: PartType = PartType {
    number: "TLV9054IPWR",
    manufacturer: "Texas Instruments",
    alternatives: &["OPA4376AIPWR (smaller offset)", "TLV9064IPWR (10 MHz)"],
    value: "quad operational amplifier, rail to rail, 5 MHz",
    package: "TSSOP-14",
    purpose: "holds four columns at the virtual ground",
    pins: &[
        ("1", "A OUT"),
        ("2", "A -"),
        ("3", "A +"),
        ("4", "V+"),
        ("5", "B +"),
        ("6", "B -"),
        ("7", "B OUT"),
        ("8", "C OUT"),
        ("9", "C -"),
        ("10", "C +"),
        ("11", "V-"),
        ("12", "D +"),
        ("13", "D -"),
        ("14", "D OUT"),
    ],
    model: Model::Amplifiers(&["A", "B", "C", "D"]),
};
/// The buffer of the virtual ground.
pub const BUFFER: PartType = PartType {
    number: "TLV9051IDBVR",
    manufacturer: "Texas Instruments",
    alternatives: &["OPA376AIDBVR (smaller offset)", "TLV9061IDBVR (10 MHz)"],
    value: "operational amplifier, rail to rail, 5 MHz",
    package: "SOT-23-5",
    purpose: "buffer of the virtual ground",
    pins: &[("1", "A OUT"), ("2", "V-"), ("3", "A +"), ("4", "A -"), ("5", "V+")],
    model: Model::Amplifiers(&["A"]),
};
/// Two row switches.
pub const ROW_SWITCH: PartType = PartType {
    number: "FDG6335N",
    manufacturer: "onsemi",
    alternatives: &["Si1922EDH-T1-GE3 (compare its output capacitance)"],
    value: "dual N-channel transistor, 0.4 ohm at 2.5 V",
    package: "SOT-363",
    purpose: "connects two rows to ground",
    pins: &[("1", "A S"), ("2", "A G"), ("6", "A D"), ("4", "B S"), ("5", "B G"), ("3", "B D")],
    model: Model::Switches(&["A", "B"]),
};
/// Decoder that selects one of 16 rows, or none.
pub const DECODER: PartType = PartType {
    number: "CD74HC4514M96",
    manufacturer: "Texas Instruments",
    alternatives: &["74HC4514D (Nexperia)"],
    value: "decoder from 4 to 16 lines, active high",
    package: "SOIC-24",
    purpose: "selects one row, or none",
    pins: &[
        ("1", "LE"),
        ("2", "A0"),
        ("3", "A1"),
        ("21", "A2"),
        ("22", "A3"),
        ("23", "/E"),
        ("24", "VCC"),
        ("12", "GND"),
        ("11", "Y0"),
        ("9", "Y1"),
        ("10", "Y2"),
        ("8", "Y3"),
        ("7", "Y4"),
        ("6", "Y5"),
        ("5", "Y6"),
        ("4", "Y7"),
        ("18", "Y8"),
        ("17", "Y9"),
        ("20", "Y10"),
        ("19", "Y11"),
        ("14", "Y12"),
        ("13", "Y13"),
        ("16", "Y14"),
        ("15", "Y15"),
    ],
    model: Model::Decoder,
};
/// Load switch of the front end's supply.
pub const LOAD_SWITCH: PartType = PartType {
    number: "TPS22917DBVR",
    manufacturer: "Texas Instruments",
    alternatives: &[],
    value: "load switch, active high",
    package: "SOT-23-6",
    purpose: "switches the supply of amplifiers and virtual ground",
    pins: &[("1", "VIN"), ("2", "GND"), ("3", "ON"), ("4", "CT"), ("5", "QOD"), ("6", "VOUT")],
    model: Model::LoadSwitch,
};
/// Flash chip for parameters, bonds, steps and updates.
pub const FLASH: PartType = PartType {
    number: "W25Q128JVSIQ",
    manufacturer: "Winbond",
    alternatives: &["W25Q64JVSSIQ (8 MiB)", "W25Q32JVSSIQ (4 MiB)", "W25Q16JVSSIQ (2 MiB)"],
    value: "NOR flash chip, 16 MiB",
    package: "SOIC-8, 5.3 mm wide",
    purpose: "stores parameters, bonds, steps and updates",
    pins: &[
        ("1", "/CS"),
        ("2", "DO"),
        ("3", "/WP"),
        ("4", "GND"),
        ("5", "DI"),
        ("6", "CLK"),
        ("7", "/HOLD"),
        ("8", "VCC"),
    ],
    model: Model::None,
};
/// The controller's board.
pub const CONTROLLER: PartType = PartType {
    number: "NUCLEO-WB55RG",
    manufacturer: "STMicroelectronics",
    alternatives: &["P-NUCLEO-WB55"],
    value: "board with an STM32WB55RG",
    package: "Arduino and morpho headers",
    purpose: "controller, converter, radio, supply and debugger",
    pins: &[
        ("3V3", "3V3"),
        ("GND", "GND"),
        ("PC0", "IN1"),
        ("PC1", "IN2"),
        ("PC2", "IN3"),
        ("PC3", "IN4"),
        ("PA0", "IN5"),
        ("PA1", "IN6"),
        ("PA2", "IN7"),
        ("PA3", "IN8"),
        ("PA4", "IN9"),
        ("PA5", "IN10"),
        ("PA6", "IN11"),
        ("PA7", "IN12"),
        ("PC4", "IN13"),
        ("PC5", "IN14"),
        ("PA8", "IN15"),
        ("PA9", "IN16"),
        ("PC6", "row address 0"),
        ("PC10", "row address 1"),
        ("PC12", "row address 2"),
        ("PB8", "row address 3"),
        ("PB9", "rows off"),
        ("PC11", "front end on"),
        ("PB12", "flash select"),
        ("PB13", "flash clock"),
        ("PB14", "flash data out"),
        ("PB15", "flash data in"),
        ("PA10", "side"),
    ],
    model: Model::Controller,
};
/// The connector of the sensor sheet. [`crate::netlist`] assigns its contacts to the lines of the sheet.
pub const CONNECTOR: PartType = PartType {
    number: "FH12-40S-0.5SH(55)",
    manufacturer: "Hirose",
    alternatives: &["541324062 (Molex)"],
    value: "connector for a flat cable, 40 contacts, 0.5 mm",
    package: "FH12-40S",
    purpose: "connects the sensor sheet",
    pins: &CONTACTS,
    model: Model::Sheet,
};

/// Number and name of each contact of the connector.
const CONTACTS: [(&str, &str); 40] = {
    const NUMBERS: [&str; 40] = [
        "1", "2", "3", "4", "5", "6", "7", "8", "9", "10", "11", "12", "13", "14", "15", "16", "17", "18", "19", "20",
        "21", "22", "23", "24", "25", "26", "27", "28", "29", "30", "31", "32", "33", "34", "35", "36", "37", "38",
        "39", "40",
    ];
    let mut contacts = [("", ""); 40];
    let mut i = 0;
    while i < NUMBERS.len() {
        contacts[i] = (NUMBERS[i], NUMBERS[i]);
        i += 1;
    }
    contacts
};
/// The sensor sheet itself, whose lines end at the connector.
pub const SHEET: PartType = PartType {
    number: "made to order",
    manufacturer: "",
    alternatives: &[],
    value: "piezoresistive sheet between 16 rows and 16 columns of 35 um copper, 0.4 mm wide; 3 kohm for a cell at 1000 kPa",
    package: "flat cable, 40 contacts, 0.5 mm",
    purpose: "240 cells; its layout is that of src/firmware/layout.rs",
    pins: &[],
    model: Model::None,
};
