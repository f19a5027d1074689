//! Conversion of codes to pressures, and detection of contact, compared with the sensor law evaluated in f64.

use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::calibrate::{CellCalibration, Curve, FULL_CODE, SensorLaw, is_saturated, zero_offset};
use plantar::pipeline::contact::{ContactCell, ContactRule, WHOLE};
use plantar::pipeline::setup::SetupCell;
use proptest::prelude::*;
use testkit::{LAW, SETUP, cell, code_of, curve, pressure_of};

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

/// A sensor law in which code and pressure are proportional.
const LINEAR: SensorLaw = SensorLaw { full_kpa: 600.0, exponent: 1.0 };

/// Sensor laws of resistive cells: the conductance increases at most in proportion to the pressure.
fn resistive_law() -> impl Strategy<Value = SensorLaw> {
    (200.0..2000.0f32, 0.3..=1.0f32).prop_map(|(full_kpa, exponent)| SensorLaw { full_kpa, exponent })
}

/// One cell, with its sensor curve, its offset and its share in contact after the last frame.
struct Probe {
    curve: Curve,
    offset: u16,
    cell: ContactCell,
    share: i32,
}

impl Probe {
    fn new(law: &SensorLaw, rule: &ContactRule, calibration: &CellCalibration) -> Self {
        let curve = curve(law);
        let cell = ContactCell::new(rule, &curve, calibration, 0.0);
        Self { curve, offset: calibration.offset, cell, share: 0 }
    }

    /// The share in contact after a frame with this code. The cell returns only the change of its share.
    fn share_at(&mut self, code: u16) -> u16 {
        let code = u32::from(code);
        let above_offset_kpa = self.curve.pressure_kpa((code as i32 - i32::from(self.offset)).max(0));
        self.share += match self.cell.is_unchanged(code) {
            true => self.cell.update_part(above_offset_kpa),
            false => self.cell.update(code, self.offset, above_offset_kpa),
        };
        u16::try_from(self.share).expect("a share is never negative")
    }
}

/// The exponent is that of the reference insole, 0.8, and the pressures begin at 1 % of the largest one.
#[test]
fn the_curve_is_within_a_thousandth_of_the_law() {
    for full_kpa in [200.0, 1000.0, 1500.0] {
        let law = SensorLaw { full_kpa, exponent: 0.8 };
        let curve = curve(&law);
        for code in code_of(&law, 0.01 * f64::from(full_kpa))..=u16::MAX {
            let (exact, got) = (pressure_of(&law, code), curve.pressure_kpa::<f64>(i32::from(code)));
            assert!((got / exact - 1.0).abs() <= 1e-3, "code {code}: {got} kPa, law {exact} kPa");
        }
    }
}

#[test]
fn the_curve_of_a_linear_sensor_is_exact() {
    let curve = curve(&LINEAR);
    for code in 1..=u16::MAX {
        let (exact, got) = (pressure_of(&LINEAR, code), curve.pressure_kpa::<f32>(i32::from(code)));
        assert!((f64::from(got) / exact - 1.0).abs() <= 1e-6, "code {code}: {got} kPa, law {exact} kPa");
    }
}

#[test]
fn code_0_is_no_pressure_and_full_code_is_full_pressure() {
    for exponent in [0.3, 0.8, 1.0, 3.0] {
        let law = SensorLaw { full_kpa: 800.0, exponent };
        let curve = curve(&law);
        assert_eq!(curve.pressure_kpa::<f32>(0), 0.0);
        let full_kpa: f32 = curve.pressure_kpa(i32::from(FULL_CODE));
        assert!((full_kpa / 800.0 - 1.0).abs() < 1e-5, "{full_kpa}");
    }
}

