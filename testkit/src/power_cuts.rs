//! Power cuts while the real firmware stores data, and checks of the data after the next start.

use client::{Client, Error, Framed};
use emulation::{EmulatorConfig, FLASH_BYTES};
use emulator::{Board, Hardware, Recorded, Time};
use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::CalibrationId;
use plantar::protocol::{Serial, ToDevice, ToHost};
use recording::{Recording, VirtualInsole, synthetic};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest wait for the insole's answer.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Steps of a session.
const STEPS: u32 = 3;
/// Status requests after which steps that have not arrived count as missing.
const MAX_REQUESTS: u32 = 50;

type Session = Client<Framed<TcpStream>>;

/// A stored value, as far as a host knows it.
#[derive(Clone, Debug, PartialEq)]
struct Known<T> {
    /// The value that the insole has confirmed.
    confirmed: T,
    /// A newer value, of which the confirmation has not arrived.
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
    /// Steps before this one are acknowledged.
    acknowledged: Known<u32>,
    /// Steps before this one arrived.
    arrived: u32,
}

/// A test bench with one insole. Each session uses its chip as the session before left it.
pub struct Bench {
    firmware: PathBuf,
    recording: Recording,
    virtual_insole: VirtualInsole,
    chip: Vec<u8>,
    insole: KnownState,
    round: u16,
}

impl Bench {
    /// A new insole.
    pub fn new(firmware: &Path) -> Self {
        let walk = synthetic::SyntheticWalk { steps: STEPS as usize, side: Side::Left, ..Default::default() };
        let recording = synthetic::walk(&walk).recording;
        let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
        let insole = KnownState {
            tissue_id: Known::new(0),
            serial: Known::new(Serial::NONE),
            calibration_id: Known::new(0),
            acknowledged: Known::new(0),
            arrived: 0,
        };
        Self { firmware: firmware.into(), recording, virtual_insole, chip: vec![0xff; FLASH_BYTES], insole, round: 0 }
    }

    fn switch_on(&self, chip: &[u8], power_cut: Option<u32>) -> (Board, Result<Session, Error>) {
        let config = EmulatorConfig { power_cut, ..EmulatorConfig::new(self.virtual_insole.setup) };
        let walk = Recorded::new(self.recording.clone(), self.virtual_insole.clone());
        let hardware = Hardware { flash: Some(chip.into()), ..Hardware::default() };
        let board = Board::start_with(&self.firmware, &config, &self.virtual_insole.cells, Time::Max, walk, &hardware);
        let board = board.expect("the board boots");
        let link = board.link().expect("the board has a link");
        link.set_read_timeout(Some(Duration::from_millis(20))).expect("the socket accepts a timeout");
        let client = Client::connect(Framed::new(link), TIMEOUT);
        (board, client)
    }

    /// Runs a session that stores items of every kind; with `power_cut`, power fails in that operation. Returns the known state,
    /// the chip, and whether power failed.
    fn session(&self, power_cut: Option<u32>) -> (KnownState, Vec<u8>, bool) {
        let (board, client) = self.switch_on(&self.chip, power_cut);
        let mut insole = self.insole.clone();
        let ended = client.and_then(|mut client| self.store_everything(&board, &mut client, &mut insole));
        let was_cut = matches!(ended, Err(Error::Carrier(_)));
        assert!(was_cut || ended.is_ok(), "{ended:?}");
        (insole, board.flash().expect("the chip can be read"), was_cut)
    }

