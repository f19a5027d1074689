//! Sensor faults in walks of all kinds: how many faults are detected, how soon they are detected, and the effect of masked cells
//! on the model's force.

use emulation::COLUMNS;
use emulator::SensorFault;
use fit::{Options, Study};
use parameters::{InsoleSize, Parameters};
use plantar::faults::{FaultKind, Faults, Place};
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::{Region, Side};
use recording::{Recording, VirtualInsole, jiku, pedar, synthetic};
use std::path::Path;

/// A recording without faults.
pub struct Clean {
    /// The name of the recording in printed results.
    pub name: String,
    /// The recording.
    pub recording: Recording,
}

/// Computed walks at three rates.
pub fn computed() -> Vec<Clean> {
    let walk = |rate_hz| synthetic::SyntheticWalk { steps: 12, rate_hz, ..Default::default() };
    let clean = |rate_hz| Clean {
        name: format!("computed walk, {rate_hz} Hz"),
        recording: synthetic::walk(&walk(rate_hz)).recording,
    };
    [50.0, 100.0, 400.0].map(clean).into()
}

/// The barefoot walkers of the data set SpeedPP2DS from the package `jiku-data`; `jiku` is the folder of the data set.
pub fn barefoot(jiku: &Path) -> Vec<Clean> {
    let mut all = Vec::new();
    for walker in 0..10 {
        let walk = jiku::import(jiku, walker, 0..60, &mut |_, _| ()).expect("the data set can be read");
        for rate_hz in [50.0, 100.0] {
            let recording = walk.at_rate(rate_hz).and_then(|walk| walk.binned(DEVICE_CELLS));
            all.push(Clean {
                name: format!("barefoot walker {walker}, {rate_hz} Hz"),
                recording: recording.expect("a walk can be binned"),
            });
        }
    }
    all
}

/// The in-shoe recordings, which are in the subfolder `pedar` of `recordings`.
pub fn in_shoe(recordings: &Path) -> Vec<Clean> {
    let data = recordings.join("pedar");
    let clean = |side: Side| {
        let walk = pedar::import(data.join("pedar_example.asc"), data.join("geometry.csv"), side, &mut |_, _| ());
        Clean { name: format!("in shoe, {}", side.name()), recording: walk.expect("the recording can be read") }
    };
    [Side::Left, Side::Right].map(clean).into()
}

/// The results of an insole for a walk.
pub struct Outcome {
    /// The faults that the insole reports at the end of the walk.
    pub faults: Faults,
    /// Time of each toe off, s.
    pub toe_offs_s: Vec<f64>,
    /// For each frame, model force and measured force of each region, N.
    pub forces_n: Vec<[(f64, f64); 8]>,
}

