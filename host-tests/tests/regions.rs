//! The results of a whole insole for each frame, compared with a reference that sums up the cells of each frame in f64; and the
//! set-ups and tissue parameters that an insole accepts or refuses. The reference uses the library's sensor curve, which
//! `calibrate_contact.rs` compares with the sensor law.

use plantar::insole::Insole;
use plantar::pipeline::calibrate::{CellCalibration, Curve, FULL_CODE, SensorLaw};
use plantar::pipeline::contact::{ContactRule, WHOLE};
use plantar::pipeline::live::RegionLoad;
use plantar::pipeline::model::Ellipsoid;
use plantar::pipeline::region::{MAX_CELL_MM2, MAX_DISTANCE_MM, RegionFrame};
use plantar::pipeline::setup::{Setup, SetupCell, SetupError};
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::{Tissue, TissueError};
use plantar::protocol::Refusal;
use plantar::{Real, Region};
use proptest::prelude::*;
use std::collections::HashSet;
use testkit::{LAW, SETUP, TISSUE, cell, code_of, curve};

fn config() -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::default() }
}

/// The expected values of a region.
#[derive(Clone, Copy, Debug, Default)]
struct Truth {
    area_mm2: f64,
    /// Centre of the contact area.
    x_mm: f64,
    y_mm: f64,
    /// Variances of the contact area, mm2.
    variance_x: f64,
    variance_y: f64,
    force_n: f64,
    /// Centre of pressure.
    pressure_x_mm: f64,
    pressure_y_mm: f64,
    /// Largest pressure of a cell.
    peak_kpa: f64,
    saturated: bool,
}

/// A direct computation of all values. From frame to frame, it stores only which cells are in contact.
struct Reference {
    setup: Setup,
    curve: Curve,
    cells: Vec<SetupCell>,
    /// For each cell, the code at which its contact begins, the code below which its contact ends, and the code from which on it
    /// counts whole.
    thresholds: Vec<(u16, u16, u16)>,
    in_contact: Vec<bool>,
}

impl Reference {
    fn new(setup: Setup, cells: &[SetupCell]) -> Self {
        let curve = curve(&setup.sensor);
        // The code of a threshold is one below the first code with at least the pressure of the threshold, so that a cell with
        // exactly this pressure is in contact even if its code was rounded down.
        let code_at = |kpa: f32, c: &SetupCell| {
            let reads = |code: &u16| curve.pressure_kpa::<f32>(i32::from(*code) + 1) >= kpa / c.gain;
            (1..FULL_CODE).find(reads).unwrap_or(FULL_CODE).saturating_add(c.offset).min(FULL_CODE)
        };
        let rule = &setup.contact;
        let thresholds = cells
            .iter()
            .map(|c| {
                let full = if rule.full_kpa > 0.0 { code_at(rule.full_kpa, c) } else { 0 };
                (code_at(rule.on_kpa, c), code_at(rule.off_kpa, c), full)
            })
            .collect();
        Self { setup, curve, cells: cells.to_vec(), thresholds, in_contact: vec![false; cells.len()] }
    }

    fn pressure_kpa(&self, i: usize, code: u16) -> f64 {
        let SetupCell { offset, gain, .. } = self.cells[i];
        self.curve.pressure_kpa::<f64>(i32::from(code.saturating_sub(offset))) * f64::from(gain)
    }

    /// Share of a cell that is in contact, in units of 1/[`WHOLE`].
    fn share(&self, i: usize, code: u16) -> f64 {
        if !self.in_contact[i] {
            0.0
        } else if code >= self.thresholds[i].2 {
            f64::from(WHOLE)
        } else {
            let part = self.pressure_kpa(i, code) / f64::from(self.setup.contact.full_kpa);
            (part.sqrt() * f64::from(WHOLE)).round().clamp(1.0, f64::from(WHOLE) - 1.0)
        }
    }

    fn frame(&mut self, codes: &[u16]) -> [Truth; 8] {
        for (i, &code) in codes.iter().enumerate().take(self.cells.len()) {
            let (on, off, _) = self.thresholds[i];
            self.in_contact[i] = code >= if self.in_contact[i] { off } else { on };
        }
        Region::ALL.map(|region| self.region(region, codes))
    }

