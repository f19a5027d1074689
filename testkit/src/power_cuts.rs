//! Cuts power while the real firmware in QEMU stores data, and checks the stored data after the next start.

use client::{Client, Error, Framed};
use emulation::{EmulatorConfig, FLASH_BYTES};
use emulator::{Board, Hardware, Link, Recorded, Time};
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{CalibrationId, LoadRecord};
use plantar::protocol::{Serial, ToDevice, ToHost};
use recording::{Recording, VirtualInsole, synthetic};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest wait for the insole's answer.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Number of steps that the insole records in each session.
const STEPS: u32 = 3;
/// Number of status requests after which steps that have not arrived count as missing.
const MAX_REQUESTS: u32 = 50;

type Session = Client<Framed<Link>>;

/// A stored value, as far as a host knows it.
#[derive(Clone, Debug, PartialEq)]
struct Known<T> {
    /// The value that the insole has confirmed.
    confirmed: T,
    /// A newer value that was sent, but is not yet confirmed.
    pending: Option<T>,
}

impl<T: PartialEq + Clone> Known<T> {
    fn new(confirmed: T) -> Self {
        Self { confirmed, pending: None }
    }

    fn set_pending(&mut self, new: T) {
        self.pending = Some(new);
    }

    fn confirm(&mut self) {
        if let Some(new) = self.pending.take() {
            self.confirmed = new;
        }
    }

    /// True if the insole may have this value.
    fn allows(&self, found: &T) -> bool {
        *found == self.confirmed || self.pending.as_ref() == Some(found)
    }
}

/// The state of an insole, as far as a host knows it.
#[derive(Clone, Debug)]
struct KnownState {
    tissue_id: Known<u32>,
    serial: Known<Serial>,
    calibration_id: Known<u32>,
    /// Steps with lower numbers are acknowledged.
    acknowledged: Known<u32>,
    /// Steps with lower numbers have arrived.
    arrived: u32,
}

/// A test bench with one insole. All sessions of a round begin with the chip as the previous round left it.
pub struct Bench {
    firmware: PathBuf,
    /// The walk of each session.
    recording: Recording,
    virtual_insole: VirtualInsole,
    /// The content of the flash chip after the previous round.
    chip: Vec<u8>,
    /// The state of the insole with that chip.
    known: KnownState,
    /// Number of the present round, from 1; the values that a session stores depend on it.
    round: u16,
}

impl Bench {
    /// A bench with a new insole that runs the firmware in the file `firmware`.
    pub fn new(firmware: &Path) -> Self {
        let walk = synthetic::SyntheticWalk { steps: STEPS as usize, side: Side::Left, ..Default::default() };
        let recording = synthetic::walk(&walk).recording;
        let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let known = KnownState {
            tissue_id: Known::new(0),
            serial: Known::new(Serial::NONE),
            calibration_id: Known::new(0),
            acknowledged: Known::new(0),
            arrived: 0,
        };
        Self { firmware: firmware.into(), recording, virtual_insole, chip: vec![0xff; FLASH_BYTES], known, round: 0 }
    }

    /// Boots the firmware with this content of the flash chip, and connects to it. With `power_cut`, power fails in the write or
    /// erase operation with this number, counted from 0 at the start.
    fn switch_on(&self, chip: &[u8], power_cut: Option<u32>) -> (Board, Result<Session, Error>) {
        let config = EmulatorConfig { power_cut, ..EmulatorConfig::new(self.virtual_insole.setup) };
        let walk = Recorded::new(self.recording.clone(), self.virtual_insole.clone());
        let hardware = Hardware { flash: Some(chip.into()), ..Hardware::default() };
        let board =
            Board::start_with(&self.firmware, &config, &self.virtual_insole.cells, Time::Fastest, walk, &hardware);
        let board = board.expect("the board boots");
        let mut link = board.link().expect("the board has a link");
        link.set_read_timeout(Some(Duration::from_millis(20))).expect("a timeout");
        let client = Client::connect(Framed::new(link), TIMEOUT);
        (board, client)
    }

    /// Runs a session that stores items of every kind, with a power cut as in [`Self::switch_on`]. Returns the known state and
    /// the chip at its end, and whether power failed.
    fn session(&self, power_cut: Option<u32>) -> (KnownState, Vec<u8>, bool) {
        let (board, client) = self.switch_on(&self.chip, power_cut);
        let mut known = self.known.clone();
        let ended = client.and_then(|mut client| self.store_everything(&board, &mut client, &mut known));
        // A board without power closes the link.
        let was_cut = matches!(ended, Err(Error::Carrier(_) | Error::Closed(_)));
        assert!(was_cut || ended.is_ok(), "{ended:?}");
        (known, board.flash().expect("the chip can be read"), was_cut)
    }

