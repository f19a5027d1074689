//! The real firmware, switched off in the middle of keeping something, and on again.

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

const PATIENCE: Duration = Duration::from_secs(20);
const STEPS: u32 = 3;
/// Questions after which steps that did not come are missing.
const ROUNDS: u32 = 50;

type Session = Client<Framed<TcpStream>>;

/// What a host knows to be kept, and what may be instead, because the answer did not come.
#[derive(Clone, Debug, PartialEq)]
struct Known<T> {
    is: T,
    may_be: Option<T>,
}

impl<T: PartialEq + Clone> Known<T> {
    fn new(is: T) -> Self {
        Self { is, may_be: None }
    }

    fn begin(&mut self, new: T) {
        self.may_be = Some(new);
    }

    fn done(&mut self) {
        if let Some(new) = self.may_be.take() {
            self.is = new;
        }
    }

    fn holds(&self, found: &T) -> bool {
        *found == self.is || self.may_be.as_ref() == Some(found)
    }
}

/// What a host knows of an insole.
#[derive(Clone, Debug)]
struct Insole {
    tissue_id: Known<u32>,
    serial: Known<Serial>,
    calibration_id: Known<u32>,
    /// Steps before this one are acknowledged.
    acknowledged: Known<u32>,
    /// Steps before this one arrived.
    arrived: u32,
}

/// A bench with a chip that sessions wear out.
pub struct Bench {
    firmware: PathBuf,
    recording: Recording,
    worn: VirtualInsole,
    chip: Vec<u8>,
    insole: Insole,
    round: u16,
}

impl Bench {
    /// A new insole.
    pub fn new(firmware: &Path) -> Self {
        let walk = synthetic::SyntheticWalk { steps: STEPS as usize, side: Side::Left, ..Default::default() };
        let recording = synthetic::walk(&walk).recording;
        let worn = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
        let insole = Insole {
            tissue_id: Known::new(0),
            serial: Known::new(Serial::NONE),
            calibration_id: Known::new(0),
            acknowledged: Known::new(0),
            arrived: 0,
        };
        Self { firmware: firmware.into(), recording, worn, chip: vec![0xff; FLASH_BYTES], insole, round: 0 }
    }

    fn switch_on(&self, chip: &[u8], power_cut: Option<u32>) -> (Board, Result<Session, Error>) {
        let head = EmulatorConfig { power_cut, ..EmulatorConfig::new(self.worn.setup) };
        let walk = Recorded::new(self.recording.clone(), self.worn.clone());
        let hardware = Hardware { flash: Some(chip.into()), ..Hardware::default() };
        let board = Board::start_with(&self.firmware, &head, &self.worn.cells, Time::Max, walk, &hardware);
        let board = board.expect("the board boots");
        let link = board.link().expect("the link is there");
        link.set_read_timeout(Some(Duration::from_millis(20))).expect("a socket takes a time-out");
        let client = Client::connect(Framed::new(link), PATIENCE);
        (board, client)
    }

    /// A session in which everything is kept once; with `power_cut`, until power fails in that operation. False where it did not.
    fn session(&self, power_cut: Option<u32>) -> (Insole, Vec<u8>, bool) {
        let (board, client) = self.switch_on(&self.chip, power_cut);
        let mut insole = self.insole.clone();
        let ended = client.and_then(|mut client| self.keep_everything(&board, &mut client, &mut insole));
        let was_cut = matches!(ended, Err(Error::Carrier(_)));
        assert!(was_cut || ended.is_ok(), "{ended:?}");
        (insole, board.flash().expect("the chip can be read"), was_cut)
    }

