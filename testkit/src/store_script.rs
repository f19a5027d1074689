//! Scripts: fixed sequences of actions on a store, with a check of the store's content after a loss of power in any operation of
//! its simulated flash chip.

use crate::fixtures::step;
use crate::nor_flash::{NorFlashChip, Torn, block_on};
use fastrand::Rng;
use plantar::Side;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::model::ForceLaw;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{BLOCK_CELLS, CalibrationBlock, CalibrationId};
use plantar::protocol::{Reset, Serial, Step};
use plantar::storage::flash_map::SMALL_LOG;
use plantar::storage::{Bonds, IdentityRecord, MAX_BONDS_BYTES, Record, StorageError, Store};

/// Number of cells of the insole.
pub const CELLS: usize = 40;
/// Identifier of the insole's layout.
const LAYOUT: u32 = 7;

/// An action on a store, which can take several write and erase operations of the chip, or none. The number of a variant that
/// stores a value determines this value.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Action {
    Tissue(u16),
    Identity(u16),
    Bonds(u16),
    Calibration(u16),
    Step,
    /// Acknowledges all steps except this number of the newest ones.
    AcknowledgeAllBut(u32),
    /// Opens the store again, as after a reset.
    Restart,
}

/// The content that a store should have.
#[derive(Clone, Debug, Default, PartialEq)]
struct Content {
    tissue: Option<u16>,
    identity: Option<u16>,
    bonds: Option<u16>,
    calibration: Option<u16>,
    boots: u32,
    /// The number of the oldest unacknowledged step, and the number of the next step.
    steps: (u32, u32),
}

impl Content {
    /// The content after a complete action.
    fn after(&self, action: Action) -> Self {
        let mut content = self.clone();
        match action {
            Action::Tissue(value) => content.tissue = Some(value),
            Action::Identity(value) => content.identity = Some(value),
            Action::Bonds(value) => content.bonds = Some(value),
            Action::Calibration(value) => content.calibration = Some(value),
            Action::Step => content.steps.1 += 1,
            Action::AcknowledgeAllBut(newest) => {
                content.steps.0 = content.steps.0.max(content.steps.1.saturating_sub(newest));
            }
            Action::Restart => content.boots += 1,
        }
        content
    }
}

fn tissue(value: u16) -> Tissue {
    let c_m = 0.01 + f32::from(value) * 1e-6;
    Tissue::new([ForceLaw { ab_m2: 2e-3, c_m, stiffness_pa: 5e5, damping_pa_s: 5e3, n: 1.2, m: 0.8 }; 8])
}

fn identity(value: u16) -> IdentityRecord {
    let side = if value.is_multiple_of(2) { Side::Left } else { Side::Right };
    IdentityRecord { side, serial: Serial::new(&format!("P{value}")).expect("the serial number is valid") }
}

/// Bonds of 40 to [`MAX_BONDS_BYTES`] bytes; the longest for `value` 0.
fn bonds(value: u16) -> Bonds {
    let len = MAX_BONDS_BYTES - usize::from(value) % (MAX_BONDS_BYTES - 40 + 1);
    Bonds((0..len).map(|i| (usize::from(value) + i) as u8).collect())
}

fn calibrations(value: u16) -> Vec<CellCalibration> {
    (0..CELLS as u16).map(|i| CellCalibration { offset: value % 30_000 + i, gain: 1.0 + f32::from(i) / 64.0 }).collect()
}

/// The blocks of a calibration, and the identifier of the whole calibration.
fn blocks(value: u16) -> (Vec<CalibrationBlock>, u32) {
    let cells = calibrations(value);
    let mut id = CalibrationId::new();
    id.add(&cells);
    let block =
        |cells: &[CellCalibration]| core::array::from_fn(|i| cells.get(i).copied().unwrap_or(CellCalibration::IDEAL));
    (cells.chunks(BLOCK_CELLS).map(block).collect(), id.id())
}

/// A store on a simulated chip.
type TestStore<'c> = Store<&'c mut NorFlashChip>;