    fn region(&self, region: Region, codes: &[u16]) -> Truth {
        let mut truth = Truth::default();
        let members: Vec<_> = (0..self.cells.len()).filter(|&i| self.cells[i].region == region).collect();
        let (mut x, mut y, mut force_x, mut force_y) = (0.0, 0.0, 0.0, 0.0);
        let covered_mm2 = |i: usize| f64::from(self.cells[i].area_mm2) * self.share(i, codes[i]) / 256.0;
        for &i in &members {
            let c = &self.cells[i];
            let (area_mm2, x_mm, y_mm) = (f64::from(c.area_mm2), f64::from(c.x_mm), f64::from(c.y_mm));
            let force_n = self.pressure_kpa(i, codes[i]) * area_mm2 * 1e-3;
            truth.area_mm2 += covered_mm2(i);
            x += covered_mm2(i) * x_mm;
            y += covered_mm2(i) * y_mm;
            truth.force_n += force_n;
            force_x += force_n * x_mm;
            force_y += force_n * y_mm;
            truth.peak_kpa = truth.peak_kpa.max(self.pressure_kpa(i, codes[i]));
            truth.saturated |= codes[i] >= FULL_CODE;
        }
        (truth.x_mm, truth.y_mm) = (x / truth.area_mm2, y / truth.area_mm2);
        (truth.pressure_x_mm, truth.pressure_y_mm) = (force_x / truth.force_n, force_y / truth.force_n);
        for &i in &members {
            let c = &self.cells[i];
            let own_variance = f64::from(c.area_mm2) / 12.0;
            let weight = covered_mm2(i) / truth.area_mm2;
            truth.variance_x += weight * ((f64::from(c.x_mm) - truth.x_mm).powi(2) + own_variance);
            truth.variance_y += weight * ((f64::from(c.y_mm) - truth.y_mm).powi(2) + own_variance);
        }
        truth
    }
}

/// Cells in the order of their regions; some regions have no cells. The insole's fixed-point numbers represent the positions
/// and areas exactly.
fn layout() -> impl Strategy<Value = Vec<SetupCell>> {
    let place = (0usize..8, -1600i16..1600, -1600i16..1600, 16u16..1600);
    let one = (place, 0u16..4000, 0.2..5.0f32);
    let some_regions = prop::sample::subsequence((0..8).collect::<Vec<usize>>(), 1..=8);
    (some_regions, prop::collection::vec(one, 1..=256)).prop_map(|(regions, cells)| {
        let build = |((region, x, y, area), offset, gain): ((usize, i16, i16, u16), u16, f32)| SetupCell {
            offset,
            gain,
            ..cell(
                Region::ALL[regions[region % regions.len()]],
                f32::from(x) / 32.0,
                f32::from(y) / 32.0,
                f32::from(area) / 16.0,
            )
        };
        let mut cells: Vec<_> = cells.into_iter().map(build).collect();
        cells.sort_by_key(|c| c.region);
        cells
    })
}

fn setup() -> impl Strategy<Value = Setup> {
    let contact = (5.0..50.0f32, 0.3..=1.0f32, prop_oneof![Just(0.0f32), 1.0..10.0f32]);
    let law = (200.0..2000.0f32, 0.3..1.5f32);
    (contact, law).prop_map(|((on_kpa, off, full), (full_kpa, exponent))| Setup {
        contact: ContactRule { on_kpa, off_kpa: on_kpa * off, full_kpa: on_kpa * full },
        sensor: SensorLaw { full_kpa, exponent },
        ..SETUP
    })
}

/// Codes of all sizes. Many of them are small, near the thresholds.
fn code() -> impl Strategy<Value = u16> {
    prop_oneof![Just(0), 0u16..6000, any::<u16>(), Just(FULL_CODE)]
}

fn frames() -> impl Strategy<Value = Vec<Vec<u16>>> {
    prop::collection::vec(prop::collection::vec(code(), 256), 1..12)
}

fn new_insole<R: Real>(setup: Setup, cells: &[SetupCell]) -> Box<Insole<R, 256>> {
    let mut insole = Box::new(Insole::new());
    insole.set_up(setup, cells.iter().copied()).expect("the set-up is accepted");
    insole
}