#[test]
fn zero_offset_is_the_mean_rounded_up() {
    assert_eq!(zero_offset([]), None);
    assert_eq!(zero_offset([5]), Some(5));
    assert_eq!(zero_offset([1, 2]), Some(2));
    assert_eq!(zero_offset([10, 20, 30]), Some(20));
    assert_eq!(zero_offset([0, 0, 0, 1]), Some(1));
    assert_eq!(zero_offset(std::iter::repeat_n(u16::MAX, 100_000)), Some(u16::MAX));
}

#[test]
fn saturation_starts_at_full_code() {
    assert!(!is_saturated(u32::from(FULL_CODE) - 1));
    assert!(is_saturated(u32::from(FULL_CODE)));
    assert!(is_saturated(u32::from(u16::MAX)));
}

#[test]
fn a_saturated_cell_is_reported_in_every_frame_and_in_its_region_only() {
    let mut insole = Insole::<f32, 2>::new();
    let cells = [cell(Region::Heel, 0.0, 0.0, 25.0), cell(Region::Hallux, 0.0, 200.0, 25.0)];
    insole.set_up(SETUP, cells.into_iter()).expect("the set-up is accepted");
    let hallux_full = [0, FULL_CODE];
    for (seq, codes) in [hallux_full, hallux_full, [FULL_CODE - 1; 2], hallux_full, [0, 0]].iter().enumerate() {
        insole.frame(seq as u32, codes);
        let saturated = insole.loads().map(|load| load.frame.saturated);
        let mut expected = [false; 8];
        expected[Region::Hallux as usize] = codes[1] == FULL_CODE;
        assert_eq!(saturated, expected, "frame {seq}");
    }
}

#[test]
fn contact_begins_at_on_kpa_and_ends_below_off_kpa() {
    // Pressures in kPa in the order of the frames, and whether the cell is then in contact.
    let sequence = [
        (0.0, false),
        (9.9, false),
        (10.0, true),
        (9.0, true),
        (7.6, true),
        (7.4, false),
        (9.9, false),
        (10.1, true),
        (500.0, true),
        (7.5, true),
        (0.0, false),
        (8.0, false),
    ];
    let calibrations = [
        CellCalibration::IDEAL,
        CellCalibration { offset: 300, gain: 1.0 },
        CellCalibration { offset: 40, gain: 2.5 },
        CellCalibration { offset: 1000, gain: 0.4 },
    ];
    for calibration in calibrations {
        let mut probe = Probe::new(&LAW, &ContactRule::COUNTED, &calibration);
        for (i, (pressure_kpa, in_contact)) in sequence.into_iter().enumerate() {
            let code = calibration.offset.saturating_add(code_of(&LAW, pressure_kpa / f64::from(calibration.gain)));
            let share = if in_contact { WHOLE } else { 0 };
            assert_eq!(probe.share_at(code), share, "sample {i}: {pressure_kpa} kPa, {calibration:?}");
        }
    }
}

#[test]
fn an_unloaded_cell_is_not_in_contact_under_any_law() {
    for exponent in [0.3, 0.8, 1.0, 2.0, 3.0] {
        for full_kpa in [10.0, 100.0, 1000.0, 1e5] {
            let law = SensorLaw { full_kpa, exponent };
            for rule in [ContactRule::COUNTED, ContactRule { on_kpa: 0.1, off_kpa: 0.1, full_kpa: 100.0 }] {
                let mut probe = Probe::new(&law, &rule, &CellCalibration { offset: 500, gain: 1.0 });
                assert_eq!(probe.share_at(500), 0, "{law:?} {rule:?}");
                probe.share_at(FULL_CODE);
                assert_eq!(probe.share_at(500), 0, "{law:?} {rule:?} after load");
                assert_eq!(probe.share_at(0), 0, "{law:?} {rule:?} below its offset");
            }
        }
    }
}