/// Executes an action on a store that has this content.
async fn act(store: &mut TestStore<'_>, action: Action, content: &Content) -> Result<(), StorageError> {
    match action {
        Action::Tissue(value) => store.put(0, &tissue(value)).await,
        Action::Identity(value) => store.put(0, &identity(value)).await,
        Action::Bonds(value) => store.put(0, &bonds(value)).await,
        Action::Calibration(value) => {
            let (blocks, id) = blocks(value);
            for (number, block) in (0..).zip(&blocks) {
                store.put_calibration_block(number, block).await?;
            }
            assert!(store.put_calibration(LAYOUT, CELLS as u16, id).await?, "every block must be stored");
            Ok(())
        }
        Action::Step => {
            assert_eq!(store.push_record(step(content.steps.1)).await?, 0, "the log must have room");
            Ok(())
        }
        Action::AcknowledgeAllBut(newest) => match content.steps.1.checked_sub(newest + 1) {
            Some(last) if last >= content.steps.0 => store.acknowledge(last).await.map(|_| ()),
            _ => Ok(()),
        },
        Action::Restart => unreachable!("`run` opens another store for a restart"),
    }
}

async fn has_record<R: Record>(store: &mut TestStore<'_>, expected: Option<R>) -> bool {
    store.get::<R>(0).await.expect("the chip works") == expected
}

/// Checks that a store that was opened for this check has exactly the expected content. The opening counted one more boot.
///
/// # Errors
/// A description of the first item that differs.
async fn check_content(store: &mut TestStore<'_>, expected: &Content) -> Result<(), String> {
    let calibration = store.calibration(LAYOUT, CELLS as u16).await.expect("the chip works");
    let mut cells = Vec::new();
    if let Some(calibration) = &calibration {
        for block in 0..CELLS.div_ceil(BLOCK_CELLS) as u8 {
            cells.extend(
                store
                    .calibration_block(calibration, block)
                    .await
                    .expect("the chip works")
                    .expect("the block is stored"),
            );
        }
        cells.truncate(CELLS);
    }
    let mut steps: Vec<Step> = Vec::new();
    let more = store.records(None, |record| {
        steps.extend(record.step());
        true
    });
    assert!(!more.await.expect("the chip works"), "all steps must be read");
    let is_step = |(number, stored): (u32, &Step)| *stored == Step { boots_since: stored.boots_since, ..step(number) };
    let numbers = || steps.iter().map(|step| step.step);
    let contents = store.contents();
    let checks = [
        (has_record(store, expected.tissue.map(tissue)).await, "parameters"),
        (has_record(store, expected.identity.map(identity)).await, "identity"),
        (has_record(store, expected.bonds.map(bonds)).await, "bonds"),
        (cells == expected.calibration.map(calibrations).unwrap_or_default(), "calibration"),
        (numbers().eq(expected.steps.0..expected.steps.1), "steps"),
        ((expected.steps.0..).zip(&steps).all(is_step), "contents of steps"),
        (contents.next_record == expected.steps.1, "number of the next step"),
        (contents.start == expected.boots + 1, "number of boots"),
        (contents.erased == 0, "number of erased areas"),
    ];
    match checks.iter().find(|(is_met, _)| !is_met) {
        None => Ok(()),
        Some((_, item)) => Err(format!(
            "wrong {item}: {contents:?}, steps {:?}, expected {expected:?}",
            numbers().next().zip(numbers().next_back())
        )),
    }
}

/// A sequence of actions that stores items of every kind repeatedly, and the chip with which it begins.
pub struct Script {
    chip: NorFlashChip,
    /// The content of the store with which the script begins.
    before: Content,
    actions: Vec<Action>,
    /// Number of write and erase operations of the chip in the whole script.
    pub operations: u64,
    /// Number of erase operations of the chip in the whole script.
    pub erasures: u32,
}