/// Area of a region's cells, mm2.
fn region_area_mm2(cells: &[SetupCell], region: usize) -> f64 {
    cells.iter().filter(|c| c.region as usize == region).map(|c| f64::from(c.area_mm2)).sum()
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn frames_agree_with_the_reference(setup in setup(), cells in layout(), frames in frames()) {
        let mut reference = Reference::new(setup, &cells);
        let (mut double, mut single) = (new_insole::<f64>(setup, &cells), new_insole::<f32>(setup, &cells));
        for (seq, codes) in frames.iter().enumerate() {
            double.frame(seq as u32, codes);
            single.frame(seq as u32, codes);
            for (region, truth) in reference.frame(codes).iter().enumerate() {
                let (load, single_load) = (&double.loads()[region].frame, &single.loads()[region].frame);
                // The area of counted cells is exact. A share is rounded in single precision, and may differ by 1/256.
                let area_mm2 = load.area.area_mm2::<f64>();
                let margin_mm2 = if setup.contact.full_kpa > 0.0 { region_area_mm2(&cells, region) / 256.0 } else { 0.0 };
                prop_assert!((area_mm2 - truth.area_mm2).abs() <= margin_mm2, "{} is not {:?}", area_mm2, truth);
                prop_assert_eq!(load.area, single_load.area);
                prop_assert_eq!(load.saturated, truth.saturated);
                prop_assert_eq!(single_load.saturated, truth.saturated);

                let near = |got: f64, want: f64, tolerance: f64| (got - want).abs() <= tolerance * want.abs();
                prop_assert!(near(load.force.force_n, truth.force_n, 1e-12), "{:?} {:?}", load, truth);
                prop_assert!(near(single_load.force.force_n.into(), truth.force_n, 1e-5), "{:?} {:?}", single_load, truth);

                prop_assert!(near(load.peak_kpa, truth.peak_kpa, 1e-12), "{:?} {:?}", load, truth);
                prop_assert!(near(single_load.peak_kpa.into(), truth.peak_kpa, 1e-5), "{:?} {:?}", single_load, truth);

                match (double.centre_of_pressure_mm(region), single.centre_of_pressure_mm(region)) {
                    (Some((x, y)), Some((single_x, single_y))) => {
                        prop_assert!((x - truth.pressure_x_mm).abs() < 1e-9 && (y - truth.pressure_y_mm).abs() < 1e-9);
                        prop_assert!((f64::from(single_x) - truth.pressure_x_mm).abs() < 1e-3);
                        prop_assert!((f64::from(single_y) - truth.pressure_y_mm).abs() < 1e-3);
                    }
                    (None, None) => prop_assert_eq!(truth.force_n, 0.0),
                    other => prop_assert!(false, "{:?}", other),
                }

                let ellipse = double.ellipse(region);
                prop_assert_eq!(ellipse.is_some(), truth.area_mm2 > 0.0);
                if let Some(ellipse) = ellipse.filter(|_| margin_mm2 == 0.0) {
                    prop_assert!((ellipse.x_mm - truth.x_mm).abs() < 1e-9 && (ellipse.y_mm - truth.y_mm).abs() < 1e-9);
                    // The eigenvalues of the covariance are r_a^2 / 4 and r_b^2 / 4: their sum is its trace.
                    let trace = (ellipse.r_a_mm.powi(2) + ellipse.r_b_mm.powi(2)) / 4.0;
                    prop_assert!((trace - truth.variance_x - truth.variance_y).abs() < 1e-3, "{:?} {:?}", ellipse, truth);
                }
            }
        }
    }

    /// The insole rounds positions to 1/64 mm and areas to 1/16 mm2.
    #[test]
    fn rounding_a_layout_changes_an_area_by_at_most_1_32_mm2_per_cell(
        cells in prop::collection::vec((-100.0..100.0f32, -100.0..100.0f32, 0.5..200.0f32), 1..256),
    ) {
        let cells: Vec<_> = cells.iter().map(|&(x, y, area)| cell(Region::Toe2, x, y, area)).collect();
        let mut insole = new_insole::<f64>(SETUP, &cells);
        let codes = vec![FULL_CODE - 1; cells.len()];
        insole.frame(0, &codes);
        let truth = Reference::new(SETUP, &cells).frame(&codes)[Region::Toe2 as usize];
        let area_mm2 = insole.loads()[Region::Toe2 as usize].frame.area.area_mm2::<f64>();
        prop_assert!((area_mm2 - truth.area_mm2).abs() <= cells.len() as f64 / 32.0);
        let ellipse = insole.ellipse(Region::Toe2 as usize).expect("there is contact");
        // Rounded positions move the centre by at most 1/128 mm, and rounded areas by at most the relative error of the area
        // times the largest distance between cells.
        let margin_mm = 1.0 / 128.0 + 200.0 * cells.len() as f64 / 32.0 / truth.area_mm2;
        prop_assert!((ellipse.x_mm - truth.x_mm).abs() <= margin_mm, "{:?} {:?}", ellipse, truth);
        prop_assert!((ellipse.y_mm - truth.y_mm).abs() <= margin_mm, "{:?} {:?}", ellipse, truth);
    }
}

