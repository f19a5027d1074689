//! The figures from data sheets that the simulation and its plots use, each with its source, and the assumptions of the
//! simulation.

/// How sure a figure is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Read in a public copy of the data sheet's text.
    Read,
    /// Stated from memory of the data sheet, which could not be opened: to be checked.
    ToBeChecked,
    /// An assumption of this design, to be measured.
    Assumed,
}

impl Status {
    /// The status as the table of the figures states it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::ToBeChecked => "from memory of the data sheet, to be checked",
            Self::Assumed => "assumption, to be measured",
        }
    }
}

/// A figure of a part.
#[derive(Clone, Copy, Debug)]
pub struct DataSheetFigure {
    /// The part.
    pub part: &'static str,
    /// The quantity.
    pub quantity: &'static str,
    /// The value in [`DataSheetFigure::unit`].
    pub value: f64,
    /// The unit, as in the table of the figures.
    pub unit: &'static str,
    /// The data sheet with its table, or the reason for an assumption.
    pub source: &'static str,
    /// How sure the figure is.
    pub status: Status,
}

macro_rules! figures {
    ($($name:ident: $part:literal, $quantity:literal, $value:literal $unit:literal, $source:literal, $status:ident;)*) => {
        $(
            #[doc = concat!($part, ": ", $quantity, ", ", $unit, ".")]
            pub const $name: DataSheetFigure = DataSheetFigure {
                part: $part,
                quantity: $quantity,
                value: $value,
                unit: $unit,
                source: $source,
                status: Status::$status,
            };
        )*
        /// All figures.
        pub const FIGURES: &[DataSheetFigure] = &[$($name),*];
    };
}

