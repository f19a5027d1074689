//! A day in the life of a flash chip, and what must be true of it after a loss of power at any moment.

use crate::fixtures::step;
use crate::nor_flash::{NorFlashChip, Torn, now};
use fastrand::Rng;
use plantar::Side;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{BLOCK_CELLS, CalibrationBlock, CalibrationId};
use plantar::protocol::{Reset, Serial, Step};
use plantar::storage::flash_map::LOG;
use plantar::storage::{Bonds, IdentityRecord, MAX_BONDS_BYTES, Record, StorageError, Store};

/// Cells of the insole, and its layout.
pub const CELLS: usize = 40;
const LAYOUT: u32 = 7;

/// What is done to a store. Numbers make values: the same number, the same value.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Action {
    Tissue(u16),
    Name(u16),
    Bonds(u16),
    Calibration(u16),
    Step,
    /// All steps but the last so many.
    AcknowledgeBut(u32),
    Restart,
}

/// What is kept.
#[derive(Clone, Debug, Default, PartialEq)]
struct Kept {
    tissue: Option<u16>,
    name: Option<u16>,
    bonds: Option<u16>,
    calibration: Option<u16>,
    starts: u32,
    /// The oldest step that is not acknowledged, and the next one.
    steps: (u32, u32),
}

impl Kept {
    fn after(&self, action: Action) -> Self {
        let mut kept = self.clone();
        match action {
            Action::Tissue(value) => kept.tissue = Some(value),
            Action::Name(value) => kept.name = Some(value),
            Action::Bonds(value) => kept.bonds = Some(value),
            Action::Calibration(value) => kept.calibration = Some(value),
            Action::Step => kept.steps.1 += 1,
            Action::AcknowledgeBut(rest) => kept.steps.0 = kept.steps.0.max(kept.steps.1.saturating_sub(rest)),
            Action::Restart => kept.starts += 1,
        }
        kept
    }
}

fn tissue(value: u16) -> Tissue {
    let c_m = 0.01 + f32::from(value) * 1e-6;
    Tissue::new([ForceLaw { ab_m2: 2e-3, c_m, stiffness_pa: 5e5, damping_pa_s: 5e3, n: 1.2, m: 0.8 }; 8])
}

fn name(value: u16) -> IdentityRecord {
    let side = if value.is_multiple_of(2) { Side::Left } else { Side::Right };
    IdentityRecord { side, serial: Serial::new(&format!("P{value}")).expect("it is short and printable") }
}

fn bonds(value: u16) -> Bonds {
    let len = 40 + usize::from(value) % (MAX_BONDS_BYTES - 40);
    Bonds((0..len).map(|i| (usize::from(value) + i) as u8).collect())
}

fn calibrations(value: u16) -> Vec<CellCalibration> {
    (0..CELLS as u16).map(|i| CellCalibration { offset: value % 30_000 + i, gain: 1.0 + f32::from(i) / 64.0 }).collect()
}

fn parts(value: u16) -> (Vec<CalibrationBlock>, u32) {
    let cells = calibrations(value);
    let mut id = CalibrationId::new();
    id.add(&cells);
    let part =
        |cells: &[CellCalibration]| core::array::from_fn(|i| cells.get(i).copied().unwrap_or(CellCalibration::IDEAL));
    (cells.chunks(BLOCK_CELLS).map(part).collect(), id.id())
}

type Chip<'c> = Store<&'c mut NorFlashChip>;

async fn act(store: &mut Chip<'_>, action: Action, kept: &Kept) -> Result<(), StorageError> {
    match action {
        Action::Tissue(value) => store.put(0, &tissue(value)).await,
        Action::Name(value) => store.put(0, &name(value)).await,
        Action::Bonds(value) => store.put(0, &bonds(value)).await,
        Action::Calibration(value) => {
            let (parts, id) = parts(value);
            for (number, part) in (0..).zip(&parts) {
                store.put_calibration_block(number, part).await?;
            }
            assert!(store.put_calibration(LAYOUT, CELLS as u16, id).await?, "the parts are all there");
            Ok(())
        }
        Action::Step => {
            assert_eq!(store.push_step(&step(kept.steps.1)).await?, 0, "there is room");
            Ok(())
        }
        Action::AcknowledgeBut(rest) => match kept.steps.1.checked_sub(rest + 1) {
            Some(last) if last >= kept.steps.0 => store.acknowledge(last).await,
            _ => Ok(()),
        },
        Action::Restart => unreachable!("a restart makes another store"),
    }
}

async fn found<R: Record>(store: &mut Chip<'_>, wanted: Option<R>) -> bool {
    store.get::<R>(0).await.expect("the chip works") == wanted
}