/// Pseudorandom numbers, the same in every run.
fn noise(seed: u32) -> impl FnMut() -> u16 {
    let mut state = seed.wrapping_mul(2_654_435_761).max(1);
    move || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 16) as u16
    }
}

/// A layout of random cells in all regions, the same in every run.
fn mixed_layout(count: usize) -> Vec<SetupCell> {
    let mut next = noise(7);
    let mut random = || f32::from(next()) / 65536.0;
    (0..count)
        .map(|i| SetupCell {
            offset: (random() * 500.0) as u16,
            gain: 0.5 + random(),
            ..cell(Region::ALL[i * 8 / count], random() * 90.0, random() * 260.0, 5.0 + 60.0 * random())
        })
        .collect()
}

/// The values of a frame, except for the largest counted area since the last heel strike, and whether a cell came into contact or
/// lost it. Those two also depend on the frames before.
fn without_history(load: &RegionLoad<f32>) -> RegionFrame<f32> {
    RegionFrame { counted: (load.frame.counted.0, 0), is_count_changed: false, ..load.frame }
}

#[test]
fn areas_and_forces_do_not_drift() {
    let cells = mixed_layout(64);
    let contact = ContactRule { full_kpa: 50.0, ..ContactRule::COUNTED };
    let setup = Setup { contact, ..SETUP };
    let (mut used, mut fresh) = (new_insole::<f32>(setup, &cells), new_insole::<f32>(setup, &cells));
    let mut next = noise(1);
    for seq in 0..100_000 {
        used.frame(seq, &core::array::from_fn::<u16, 64, _>(|_| next() / (1 + next() % 4)));
    }
    let last = core::array::from_fn::<u16, 64, _>(|_| next());
    for (seq, codes) in [[0; 64], last].iter().enumerate() {
        used.frame(100_000 + seq as u32, codes);
        fresh.frame(seq as u32, codes);
        for (a, b) in used.loads().iter().zip(fresh.loads()) {
            assert_eq!(without_history(a), without_history(b));
        }
    }
    used.frame(100_002, &[0; 64]);
    assert!(used.loads().iter().all(|load| without_history(load) == RegionLoad::NONE.frame));
}

#[test]
fn a_new_set_up_resets_the_measurement_but_not_the_tissue_parameters() {
    let cells = mixed_layout(64);
    let mut insole = new_insole::<f32>(SETUP, &cells);
    insole.set_tissue(&TISSUE).expect("the parameters are accepted");
    insole.frame(0, &[30_000; 64]);
    insole.set_up(Setup { layout_id: 8, ..SETUP }, cells[..8].iter().copied()).expect("the set-up is accepted");
    assert_eq!(insole.loads(), &[RegionLoad::NONE; 8]);
    assert_eq!((insole.cells(), insole.tissue_id(), insole.setup().map(|s| s.layout_id)), (8, TISSUE.id, Some(8)));
    assert!(!insole.on_ground());
    insole.frame(0, &[30_000; 8]);
    let heel = &insole.loads()[0];
    assert!(heel.tissue.model_n > 0.0, "the tissue must remain");
    assert!(insole.loads()[1..].iter().all(|load| load.frame.area.area_mm2::<f32>() == 0.0));
}