#[test]
fn a_threshold_above_the_full_scale_is_reached_at_full_code() {
    let law = SensorLaw { full_kpa: 100.0, exponent: 0.8 };
    let rule = ContactRule { on_kpa: 200.0, off_kpa: 150.0, full_kpa: 0.0 };
    let mut probe = Probe::new(&law, &rule, &CellCalibration::IDEAL);
    assert_eq!(probe.share_at(FULL_CODE - 1), 0);
    assert_eq!(probe.share_at(FULL_CODE), WHOLE);
}

#[test]
fn rules_and_calibrations_out_of_range_are_refused() {
    assert!(ContactRule::COUNTED.is_valid() && LAW.is_valid() && CellCalibration::IDEAL.is_valid());
    for (on_kpa, off_kpa, full_kpa) in [
        (10.0, 0.0, 0.0),
        (10.0, 10.1, 0.0),
        (10.0, -1.0, 0.0),
        (1001.0, 10.0, 0.0),
        (10.0, 7.5, 9.9),
        (10.0, 7.5, 2001.0),
        (10.0, 7.5, -1.0),
        (f32::NAN, 7.5, 0.0),
        (10.0, f32::NAN, 0.0),
        (10.0, 7.5, f32::NAN),
        (f32::INFINITY, 7.5, 0.0),
    ] {
        let rule = ContactRule { on_kpa, off_kpa, full_kpa };
        assert!(!rule.is_valid(), "{rule:?}");
    }
    for (full_kpa, exponent) in
        [(0.0, 0.8), (-5.0, 0.8), (2e5, 0.8), (f32::NAN, 0.8), (100.0, 0.29), (100.0, 3.1), (100.0, f32::NAN)]
    {
        let law = SensorLaw { full_kpa, exponent };
        assert!(!law.is_valid(), "{law:?}");
    }
    for (offset, gain) in
        [(0, 0.09), (0, 10.1), (0, f32::NAN), (0, f32::INFINITY), (FULL_CODE / 2, 1.0), (u16::MAX, 1.0)]
    {
        let calibration = CellCalibration { offset, gain };
        assert!(!calibration.is_valid(), "{calibration:?}");
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn the_curve_never_decreases(full_kpa in 1.0..1e5f32, exponent in 0.3..3.0f32) {
        let curve = curve(&SensorLaw { full_kpa, exponent });
        let mut last_kpa = 0.0;
        for code in 0..=i32::from(u16::MAX) {
            let pressure_kpa: f32 = curve.pressure_kpa(code);
            prop_assert!(pressure_kpa >= last_kpa, "code {}: {} after {}", code, pressure_kpa, last_kpa);
            last_kpa = pressure_kpa;
        }
    }

    #[test]
    fn first_code_at_returns_the_first_code_that_reads_the_pressure(law in resistive_law(), pressure_kpa in 0.1..1500.0f32) {
        let curve = curve(&law);
        let reads = |code: u16| curve.pressure_kpa::<f32>(i32::from(code)) >= pressure_kpa;
        prop_assert_eq!(curve.first_code_at(pressure_kpa), (0..u16::MAX).find(|&code| reads(code)).unwrap_or(u16::MAX));
    }

    /// The threshold is reached at its own code, in spite of the rounding of the pressure to a code.
    #[test]
    fn a_cell_is_in_contact_at_the_threshold_and_not_clearly_below_it(
        law in resistive_law(),
        on_share in 0.01..0.9f64,
        gain in 0.5..2.0f32,
        offset in 0u16..2000,
    ) {
        let on_kpa = (on_share * f64::from(law.full_kpa)) as f32;
        prop_assume!(on_kpa <= 1000.0 && on_kpa / gain < 0.9 * law.full_kpa);
        let calibration = CellCalibration { offset, gain };
        let rule = ContactRule { on_kpa, off_kpa: on_kpa, full_kpa: 0.0 };
        let uncalibrated_kpa = f64::from(on_kpa) / f64::from(gain);
        let mut probe = Probe::new(&law, &rule, &calibration);
        prop_assert_eq!(probe.share_at((code_of(&law, uncalibrated_kpa) + offset).min(FULL_CODE)), WHOLE);

        // To allow for rounding, this code is three below the first one that reads the threshold.
        let first = curve(&law).first_code_at(uncalibrated_kpa as f32);
        let mut probe = Probe::new(&law, &rule, &calibration);
        prop_assert_eq!(probe.share_at(first.saturating_sub(3) + offset), 0);
    }

    #[test]
    fn a_share_is_the_square_root_of_the_relative_pressure(
        full_kpa in 10.0..500.0f32,
        gain in 0.5..2.0f32,
        offset in 0u16..2000,
        codes in prop::collection::vec(0u16..=FULL_CODE, 1..100),
    ) {
        let rule = ContactRule { on_kpa: 10.0, off_kpa: 7.5, full_kpa };
        let mut probe = Probe::new(&LAW, &rule, &CellCalibration { offset, gain });
        let mut before = 0;
        for code in codes {
            let share = probe.share_at(code);
            let pressure_kpa =
                f64::from(gain) * curve(&LAW).pressure_kpa::<f64>(i32::from(code.saturating_sub(offset)));
            let threshold_kpa = if before > 0 { rule.off_kpa } else { rule.on_kpa };
            let exact = f64::from(WHOLE) * (pressure_kpa / f64::from(full_kpa)).min(1.0).sqrt();
            if share > 0 {
                // A saturated cell is in contact even if its pressure is below the threshold.
                prop_assert!(pressure_kpa >= f64::from(threshold_kpa) * 0.998 || is_saturated(code.into()));
                // A cell below the pressure of whole contact has less than a whole share.
                let most = if share < WHOLE { WHOLE - 1 } else { WHOLE };
                let exact = exact.min(f64::from(most));
                prop_assert!((f64::from(share) - exact).abs() <= 0.501, "{} is not {}", share, exact);
            } else {
                prop_assert!(pressure_kpa < f64::from(threshold_kpa) * 1.000_001, "{} kPa ignored", pressure_kpa);
            }
            before = share;
        }
    }

    #[test]
    fn single_and_double_precision_have_the_same_area(
        law in resistive_law(),
        full_kpa in prop_oneof![Just(0.0f32), 10.0..300.0f32],
        cells in prop::collection::vec((0usize..8, -50.0..50.0f32, -50.0..50.0f32, 1.0..100.0f32, 0u16..3000, 0.1..10.0f32), 1..64),
        frames in prop::collection::vec(prop::collection::vec(any::<u16>(), 64), 1..40),
    ) {
        let mut cells: Vec<_> = cells
            .into_iter()
            .map(|(region, x_mm, y_mm, area_mm2, offset, gain)| SetupCell {
                offset,
                gain,
                ..cell(Region::ALL[region], x_mm, y_mm, area_mm2)
            })
            .collect();
        cells.sort_by_key(|c| c.region);
        let contact = ContactRule { full_kpa, ..ContactRule::COUNTED };
        let setup = plantar::pipeline::setup::Setup { sensor: law, contact, ..SETUP };
        let mut single = Insole::<f32, 64>::new();
        let mut double = Insole::<f64, 64>::new();
        single.set_up(setup, cells.iter().copied()).expect("the set-up is accepted");
        double.set_up(setup, cells.iter().copied()).expect("the set-up is accepted");
        for (seq, codes) in frames.iter().enumerate() {
            // Many codes are near the thresholds.
            let codes: Vec<_> = codes.iter().map(|&c| if c % 2 == 0 { c } else { c / 16 }).collect();
            single.frame(seq as u32, &codes);
            double.frame(seq as u32, &codes);
            for (a, b) in single.loads().iter().zip(double.loads()) {
                prop_assert_eq!(a.frame.area, b.frame.area);
                prop_assert_eq!(a.frame.saturated, b.frame.saturated);
            }
        }
    }
}