/// Passes a recording with these sensor faults through an insole. Without `tissue` the insole has no parameters, and its model
/// force is 0.
pub fn walk(recording: &Recording, contact: ContactRule, tissue: Option<&Tissue>, faults: &[SensorFault]) -> Outcome {
    let virtual_insole = VirtualInsole::new(recording, contact, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("a recording's insole is valid");
    if let Some(tissue) = tissue {
        insole.set_tissue(tissue).expect("the parameters are valid");
    }
    let zeros: Vec<u16> = virtual_insole.cells.iter().map(|cell| cell.offset).collect();
    let mut codes = vec![0; zeros.len()];
    let (mut toe_offs_s, mut forces_n) = (Vec::new(), Vec::new());
    for i in 0..virtual_insole.frames(recording) {
        let t_s = i as f64 * f64::from(virtual_insole.setup.period_us) / 1e6;
        virtual_insole.codes_of(recording, i, &mut codes);
        faults.iter().for_each(|fault| fault.apply(t_s, &zeros, &mut codes));
        if insole.frame(i as u32, &codes) {
            toe_offs_s.push(t_s);
        }
        let force = |load: &plantar::pipeline::live::RegionLoad<f32>| {
            (f64::from(load.tissue.model_n), f64::from(load.frame.force.force_n))
        };
        forces_n.push(insole.loads().each_ref().map(force));
    }
    Outcome { faults: insole.faults().clone(), toe_offs_s, forces_n }
}

/// The detection of one kind of fault in one walk.
pub struct Detection {
    /// The kind of the injected faults, in the notation of [`SensorFault`].
    pub name: &'static str,
    /// Number of injected faults.
    pub injected: usize,
    /// Number of faults that were reported with the right kind and place by the end of the second complete step after the fault
    /// began, or that zero tracking corrected.
    pub found: usize,
    /// The longest time from the beginning of a fault to its report, s.
    pub longest_s: f64,
    /// Number of reported faults that were not injected. A reported cell does not count, whatever the kind of its fault, if it is
    /// faulty or in a faulty line.
    pub false_alarms: usize,
    /// The faults that were not found.
    pub missed: Vec<SensorFault>,
}

/// The injected faults: name in the notation of [`SensorFault`], kind, and value as in [`SensorFault::value`].
const INJECTED: [(&str, FaultKind, f64); 10] = [
    ("open-cell", FaultKind::Open, 0.0),
    ("short-cell", FaultKind::Short, 0.0),
    ("stuck", FaultKind::Stuck, 12_000.0),
    ("saturate", FaultKind::Saturated, 0.0),
    ("drift", FaultKind::Drift, 50.0),
    ("open-row", FaultKind::Open, 0.0),
    ("open-column", FaultKind::Open, 0.0),
    ("short-row", FaultKind::Short, 0.0),
    ("short-column", FaultKind::Short, 0.0),
    ("crosstalk", FaultKind::Crosstalk, 0.1),
];

/// Repeats a walk, each time with one fault that begins in the fifth step, at a random place that the walk loads: up to `count`
/// times for each kind of fault. The seed determines times and places.
pub fn detection(clean: &Clean, count: usize, seed: u64) -> Vec<Detection> {
    let recording = &clean.recording;
    let truth = walk(recording, ContactRule::COUNTED, None, &[]);
    let mut random = fastrand::Rng::with_seed(seed);
    let loaded = Loaded::new(recording, &truth.toe_offs_s);
    INJECTED
        .map(|(name, kind, value)| {
            let places = loaded.places(name);
            let mut detection =
                Detection { name, injected: 0, found: 0, longest_s: 0.0, false_alarms: 0, missed: Vec::new() };
            for _ in 0..count.min(4 * places.len()) {
                // A random time in the fifth step.
                let [before, after] = [truth.toe_offs_s[3], truth.toe_offs_s[4]];
                let from_s = before + random.f64() * (after - before);
                let fault = SensorFault { kind, place: places[random.usize(..places.len())], value, from_s };
                let outcome = walk(recording, ContactRule::COUNTED, None, &[fault]);
                // The sixth and the seventh step are the first two complete ones, each with its swing.
                let end_s = truth.toe_offs_s[6] + SWING_S;
                let is_same = |found: &&plantar::faults::Fault| found.kind == kind && found.place == fault.place;
                // A cell of the faulty line may be reported before the line is, and a faulty cell with another kind.
                let is_part = |found: &&plantar::faults::Fault| {
                    let cells: Vec<_> = fault.cells(recording.cells()).collect();
                    matches!(found.place, Place::Cell(cell) if cells.contains(&cell.into()))
                };
                let found_s = outcome.faults.list.iter().find(is_same).map(|found| f64::from(found.found_ms) / 1e3);
                // A drift that zero tracking corrects is not reported as a fault.
                let is_corrected = kind == FaultKind::Drift && outcome.faults.rezeroed > 0;
                detection.injected += 1;
                detection.false_alarms +=
                    outcome.faults.list.iter().filter(|found| !is_same(found) && !is_part(found)).count();
                match found_s {
                    _ if is_corrected => detection.found += 1,
                    Some(found_s) if found_s <= end_s => {
                        detection.found += 1;
                        detection.longest_s = detection.longest_s.max(found_s - from_s);
                    }
                    _ => detection.missed.push(fault),
                }
            }
            detection
        })
        .into()
}

/// One fault of each kind that [`detection`] injects. Each begins at `from_s`, at a place that the walk loads.
pub fn one_of_each(recording: &Recording, from_s: f64) -> Vec<SensorFault> {
    let truth = walk(recording, ContactRule::COUNTED, None, &[]);
    let loaded = Loaded::new(recording, &truth.toe_offs_s);
    INJECTED
        .into_iter()
        .map(|(name, kind, value)| {
            let places = loaded.places(name);
            // This drift is too fast for zero tracking.
            let value = if kind == FaultKind::Drift { 2_000.0 } else { value };
            SensorFault { kind, place: places[places.len() / 2], value, from_s }
        })
        .collect()
}

/// Approximate duration of a swing, s.
const SWING_S: f64 = 0.45;
/// Pressure above which a cell counts as loaded here, kPa. The code of this pressure is about twice that of 10 kPa, at which
/// contact begins by the contact rule.
const LOADED_KPA: f32 = 25.0;

/// The cells that each of the first eight steps of a walk loads, so that a fault of such a cell has an effect.
struct Loaded {
    /// For each cell, whether each of the first eight steps loads it.
    loaded: Vec<bool>,
    /// For each cell, whether each of these steps loads the cell and all of its eight neighbours.
    inner: Vec<bool>,
}

impl Loaded {
    fn new(recording: &Recording, toe_offs_s: &[f64]) -> Self {
        let virtual_insole = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let count = virtual_insole.cells.len();
        let mut loaded = vec![true; count];
        let mut from = 0;
        for toe_off_s in toe_offs_s.iter().take(8) {
            let to = (toe_off_s * recording.rate_hz) as usize;
            let mut peak_codes = vec![0u16; count];
            let mut codes = vec![0; count];
            for i in core::mem::replace(&mut from, to)..to {
                virtual_insole.codes_of(recording, i, &mut codes);
                peak_codes.iter_mut().zip(&codes).for_each(|(peak, &code)| *peak = code.max(*peak));
            }
            let law = virtual_insole.setup.sensor;
            let loaded_code = crate::code_of(&law, f64::from(LOADED_KPA));
            loaded.iter_mut().zip(&peak_codes).for_each(|(loaded, &peak)| *loaded &= peak > loaded_code);
        }
        let cells = &virtual_insole.cells;
        let is_inner = |i: usize| {
            let centre = &cells[i];
            let pitch_mm = centre.area_mm2.sqrt();
            let around: Vec<_> = (0..count)
                .filter(|&j| j != i)
                .map(|j| (j, cells[j].x_mm - centre.x_mm, cells[j].y_mm - centre.y_mm))
                .filter(|(_, dx, dy)| dx.abs().max(dy.abs()) <= 1.5 * pitch_mm)
                .collect();
            around.len() >= 8 && around.iter().all(|&(j, ..)| loaded[j])
        };
        let inner = (0..count).map(|i| loaded[i] && is_inner(i)).collect();
        Self { loaded, inner }
    }

    /// The places at which a fault of this kind, in the notation of [`SensorFault`], has an effect.
    fn places(&self, name: &str) -> Vec<Place> {
        let loaded_on =
            |on: &dyn Fn(usize) -> bool| (0..self.loaded.len()).filter(|&i| on(i) && self.loaded[i]).count();
        let cells = |loaded: &[bool]| (0..loaded.len()).filter(|&i| loaded[i]).map(|i| Place::Cell(i as u16)).collect();
        let lines = 0..COLUMNS as u8;
        match name {
            "open-cell" => cells(&self.inner),
            // A line is reported only if at least four of its cells have the fault.
            "open-row" | "short-row" | "crosstalk" => {
                lines.filter(|&row| loaded_on(&|i| i / COLUMNS == usize::from(row)) >= 4).map(Place::Row).collect()
            }
            "open-column" | "short-column" => lines
                .filter(|&column| loaded_on(&|i| i % COLUMNS == usize::from(column)) >= 4)
                .map(Place::Column)
                .collect(),
            _ => cells(&self.loaded),
        }
    }
}

/// The error of the model's force: its root mean square difference from the force measured without faults, from the end of the
/// fourth step on in the frames that load the region, relative to the region's peak force. Each value is the mean over the loaded
/// regions.
pub struct ModelError {
    /// The error without faults, %.
    pub clean_percent: f64,
    /// For each share of masked cells: the share, the mean error, and the largest error of all draws, %.
    pub masked: Vec<(u32, f64, f64)>,
}

/// Computes the error of the model's force with random masked cells, `draws` times for each share of masked cells. The parameters
/// are identified from the same walk. The seed determines the cells.
pub fn model_error(clean: &Clean, draws: usize, seed: u64) -> ModelError {
    let recording = &clean.recording;
    let contact = ContactRule::COUNTED;
    let virtual_insole = VirtualInsole::new(recording, contact, StanceRule::ADAPTIVE);
    let mut study = Study::new(clean.name.clone(), contact, Options::usual(InsoleSize::default().thickness_m()));
    study.add("walk".into(), recording, &virtual_insole, &mut |_| ()).expect("the recording is valid");
    study.fit(&|_| ());
    let mut parameters = Parameters::typical(InsoleSize::default());
    for (region, fit) in parameters.regions.iter_mut().zip(&study.fits) {
        if let Ok(fit) = fit {
            *region = fit.ellipsoid;
        }
    }
    let tissue = parameters.tissue();
    let truth = walk(recording, contact, Some(&tissue), &[]);
    // Shorted cells are detected within two steps, so all of them are masked from the fifth step on.
    let from = (truth.toe_offs_s[3] * recording.rate_hz) as usize;
    let error = |outcome: &Outcome| {
        let regions = (0..Region::ALL.len()).filter_map(|region| {
            let pairs =
                || outcome.forces_n.iter().zip(&truth.forces_n).skip(from).map(|(a, b)| (a[region].0, b[region].1));
            let peak_n = pairs().fold(0.0, |most: f64, (_, n)| most.max(n));
            let loaded: Vec<f64> = pairs().filter(|&(_, n)| n > 0.0).map(|(model, n)| (model - n).powi(2)).collect();
            (peak_n > 1.0).then(|| (loaded.iter().sum::<f64>() / loaded.len() as f64).sqrt() / peak_n * 100.0)
        });
        let errors: Vec<f64> = regions.collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    let mut random = fastrand::Rng::with_seed(seed);
    let masked = (1..=5)
        .map(|percent| {
            let errors: Vec<f64> = (0..draws)
                .map(|_| {
                    let count = recording.cells() * percent as usize / 100;
                    let cells = random.choose_multiple(0..recording.cells() as u16, count);
                    let short = |cell| SensorFault {
                        kind: FaultKind::Short,
                        place: Place::Cell(cell),
                        value: 0.0,
                        from_s: 0.0,
                    };
                    let faults: Vec<_> = cells.into_iter().map(short).collect();
                    error(&walk(recording, contact, Some(&tissue), &faults))
                })
                .collect();
            let largest = errors.iter().copied().fold(0.0, f64::max);
            (percent, errors.iter().sum::<f64>() / errors.len() as f64, largest)
        })
        .collect();
    ModelError { clean_percent: error(&truth), masked }
}