#[test]
fn a_frame_without_a_set_up_or_with_too_few_codes_is_ignored() {
    let mut insole = Insole::<f32, 64>::new();
    assert!(!insole.frame(0, &[FULL_CODE; 64]));
    assert!(insole.setup().is_none() && insole.whole_step().is_none());
    assert_eq!(insole.loads(), &[RegionLoad::NONE; 8]);
    insole.set_up(SETUP, mixed_layout(64).into_iter()).expect("the set-up is accepted");
    assert!(!insole.frame(0, &[FULL_CODE; 63]));
    assert_eq!(insole.loads(), &[RegionLoad::NONE; 8]);
}

fn try_set_up(setup: Setup, cells: &[SetupCell]) -> Result<(), SetupError> {
    Insole::<f32, 4>::new().set_up(setup, cells.iter().copied())
}

#[test]
fn an_invalid_period_sensor_law_or_rule_is_refused_with_its_kind() {
    let one = [cell(Region::Heel, 0.0, 0.0, 25.0)];
    assert_eq!(try_set_up(SETUP, &one), Ok(()));
    for period_us in [0, 1_999, 50_001, u32::MAX] {
        assert_eq!(try_set_up(Setup { period_us, ..SETUP }, &one), Err(SetupError::Period));
    }
    for period_us in [2_000, 50_000] {
        assert_eq!(try_set_up(Setup { period_us, ..SETUP }, &one), Ok(()));
    }
    let sensor = SensorLaw { exponent: 0.0, ..LAW };
    assert_eq!(try_set_up(Setup { sensor, ..SETUP }, &one), Err(SetupError::Sensor));
    let contact = ContactRule { off_kpa: 11.0, ..ContactRule::COUNTED };
    assert_eq!(try_set_up(Setup { contact, ..SETUP }, &one), Err(SetupError::Contact));
    let valid = StanceRule::ADAPTIVE;
    for stance in [
        StanceRule { release_n: 1001.0, ..valid },
        StanceRule { release_n: 0.0, ..valid },
        StanceRule { strike_n: 0.0, ..valid },
        StanceRule { strike_n: f32::NAN, ..valid },
        StanceRule { strike_n: 1001.0, ..valid },
        StanceRule { min_swing_ms: 0, ..valid },
        StanceRule { min_stance_ms: 2500, ..valid },
    ] {
        assert_eq!(try_set_up(Setup { stance, ..SETUP }, &one), Err(SetupError::Stance), "{stance:?}");
    }
}

#[test]
fn invalid_cells_are_refused_with_their_number() {
    let good = cell(Region::Toe2, 30.0, 200.0, 25.0);
    let heel = cell(Region::Heel, 0.0, 0.0, 25.0);
    assert_eq!(try_set_up(SETUP, &[]), Err(SetupError::NoCells));
    assert_eq!(try_set_up(SETUP, &[good; 4]), Ok(()));
    assert_eq!(try_set_up(SETUP, &[good; 5]), Err(SetupError::TooManyCells));
    assert_eq!(try_set_up(SETUP, &[heel, good, heel]), Err(SetupError::RegionOrder(2)));
    let far = |x_mm, y_mm| cell(Region::Toe2, x_mm, y_mm, 25.0);
    let with = |calibration| good.calibrated(calibration);
    // The reference point of a region is the middle of its cells: at 2.1 times the largest distance from another cell, a cell is
    // 1.05 times this distance from the reference point.
    let bad_cells = [
        far(f32::NAN, 0.0),
        far(0.0, f32::INFINITY),
        far(30.0 + 2.1 * MAX_DISTANCE_MM, 200.0),
        far(30.0, 200.0 - 2.1 * MAX_DISTANCE_MM),
        cell(Region::Toe2, 30.0, 200.0, 0.0),
        cell(Region::Toe2, 30.0, 200.0, -1.0),
        cell(Region::Toe2, 30.0, 200.0, f32::NAN),
        cell(Region::Toe2, 30.0, 200.0, MAX_CELL_MM2 * 1.01),
        with(CellCalibration { offset: FULL_CODE / 2, gain: 1.0 }),
        with(CellCalibration { offset: 0, gain: 0.0 }),
        with(CellCalibration { offset: 0, gain: f32::NAN }),
    ];
    for bad in bad_cells {
        assert_eq!(try_set_up(SETUP, &[heel, good, bad]), Err(SetupError::Cell(2)), "{bad:?}");
    }
    // Each cell is valid, but the total area of the cells is too large for a region.
    let large = vec![cell(Region::Heel, 0.0, 0.0, MAX_CELL_MM2); 126];
    let mut insole = Box::new(Insole::<f32, 256>::new());
    assert_eq!(insole.set_up(SETUP, large.iter().copied()), Err(SetupError::Cell(125)));
}