    fn keep_everything(&self, board: &Board, client: &mut Session, insole: &mut Insole) -> Result<(), Error> {
        let round = self.round;
        let mut force_laws = Parameters::typical(InsoleSize::default()).tissue().force_laws;
        force_laws[0].stiffness_pa *= 1.0 + f32::from(round) * 1e-3;
        let tissue = Tissue::new(force_laws);
        insole.tissue_id.begin(tissue.id);
        client.set_tissue(&tissue)?;
        insole.tissue_id.done();

        let serial = Serial::new(&format!("P{round}")).expect("it is short and printable");
        insole.serial.begin(serial);
        client.set_identity(Side::Left, serial)?;
        insole.serial.done();

        let cells = self.worn.cells.iter().map(|cell| cell.calibration);
        let gain = 1.0 + f32::from(round) * 1e-4;
        let cells: Vec<_> = cells.map(|calibration| CellCalibration { gain, ..calibration }).collect();
        let mut id = CalibrationId::new();
        id.add(&cells);
        insole.calibration_id.begin(id.id());
        client.calibrate(&cells)?;
        insole.calibration_id.done();

        // The last step of each session is left unacknowledged.
        board.play();
        let last = insole.arrived + STEPS;
        while insole.arrived < last {
            if let Some(ToHost::Step(step)) = client.receive()? {
                insole.arrived = insole.arrived.max(step.step + 1);
                if step.step + 1 < last {
                    insole.acknowledged.begin(step.step + 1);
                    client.send(ToDevice::Acknowledge { step: step.step })?;
                }
            }
        }
        // What is answered as kept was asked for after the acknowledgements.
        client.set_tissue(&tissue)?;
        insole.acknowledged.done();
        Ok(())
    }

    /// Switches on what a session left, and tells what is not as it should be.
    fn check(&self, insole: &Insole, chip: &[u8]) -> Result<(), String> {
        let (_board, client) = self.switch_on(chip, None);
        let mut client = client.map_err(|error| error.to_string())?;
        let tissue_id = client.hello().tissue_id;
        let identity = client.identity().map_err(|error| error.to_string())?;
        let status = client.status().map_err(|error| error.to_string())?;
        let (mut steps, mut rounds) = (Vec::new(), 0);
        // Steps come before the answer to what is asked after them, six at a time.
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
            // At a start they are brought while the first questions are answered.
            let all = steps.last().map_or(insole.acknowledged.is, |last| last + 1) == status.contents.next_step;
            rounds += 1;
            if steps.len() == before && (all || rounds > ROUNDS) {
                break;
            }
        }
        let oldest = steps.first().copied().unwrap_or(status.contents.next_step);
        let whole = steps.iter().copied().eq(oldest..status.contents.next_step);
        let most = insole.acknowledged.may_be.unwrap_or(insole.acknowledged.is);
        let checks = [
            (insole.tissue_id.holds(&tissue_id), "parameters"),
            (insole.serial.holds(&identity.serial), "serial number"),
            (insole.calibration_id.holds(&identity.calibration_id), "calibration"),
            (whole && (insole.acknowledged.is..=most).contains(&oldest), "oldest step"),
            // One more than arrived may have been made.
            ((insole.arrived..=insole.arrived + 1).contains(&status.contents.next_step), "steps"),
            (status.contents.erased == 0 && status.not_stored == 0, "chip"),
        ];
        match checks.iter().find(|(holds, _)| !holds) {
            None => Ok(()),
            Some((_, what)) => {
                Err(format!("{what}: {steps:?}, {identity:?}, {tissue_id:x}, {status:?}, known {insole:?}"))
            }
        }
    }

    /// Cuts power in every `stride`th operation of a session, on the chip as the sessions before left it, and checks each time
    /// what is there afterwards. Returns the number of cuts.
    pub fn round(&mut self, stride: u32) -> u32 {
        self.round += 1;
        let mut cuts = 0;
        for at in (self.round as u32 % stride..).step_by(stride as usize) {
            let (insole, chip, was_cut) = self.session(Some(at));
            if !was_cut {
                break;
            }
            cuts += 1;
            if let Err(what) = self.check(&insole, &chip) {
                panic!("round {}, power cut in operation {at}: {what}", self.round);
            }
        }
        let (insole, chip, was_cut) = self.session(None);
        assert!(!was_cut, "nobody cut it");
        (self.insole, self.chip) = (insole, chip);
        cuts
    }
}