    fn store_everything(&self, board: &Board, client: &mut Session, insole: &mut KnownState) -> Result<(), Error> {
        let round = self.round;
        let mut force_laws = Parameters::typical(InsoleSize::default()).tissue().force_laws;
        force_laws[0].stiffness_pa *= 1.0 + f32::from(round) * 1e-3;
        let tissue = Tissue::new(force_laws);
        insole.tissue_id.set_pending(tissue.id);
        client.set_tissue(&tissue)?;
        insole.tissue_id.confirm();

        let serial = Serial::new(&format!("P{round}")).expect("short and printable");
        insole.serial.set_pending(serial);
        client.set_identity(Side::Left, serial)?;
        insole.serial.confirm();

        let cells = self.virtual_insole.cells.iter().map(|cell| cell.calibration);
        let gain = 1.0 + f32::from(round) * 1e-4;
        let cells: Vec<_> = cells.map(|calibration| CellCalibration { gain, ..calibration }).collect();
        let mut id = CalibrationId::new();
        id.add(&cells);
        insole.calibration_id.set_pending(id.id());
        client.calibrate(&cells)?;
        insole.calibration_id.confirm();

        // The last step of each session remains unacknowledged.
        board.play();
        let last = insole.arrived + STEPS;
        while insole.arrived < last {
            if let Some(ToHost::Step(step)) = client.receive()? {
                insole.arrived = insole.arrived.max(step.step + 1);
                if step.step + 1 < last {
                    insole.acknowledged.set_pending(step.step + 1);
                    client.send(ToDevice::Acknowledge { step: step.step })?;
                }
            }
        }
        // The insole handles requests in order: this answer confirms the acknowledgements before it.
        client.set_tissue(&tissue)?;
        insole.acknowledged.confirm();
        Ok(())
    }

    /// Switches the insole on after a session, and compares its state with the known one.
    fn check(&self, insole: &KnownState, chip: &[u8]) -> Result<(), String> {
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
                    Some(ToHost::Step(step)) => {
                        steps.push(step.step);
                        client.send(ToDevice::Acknowledge { step: step.step }).map_err(|error| error.to_string())?;
                    }
                    Some(ToHost::Status(_)) => break,
                    _ => {}
                }
            }
            // After a start the insole reads its stored steps while it answers the first requests.
            let all = steps.last().map_or(insole.acknowledged.confirmed, |last| last + 1) == status.contents.next_step;
            requests += 1;
            if steps.len() == before && (all || requests > MAX_REQUESTS) {
                break;
            }
        }
        let oldest = steps.first().copied().unwrap_or(status.contents.next_step);
        let is_gapless = steps.iter().copied().eq(oldest..status.contents.next_step);
        let most = insole.acknowledged.pending.unwrap_or(insole.acknowledged.confirmed);
        let checks = [
            (insole.tissue_id.allows(&tissue_id), "parameters"),
            (insole.serial.allows(&identity.serial), "serial number"),
            (insole.calibration_id.allows(&identity.calibration_id), "calibration"),
            (is_gapless && (insole.acknowledged.confirmed..=most).contains(&oldest), "oldest step"),
            // The insole may have recorded one step more than arrived.
            ((insole.arrived..=insole.arrived + 1).contains(&status.contents.next_step), "steps"),
            (status.contents.erased == 0 && status.not_stored == 0, "chip"),
        ];
        match checks.iter().find(|(is_met, _)| !is_met) {
            None => Ok(()),
            Some((_, item)) => {
                Err(format!("{item}: {steps:?}, {identity:?}, {tissue_id:x}, {status:?}, known {insole:?}"))
            }
        }
    }

    /// Cuts power in every `stride`th operation of a session, on the chip as the previous round left it, and checks the insole's
    /// state after each cut. Returns the number of cuts.
    pub fn round(&mut self, stride: u32) -> u32 {
        self.round += 1;
        let mut cuts = 0;
        for at in (self.round as u32 % stride..).step_by(stride as usize) {
            let (insole, chip, was_cut) = self.session(Some(at));
            if !was_cut {
                break;
            }
            cuts += 1;
            if let Err(error) = self.check(&insole, &chip) {
                panic!("round {}, power cut in operation {at}: {error}", self.round);
            }
        }
        let (insole, chip, was_cut) = self.session(None);
        assert!(!was_cut, "the session without a power cut failed");
        (self.insole, self.chip) = (insole, chip);
        cuts
    }
}