#[test]
fn invalid_tissue_is_refused_with_its_reason_and_changes_nothing() {
    let mut insole = Insole::<f32, 4>::new();
    insole.set_tissue(&TISSUE).expect("the parameters are accepted");
    let mut force_laws = TISSUE.force_laws;
    force_laws[Region::Hallux as usize].ab_m2 = 0.0;
    for (bad, reason) in [
        (Tissue::new(force_laws), TissueError::Region(Region::Hallux)),
        (Tissue { force_laws, ..*TISSUE }, TissueError::Id),
        (Tissue { id: TISSUE.id + 1, ..*TISSUE }, TissueError::Id),
        (Tissue::NONE, TissueError::Id),
        (Tissue::new(Tissue::NONE.force_laws), TissueError::Region(Region::Heel)),
    ] {
        assert_eq!(bad.check(), Err(reason));
        assert_eq!(insole.set_tissue(&bad), Err(reason));
    }
    assert_eq!(insole.tissue_id(), TISSUE.id);
}

#[test]
fn any_changed_bit_of_the_tissue_parameters_changes_their_id() {
    let ids: HashSet<u32> = (0..8 * 6 * 32)
        .map(|bit| {
            let mut force_laws = TISSUE.force_laws;
            let law = &mut force_laws[bit / 192];
            let values =
                [&mut law.ab_m2, &mut law.c_m, &mut law.stiffness_pa, &mut law.damping_pa_s, &mut law.n, &mut law.m];
            let value = values.into_iter().nth(bit / 32 % 6).expect("a force law has six numbers");
            *value = f32::from_bits(value.to_bits() ^ 1 << (bit % 32));
            Tissue::new(force_laws).id
        })
        .collect();
    assert_eq!(ids.len(), 8 * 6 * 32);
    assert!(!ids.contains(&TISSUE.id) && !ids.contains(&0));
}

#[test]
fn errors_name_the_cell_the_region_and_the_remedy() {
    assert!(SetupError::Cell(3).to_string().starts_with("cell 3: "));
    assert!(SetupError::RegionOrder(9).to_string().contains("cell 9"));
    let out_of_bounds = Refusal::from(TissueError::Region(Region::Toes35)).to_string();
    assert!(
        out_of_bounds.contains(Region::Toes35.name()) && out_of_bounds.contains("1e-8 to 4e-2 m2"),
        "{out_of_bounds}"
    );
    assert!(Refusal::from(TissueError::Id).to_string().contains("again"));
    assert!(Refusal::NotUnderstood.to_string().contains("update"));
}

/// The layout is the largest one that is accepted, and all of its cells are in contact.
#[test]
fn the_sums_of_the_largest_region_do_not_overflow() {
    let corner = |i: usize| {
        (
            if i.is_multiple_of(2) { -MAX_DISTANCE_MM } else { MAX_DISTANCE_MM },
            if i % 4 < 2 { -MAX_DISTANCE_MM } else { MAX_DISTANCE_MM },
        )
    };
    let cells: Vec<_> = (0..125).map(|i| cell(Region::Heel, corner(i).0, corner(i).1, MAX_CELL_MM2)).collect();
    let mut insole = new_insole::<f64>(SETUP, &cells);
    insole.frame(0, &[FULL_CODE - 1; 125]);
    assert_eq!(insole.loads()[0].frame.area.area_mm2::<f64>(), 500_000.0);
    let ellipse = insole.ellipse(0).expect("there is contact");
    let truth = Reference::new(SETUP, &cells).frame(&[FULL_CODE - 1; 125])[0];
    assert!((ellipse.x_mm - truth.x_mm).abs() < 1e-6 && (ellipse.y_mm - truth.y_mm).abs() < 1e-6);
    let trace = (ellipse.r_a_mm.powi(2) + ellipse.r_b_mm.powi(2)) / 4.0;
    assert!((trace / (truth.variance_x + truth.variance_y) - 1.0).abs() < 1e-9, "{ellipse:?} {truth:?}");
}