figures! {
    SUPPLY_V: "board", "supply voltage", 3.3 "V", "UM2435, supply of the Nucleo-WB55RG", ToBeChecked;

    AMPLIFIER_GAIN_BANDWIDTH_HZ: "TLV9054", "gain bandwidth product, typical", 5e6 "Hz",
        "SBOS942, section 6.7, frequency response", ToBeChecked;
    AMPLIFIER_SLEW_V_PER_S: "TLV9054", "slew rate, typical", 15e6 "V/s", "SBOS942, section 6.7, frequency response", ToBeChecked;
    AMPLIFIER_OPEN_LOOP_GAIN: "TLV9054", "open-loop voltage gain, 108 dB", 2.5e5 "V/V",
        "SBOS942, section 6.7, open-loop gain", ToBeChecked;
    AMPLIFIER_SECOND_POLE_HZ: "TLV9054", "second pole: 60 degrees of phase margin at unity gain", 7.5e6 "Hz",
        "SBOS942, section 6.7, phase margin", ToBeChecked;
    AMPLIFIER_OUTPUT_OHM: "TLV9054", "open-loop output impedance", 250.0 "ohm", "SBOS942, section 6.7, output", ToBeChecked;
    AMPLIFIER_OFFSET_V: "TLV9054", "input offset voltage, maximum at 25 degrees", 1.6e-3 "V",
        "SBOS942, section 6.7, offset voltage", ToBeChecked;
    AMPLIFIER_SWING_V: "TLV9054", "output swing from either rail, 10 kohm load, maximum", 16e-3 "V",
        "SBOS942, section 6.7, output", ToBeChecked;
    AMPLIFIER_NOISE_V_PER_SQRT_HZ: "TLV9054", "input voltage noise density at 10 kHz", 15e-9 "V/sqrt(Hz)",
        "SBOS942, section 6.7, noise", ToBeChecked;
    AMPLIFIER_INPUT_F: "TLV9054", "input capacitance, differential and common mode", 6e-12 "F",
        "SBOS942, section 6.7, input capacitance", ToBeChecked;
    AMPLIFIER_SUPPLY_A: "TLV9054", "quiescent current of each amplifier, typical", 330e-6 "A",
        "SBOS942, section 6.7, power supply", ToBeChecked;

    AMPLIFIER_LARGE_OUTPUT_OHM: "TLV9054", "open-loop output impedance, pessimistic", 600.0 "ohm",
        "2.4 times the typical value, because amplifiers of this class vary that much", Assumed;
    PRECISE_OFFSET_V: "OPA4376", "input offset voltage, maximum", 25e-6 "V", "SBOS406, offset voltage", ToBeChecked;

    SWITCH_ON_OHM: "FDG6335N", "on-resistance at a gate voltage of 2.5 V, maximum", 0.4 "ohm",
        "FDG6335N/D, general description", Read;
    SWITCH_OFF_OHM: "FDG6335N", "off-resistance at 0.3 V: a leakage of 10 nA", 30e6 "ohm",
        "FDG6335N/D, off characteristics; the maximum, 1 uA, is for 16 V", ToBeChecked;
    SWITCH_DRAIN_F: "FDG6335N", "output capacitance near 0 V, 2.5 times that at 10 V", 90e-12 "F",
        "FDG6335N/D, dynamic characteristics", ToBeChecked;
    SWITCH_GATE_DRAIN_F: "FDG6335N", "reverse transfer capacitance near 0 V, 2.5 times that at 10 V", 40e-12 "F",
        "FDG6335N/D, dynamic characteristics", ToBeChecked;
    SWITCH_GATE_SOURCE_F: "FDG6335N", "gate-source capacitance", 100e-12 "F", "FDG6335N/D, dynamic characteristics", ToBeChecked;

    MULTIPLEXER_ON_OHM: "ADG706", "on-resistance with a supply of 3 V, maximum", 12.0 "ohm",
        "ADG706/ADG707 Rev. A, specifications for 3 V", Read;
    MULTIPLEXER_TYPICAL_OHM: "ADG706", "on-resistance with a supply of 3 V, typical", 6.0 "ohm",
        "ADG706/ADG707 Rev. A, specifications for 3 V", Read;
    LOGIC_MULTIPLEXER_TYPICAL_OHM: "CD74HC4067", "on-resistance with a supply of 4.5 V, typical", 70.0 "ohm",
        "SCHS209C, features", Read;

    DECODER_OUTPUT_OHM: "CD74HC4514", "resistance of an output at 3.3 V", 100.0 "ohm",
        "SCHS280, output voltage at 4 mA", ToBeChecked;
    LOAD_SWITCH_ON_OHM: "TPS22917", "on-resistance at 3.6 V, typical", 0.09 "ohm", "SLVSDW8B, electrical characteristics", Read;
    LOAD_SWITCH_OFF_OHM: "TPS22917", "off-resistance: a leakage of 10 nA at 3.3 V", 330e6 "ohm",
        "SLVSDW8B, electrical characteristics", Read;
    LOAD_SWITCH_OPEN_ON_S: "TPS22917", "turn-on time, to 90 % of the output, at 3.6 V without a capacitor at CT, typical",
        120e-6 "s", "SLVSDW8B, section 7.6", Read;
    LOAD_SWITCH_SLOW_ON_S: "TPS22917", "turn-on time, to 90 % of the output, at 3.6 V with 100 pF at CT, typical", 380e-6 "s",
        "SLVSDW8B, section 7.6", Read;
    LOAD_SWITCH_OPEN_V_PER_S: "TPS22917", "slew rate of the output at 3.6 V without a capacitor at CT, typical", 44e3 "V/s",
        "SLVSDW8B, section 7.6", Read;
    LOAD_SWITCH_SLOW_V_PER_S: "TPS22917", "slew rate of the output at 3.6 V with 100 pF at CT, typical", 19e3 "V/s",
        "SLVSDW8B, section 7.6", Read;
    LOAD_SWITCH_SUPPLY_A: "TPS22917", "quiescent current", 0.5e-6 "A", "SLVSDW8B, electrical characteristics", Read;

    CONVERTER_SAMPLE_F: "STM32WB55", "sampling capacitor of the converter", 5e-12 "F",
        "DS11929, ADC characteristics", ToBeChecked;
    CONVERTER_SWITCH_OHM: "STM32WB55", "resistance of the sampling switch", 1000.0 "ohm",
        "DS11929, ADC characteristics", ToBeChecked;
    CONVERTER_NOISE_LSB: "STM32WB55", "noise of a conversion of 12 bits: a signal-to-noise ratio of 66 dB", 0.73 "LSB",
        "DS11929, ADC accuracy", ToBeChecked;

    SHEET_LINE_F: "sensor sheet", "capacitance of a line", 200e-12 "F", "estimate for a flexible sheet of this size", Assumed;
    SHEET_LINE_OHM: "sensor sheet", "resistance of a line: 300 mm of 35 um copper, 0.4 mm wide", 0.4 "ohm",
        "0.49 mohm per square", Assumed;
}
