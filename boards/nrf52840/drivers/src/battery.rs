//! The charge of a lithium-polymer cell, estimated from its voltage.

/// The resistors of the board's divider, kOhm: from the battery to the input, and from the input to ground.
const DIVIDER_KOHM: [u32; 2] = [1000, 510];
/// Full scale of the converter at the battery's input, mV: the internal reference of 0.6 V with a gain of 1/3.
const FULL_SCALE_MV: u32 = 1800;
/// Number of bits of a conversion.
const BITS: u32 = 12;

/// Voltages of a cell at a small load, mV, with their charges, percent. These are typical values, not those of a particular cell:
/// the voltage changes little between 20 % and 80 %, so the charge is accurate to some 10 %.
const CURVE: [(u32, u32); 9] =
    [(3300, 0), (3610, 5), (3690, 10), (3770, 30), (3840, 50), (3910, 65), (4020, 80), (4110, 90), (4200, 100)];

/// The battery's voltage, mV, for a code of the converter. Offsets can make a code negative.
pub fn millivolts(code: i16) -> u32 {
    let input_mv = (u32::from(code.max(0).unsigned_abs()) * FULL_SCALE_MV) >> BITS;
    input_mv * (DIVIDER_KOHM[0] + DIVIDER_KOHM[1]) / DIVIDER_KOHM[1]
}

/// The controller's supply, mV, for a code of the converter's own input VDD with a gain of 1/6: full scale is 3.6 V.
pub fn supply_millivolts(code: i16) -> u16 {
    // The result is at most 3600, because a code has 12 bits.
    ((u32::from(code.max(0).unsigned_abs()) * 2 * FULL_SCALE_MV) >> BITS) as u16
}

/// The charge of a cell with this voltage, percent: interpolated between the points of the curve.
pub fn percent(millivolts: u32) -> u8 {
    let above = CURVE.iter().position(|&(mv, _)| millivolts <= mv);
    let percent = match above {
        Some(0) => CURVE[0].1,
        Some(i) => {
            let ((low_mv, low), (high_mv, high)) = (CURVE[i - 1], CURVE[i]);
            low + (high - low) * (millivolts - low_mv) / (high_mv - low_mv)
        }
        None => 100,
    };
    // No point of the curve is above 100.
    percent as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_give_the_voltages_of_the_battery_and_of_the_supply() {
        // 4.2 V * 510 / 1510 = 1.4185 V = 3228 / 4096 of 1.8 V.
        assert!(millivolts(3228).abs_diff(4200) <= 3);
        // 3.7 V * 510 / 1510 = 1.2497 V = 2844 / 4096 of 1.8 V.
        assert!(millivolts(2844).abs_diff(3700) <= 3);
        assert_eq!(millivolts(-5), 0);
        // 3.3 V = 3755 / 4096 of 3.6 V.
        assert!(supply_millivolts(3755).abs_diff(3300) <= 1);
        assert_eq!(supply_millivolts(-5), 0);
    }

    #[test]
    fn the_charge_grows_with_the_voltage_from_0_to_100() {
        assert_eq!([0, 3300, 3730, 3840, 4200, 5000].map(percent), [0, 0, 20, 50, 100, 100]);
        assert!((3000..4400).all(|mv| percent(mv) <= percent(mv + 1)));
    }
}