impl Script {
    /// A script of `len` random actions on a chip on which `used` other random actions were executed before. The seed
    /// determines all actions.
    pub fn new(seed: u64, used: usize, len: usize) -> Self {
        let mut random = Rng::with_seed(seed);
        let mut action = || match random.u8(0..16) {
            0 => Action::Tissue(random.u16(..)),
            1 => Action::Identity(random.u16(..)),
            2 => Action::Bonds(random.u16(..)),
            3 => Action::Calibration(random.u16(..)),
            4 => Action::Restart,
            5..=7 => Action::AcknowledgeAllBut(random.u32(0..4)),
            _ => Action::Step,
        };
        let past: Vec<Action> = (0..used).map(|_| action()).collect();
        let actions = (0..len).map(|_| action()).collect();
        let mut chip = NorFlashChip::new(SMALL_LOG.end as usize);
        let (before, failed) = run(&mut chip, Content::default(), &past);
        assert!(failed.is_none(), "{failed:?} must succeed before the script");
        chip.operations = 0;
        chip.erasures.fill(0);
        let mut script = Self { chip, before, actions, operations: 0, erasures: 0 };
        let mut chip = script.chip.clone();
        let (_, failed) = run(&mut chip, script.before.clone(), &script.actions);
        assert!(failed.is_none(), "{failed:?} must succeed without a power cut");
        script.operations = chip.operations;
        script.erasures = chip.erasures.iter().sum();
        script
    }

    /// Runs the script with a power cut in operation `at` of the chip, counted from 0, at the moment `torn`. Opens the store
    /// again, and checks that its content is the one before or the one after the interrupted action, or lies between them if the
    /// action acknowledges several steps. Then stores items of every kind once more, which must succeed.
    ///
    /// # Errors
    /// A description of the item that is wrong.
    pub fn cut(&self, at: u64, torn: Torn) -> Result<(), String> {
        let mut chip = self.chip.clone();
        chip.cut = Some((at, torn));
        let (content, action) = run(&mut chip, self.before.clone(), &self.actions);
        let action = action.ok_or("the script ended before the cut")?;
        let mut chip = chip.restarted();
        let outcomes = outcomes(&content, action);
        let mut failures = Vec::new();
        let actual = outcomes.into_iter().find(|outcome| {
            // The check uses a copy of the chip, because opening the store counts a boot and so changes the chip.
            let mut chip = chip.clone();
            block_on(async {
                let mut store = Store::open(Some(&mut chip), Reset::Power).await;
                check_content(&mut store, outcome).await.map_err(|error| failures.push(error)).is_ok()
            })
        });
        let Some(actual) = actual else {
            return Err(format!("cut {torn:?} in operation {at}, {action:?}: {}", failures.join("; ")));
        };
        let again = [
            Action::Tissue(1),
            Action::Identity(2),
            Action::Bonds(0),
            Action::Calibration(4),
            Action::Step,
            Action::AcknowledgeAllBut(1),
        ];
        let (content, failed) = run(&mut chip, actual, &again);
        let result = match failed {
            Some(failed) => Err(format!("{failed:?} failed")),
            None => {
                block_on(async { check_content(&mut Store::open(Some(&mut chip), Reset::Power).await, &content).await })
            }
        };
        result.map_err(|error| format!("after a cut {torn:?} in operation {at}, {action:?}: {error}"))
    }
}

/// The contents that are allowed after an action during which power failed.
fn outcomes(before: &Content, action: Action) -> Vec<Content> {
    let after = before.after(action);
    match action {
        // Steps are deleted one by one, the oldest first.
        Action::AcknowledgeAllBut(_) => (before.steps.0..=after.steps.0.max(before.steps.0))
            .map(|oldest| Content { steps: (oldest, before.steps.1), ..before.clone() })
            .collect(),
        _ => vec![before.clone(), after],
    }
}

/// Opens the store and runs actions until all are complete or one fails, as after a power cut. Returns the content after the
/// complete actions, and the action that failed.
fn run(chip: &mut NorFlashChip, mut content: Content, actions: &[Action]) -> (Content, Option<Action>) {
    for session in actions.split(|action| *action == Action::Restart) {
        let cut = block_on(async {
            let mut store = Store::open(Some(&mut *chip), Reset::Power).await;
            if store.flash().is_some_and(|chip| chip.is_off()) {
                return Some(Action::Restart);
            }
            content = content.after(Action::Restart);
            for &action in session {
                if act(&mut store, action, &content).await.is_err() {
                    return Some(action);
                }
                content = content.after(action);
            }
            None
        });
        if cut.is_some() {
            return (content, cut);
        }
    }
    (content, None)
}