/// Everything that `kept` says is there, and nothing else. The store was opened for this, which counts.
async fn holds(store: &mut Chip<'_>, kept: &Kept) -> Result<(), String> {
    let calibration = store.calibration(LAYOUT, CELLS as u16).await.expect("the chip works");
    let mut cells = Vec::new();
    if let Some(calibration) = &calibration {
        for part in 0..CELLS.div_ceil(BLOCK_CELLS) as u8 {
            cells.extend(
                store.calibration_block(calibration, part).await.expect("the chip works").expect("it is whole"),
            );
        }
        cells.truncate(CELLS);
    }
    let mut steps: Vec<Step> = Vec::new();
    let more = store.steps(None, |step| {
        steps.push(step);
        true
    });
    assert!(!more.await.expect("the chip works"), "all were taken");
    let is_step = |(number, kept): (u32, &Step)| *kept == Step { boots_since: kept.boots_since, ..step(number) };
    let numbers = || steps.iter().map(|step| step.step);
    let contents = store.contents();
    let checks = [
        (found(store, kept.tissue.map(tissue)).await, "parameters"),
        (found(store, kept.name.map(name)).await, "name"),
        (found(store, kept.bonds.map(bonds)).await, "bonds"),
        (cells == kept.calibration.map(calibrations).unwrap_or_default(), "calibration"),
        (numbers().eq(kept.steps.0..kept.steps.1), "steps"),
        ((kept.steps.0..).zip(&steps).all(is_step), "contents of steps"),
        (contents.next_step == kept.steps.1, "number of the next step"),
        (contents.start == kept.starts + 1, "number of starts"),
        (contents.erased == 0, "nothing erased"),
    ];
    match checks.iter().find(|(holds, _)| !holds) {
        None => Ok(()),
        Some((_, what)) => Err(format!(
            "{what}: {contents:?}, steps {:?}, wanted {kept:?}",
            numbers().next().zip(numbers().next_back())
        )),
    }
}

/// A script that keeps everything again and again, on a chip that has been used for a while.
pub struct Script {
    chip: NorFlashChip,
    before: Kept,
    actions: Vec<Action>,
    /// Writes and erasures of the whole script.
    pub operations: u64,
    /// Erasures among them.
    pub erasures: u32,
}

impl Script {
    /// A chip after `used` actions, and a script of `len` more.
    pub fn new(seed: u64, used: usize, len: usize) -> Self {
        let mut random = Rng::with_seed(seed);
        let mut action = || match random.u8(0..16) {
            0 => Action::Tissue(random.u16(..)),
            1 => Action::Name(random.u16(..)),
            2 => Action::Bonds(random.u16(..)),
            3 => Action::Calibration(random.u16(..)),
            4 => Action::Restart,
            5..=7 => Action::AcknowledgeBut(random.u32(0..4)),
            _ => Action::Step,
        };
        let past: Vec<Action> = (0..used).map(|_| action()).collect();
        let actions = (0..len).map(|_| action()).collect();
        let mut chip = NorFlashChip::new(LOG.end as usize);
        let (before, _) = run(&mut chip, Kept::default(), &past);
        chip.operations = 0;
        chip.erasures.fill(0);
        let mut script = Self { chip, before, actions, operations: 0, erasures: 0 };
        let mut chip = script.chip.clone();
        run(&mut chip, script.before.clone(), &script.actions);
        script.operations = chip.operations;
        script.erasures = chip.erasures.iter().sum();
        script
    }

    /// Cuts power in operation `at`, starts again, and tells what is neither as before nor as after the action that was cut.
    /// Then everything is kept once more, which must work.
    pub fn cut(&self, at: u64, torn: Torn) -> Result<(), String> {
        let mut chip = self.chip.clone();
        chip.cut = Some((at, torn));
        let (kept, action) = run(&mut chip, self.before.clone(), &self.actions);
        let action = action.ok_or("the script ended before the cut")?;
        let mut chip = chip.restarted();
        let outcomes = outcomes(&kept, action);
        let mut failures = Vec::new();
        let held = outcomes.into_iter().find(|outcome| {
            // Looking must not change what the next look sees, but for a start.
            let mut chip = chip.clone();
            now(async {
                let mut store = Store::open(Some(&mut chip), Reset::Power).await;
                holds(&mut store, outcome).await.map_err(|error| failures.push(error)).is_ok()
            })
        });
        let Some(held) = held else {
            return Err(format!("cut {torn:?} in operation {at}, {action:?}: {}", failures.join("; ")));
        };
        let again = [
            Action::Tissue(1),
            Action::Name(2),
            Action::Bonds(3),
            Action::Calibration(4),
            Action::Step,
            Action::AcknowledgeBut(1),
        ];
        let (kept, _) = run(&mut chip, held, &again);
        now(async { holds(&mut Store::open(Some(&mut chip), Reset::Power).await, &kept).await })
            .map_err(|error| format!("after a cut {torn:?} in operation {at}, {action:?}: {error}"))
    }
}

/// What may be kept after an action that was cut.
fn outcomes(kept: &Kept, action: Action) -> Vec<Kept> {
    let after = kept.after(action);
    match action {
        // Steps are forgotten one by one, the oldest first.
        Action::AcknowledgeBut(_) => (kept.steps.0..=after.steps.0.max(kept.steps.0))
            .map(|oldest| Kept { steps: (oldest, kept.steps.1), ..kept.clone() })
            .collect(),
        _ => vec![kept.clone(), after],
    }
}

/// Starts and runs actions until power fails; what was kept before the one in which it did, and that one.
fn run(chip: &mut NorFlashChip, mut kept: Kept, actions: &[Action]) -> (Kept, Option<Action>) {
    for sitting in actions.split(|action| *action == Action::Restart) {
        let cut = now(async {
            let mut store = Store::open(Some(&mut *chip), Reset::Power).await;
            if store.flash().is_some_and(|chip| chip.is_off()) {
                return Some(Action::Restart);
            }
            kept = kept.after(Action::Restart);
            for &action in sitting {
                if act(&mut store, action, &kept).await.is_err() {
                    return Some(action);
                }
                kept = kept.after(action);
            }
            None
        });
        if cut.is_some() {
            return (kept, cut);
        }
    }
    (kept, None)
}