    /// Stores items of every kind through `client`, and records in `known` which of them the insole has confirmed.
    fn store_everything(&self, board: &Board, client: &mut Session, known: &mut KnownState) -> Result<(), Error> {
        let round = self.round;
        let mut force_laws = Parameters::typical(InsoleSize::default()).tissue().force_laws;
        force_laws[0].stiffness_pa *= 1.0 + f32::from(round) * 1e-3;
        let tissue = Tissue::new(force_laws);
        known.tissue_id.set_pending(tissue.id);
        client.set_tissue(&tissue)?;
        known.tissue_id.confirm();

        let serial = Serial::new(&format!("P{round}")).expect("the serial number is valid");
        known.serial.set_pending(serial);
        client.set_identity(Side::Left, serial)?;
        known.serial.confirm();

        let gain = 1.0 + f32::from(round) * 1e-4;
        let cells = self.virtual_insole.cells.iter().map(|cell| CellCalibration { gain, ..cell.calibration() });
        let cells: Vec<_> = cells.collect();
        let mut id = CalibrationId::new();
        id.add(&cells);
        known.calibration_id.set_pending(id.id());
        client.calibrate(&cells)?;
        known.calibration_id.confirm();

        // The last step of each session remains unacknowledged.
        board.play();
        let last = known.arrived + STEPS;
        while known.arrived < last {
            if let Some(number) = client.receive()?.as_ref().and_then(LoadRecord::of).map(|record| record.number()) {
                known.arrived = known.arrived.max(number + 1);
                if number + 1 < last {
                    known.acknowledged.set_pending(number + 1);
                    client.send(ToDevice::Acknowledge { number })?;
                }
            }
        }
        // The insole handles requests in order: this answer confirms the acknowledgements before it.
        client.set_tissue(&tissue)?;
        known.acknowledged.confirm();
        Ok(())
    }

    /// Switches the insole on after a session, and compares its state with the known one.
    ///
    /// # Errors
    /// A description of the first item that differs.
    fn check(&self, known: &KnownState, chip: &[u8]) -> Result<(), String> {
        let (_board, client) = self.switch_on(chip, None);
        let mut client = client.map_err(|error| error.to_string())?;
        let tissue_id = client.hello().tissue_id;
        let identity = client.identity().map_err(|error| error.to_string())?;
        let status = client.status().map_err(|error| error.to_string())?;
        let (mut steps, mut requests) = (Vec::new(), 0);
        // At most six steps arrive before each answer.
        loop {
            let before = steps.len();
            client.send(ToDevice::GetStatus).map_err(|error| error.to_string())?;
            loop {
                match client.receive().map_err(|error| error.to_string())? {
                    Some(ToHost::Status(_)) => break,
                    Some(message) if let Some(record) = LoadRecord::of(&message) => {
                        let step = record.number();
                        steps.push(step);
                        client.send(ToDevice::Acknowledge { number: step }).map_err(|error| error.to_string())?;
                    }
                    _ => {}
                }
            }
            // After a start the insole reads its stored steps while it answers the first requests.
            let has_all =
                steps.last().map_or(known.acknowledged.confirmed, |last| last + 1) == status.contents.next_record;
            requests += 1;
            if steps.len() == before && (has_all || requests > MAX_REQUESTS) {
                break;
            }
        }
        let oldest = steps.first().copied().unwrap_or(status.contents.next_record);
        let is_gapless = steps.iter().copied().eq(oldest..status.contents.next_record);
        let latest = known.acknowledged.pending.unwrap_or(known.acknowledged.confirmed);
        let checks = [
            (known.tissue_id.allows(&tissue_id), "parameters"),
            (known.serial.allows(&identity.serial), "serial number"),
            (known.calibration_id.allows(&identity.calibration_id), "calibration"),
            (is_gapless && (known.acknowledged.confirmed..=latest).contains(&oldest), "oldest step"),
            // The insole may have recorded one more step than those that arrived.
            ((known.arrived..=known.arrived + 1).contains(&status.contents.next_record), "steps"),
            (status.contents.erased == 0 && status.not_stored == 0, "counters of the chip"),
        ];
        match checks.iter().find(|(is_met, _)| !is_met) {
            None => Ok(()),
            Some((_, item)) => Err(format!(
                "wrong {item}: steps {steps:?}, {identity:?}, parameters {tissue_id:x}, {status:?}, expected {known:?}"
            )),
        }
    }

    /// Repeats a session, each time with the chip as the previous round left it and with a power cut in another one of its write
    /// and erase operations: in every `stride`th one. Checks the insole's state after each cut, and ends with a session without a
    /// power cut. Returns the number of cuts.
    pub fn round(&mut self, stride: u32) -> u32 {
        self.round += 1;
        let mut cuts = 0;
        for operation in (self.round as u32 % stride..).step_by(stride as usize) {
            let (known, chip, was_cut) = self.session(Some(operation));
            if !was_cut {
                break;
            }
            cuts += 1;
            if let Err(error) = self.check(&known, &chip) {
                panic!("round {}, power cut in operation {operation}: {error}", self.round);
            }
        }
        let (known, chip, was_cut) = self.session(None);
        assert!(!was_cut, "a session without a power cut must be complete");
        (self.known, self.chip) = (known, chip);
        cuts
    }
}