/// An ellipsoid is pressed at random positions onto a regular grid of cells. The pressure is proportional to the local
/// deformation (Eq. 3 of the paper that [`plantar::pipeline::model`] implements).
#[test]
fn covered_shares_give_a_more_accurate_area_than_counted_cells() {
    /// Size of a cell along x and y, mm.
    const CELL_MM: [f64; 2] = [5.08, 7.62];
    /// Number of cells along each axis.
    const SIDE: usize = 16;
    /// Number of points along each axis of a cell, at which the pressure is computed.
    const POINTS: usize = 12;
    let e = Ellipsoid { a_m: 0.03, b_m: 0.03, c_m: 0.015, d0_m: 0.012, k: 1.0, n: 0.0, c: 0.0, m: 0.0 };
    let cells: Vec<_> = (0..SIDE * SIDE)
        .map(|i| {
            let at = |k: usize, mm: f64| ((k as f64 + 0.5 - SIDE as f64 / 2.0) * mm) as f32;
            cell(Region::Heel, at(i % SIDE, CELL_MM[0]), at(i / SIDE, CELL_MM[1]), (CELL_MM[0] * CELL_MM[1]) as f32)
        })
        .collect();
    let deformation_m = 0.005;
    let (r_mm, _) = e.contact_radii_m(deformation_m);
    let r_mm = r_mm * 1e3;
    let true_mm2 = std::f64::consts::PI * r_mm * r_mm;
    // The pressure at the centre is 700 kPa. A cell at the edge of the contact that is just fully covered then reads 180 to
    // 280 kPa. It counts with its whole area, as every cell does from 150 kPa on.
    let stiffness_kpa_m = 700.0 / deformation_m;
    let area_mm2 = |rule: ContactRule, dx_mm: f64, dy_mm: f64| {
        let mut insole = new_insole::<f64>(Setup { contact: rule, ..SETUP }, &cells);
        let codes: Vec<u16> = cells
            .iter()
            .map(|c| {
                let points = (0..POINTS * POINTS).map(|i| {
                    let offset = |k: usize, mm: f64| ((k as f64 + 0.5) / POINTS as f64 - 0.5) * mm;
                    let x = f64::from(c.x_mm) + offset(i % POINTS, CELL_MM[0]) - dx_mm;
                    let y = f64::from(c.y_mm) + offset(i / POINTS, CELL_MM[1]) - dy_mm;
                    let q = x.hypot(y) / r_mm;
                    if q < 1.0 { stiffness_kpa_m * e.local_deformation_m(deformation_m, q) } else { 0.0 }
                });
                code_of(&LAW, points.sum::<f64>() / (POINTS * POINTS) as f64)
            })
            .collect();
        insole.frame(0, &codes);
        insole.loads()[0].frame.area.area_mm2::<f64>()
    };
    // The root mean square of the relative errors of the area.
    let relative_error = |rule: ContactRule| {
        let mut next = noise(3);
        let squares = (0..40).map(|_| {
            let mut offset = |mm: f64| f64::from(next()) / 65_536.0 * mm;
            (area_mm2(rule, offset(CELL_MM[0]), offset(CELL_MM[1])) / true_mm2 - 1.0).powi(2)
        });
        (squares.sum::<f64>() / 40.0).sqrt()
    };
    let (counted, covered) = (relative_error(ContactRule::COUNTED), relative_error(ContactRule::COVERED));
    println!("counted {counted:.3}, covered {covered:.3}");
    assert!(covered < 0.5 * counted, "counted {counted}, covered {covered}");
    assert!(covered < 0.08, "{covered}");
}
