//! The requests of a host, each with its answer. [`Client::receive`] returns the other messages that arrive before the answer.

use crate::session::{ANSWER, elapsed};
use crate::{Carrier, Client, Error};
use plantar::Side;
use plantar::faults::Faults;
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::baseline::{ZERO_S, ZeroResult};
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::setup::{DEVICE_CELLS, Setup, SetupCell};
use plantar::pipeline::tissue::{Identified, Tissue};
use plantar::protocol::{
    BLOCK_CELLS, CalibrationId, CellStream, Hello, Identity, SETUP_CELLS, Serial, Settings, Status, ToDevice, ToHost,
};
use std::time::Duration;

/// Time within which an insole must answer a request to erase the data of the wearer. With a typical erase time, a chip of
/// 16 MiB with a full log needs about three minutes.
const ERASURE: Duration = Duration::from_secs(300);

/// Time within which an insole must answer the requests for its status that follow the request to restart. It is short, because
/// an insole that restarts meanwhile does not answer. After the first such request that fails, [`ANSWER`] applies.
const ANSWER_BEFORE_RESTART: Duration = Duration::from_millis(250);

/// The errors of each request are [`Error::LostAnswer`], [`Error::Refused`] and those of the carrier.
impl<C: Carrier> Client<C> {
    /// The insole's counters. They arrive after the steps, load bouts and alerts that the insole could send before: while six are
    /// unacknowledged, later ones follow. Live frames, and frames of cells and ellipses, can still follow, too.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn status(&mut self) -> Result<Status, Error> {
        self.status_within(ANSWER)
    }

    fn status_within(&mut self, patience: Duration) -> Result<Status, Error> {
        self.request_within(patience, ToDevice::GetStatus, |message| match message {
            ToHost::Status(status) => Some(*status),
            _ => None,
        })
    }

    /// Sets the wearer's parameters. Returns once they are stored and in force for the next frames. Steps that have already ended
    /// still arrive with results of the previous parameters.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn set_tissue(&mut self, tissue: &Tissue) -> Result<(), Error> {
        self.request_tissue(ToDevice::SetTissue(*tissue), |in_force| in_force.id == tissue.id).map(drop)
    }

    /// The parameters that the insole uses; [`Tissue::NONE`] if it has none.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn tissue(&mut self) -> Result<Tissue, Error> {
        self.request_tissue(ToDevice::GetTissue, |_| true)
    }

    /// As [`Client::set_tissue`], for parameters that hold for one contact rule.
    ///
    /// # Errors
    /// See the `impl` block; [`plantar::protocol::Refusal::ContactRule`] if another rule is in force.
    pub fn set_identified_tissue(&mut self, tissue: &Tissue, identified: Identified) -> Result<(), Error> {
        let request = ToDevice::SetIdentifiedTissue { tissue: *tissue, identified };
        self.request_tissue(request, |in_force| in_force.id == tissue.id).map(drop)
    }

    /// How the parameters on the insole were identified; `None` if this is not known.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn identified(&mut self) -> Result<Option<Identified>, Error> {
        self.request(ToDevice::GetIdentified, |message| match message {
            ToHost::Identified(identified) => Some(*identified),
            _ => None,
        })
    }

    /// The settings for the next start of the insole: those in force, unless [`Client::set_settings`] has stored others since the
    /// last start. `None` stands for the board's own configuration.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn settings(&mut self) -> Result<Option<Settings>, Error> {
        self.request_settings(ToDevice::GetSettings)
    }

    /// Stores settings, or `None` for the board's own configuration. They are in force from the insole's next start on.
    ///
    /// # Errors
    /// See the `impl` block; [`plantar::protocol::Refusal::Settings`] if a value is out of range.
    pub fn set_settings(&mut self, settings: Option<Settings>) -> Result<(), Error> {
        self.request_settings(ToDevice::SetSettings(settings)).map(drop)
    }

    fn request_settings(&mut self, request: ToDevice) -> Result<Option<Settings>, Error> {
        self.request(request, |message| match message {
            ToHost::Settings(settings) => Some(*settings),
            _ => None,
        })
    }

    /// The rules of alerts in force.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn alert_rules(&mut self) -> Result<AlertRules, Error> {
        self.request(ToDevice::GetAlertRules, |message| match message {
            ToHost::AlertRules(rules) => Some(*rules),
            _ => None,
        })
    }

    /// Stores rules of alerts, which are in force from then on.
    ///
    /// # Errors
    /// See the `impl` block; [`plantar::protocol::Refusal::AlertRules`] if a value is out of range.
    pub fn set_alert_rules(&mut self, rules: &AlertRules) -> Result<(), Error> {
        self.request(ToDevice::SetAlertRules(*rules), |message| {
            matches!(message, ToHost::AlertRules(in_force) if in_force == rules).then_some(())
        })
    }

    /// Measures the baselines of all cells under the lifted foot.
    ///
    /// # Errors
    /// See the `impl` block; [`plantar::protocol::Refusal::NotLifted`] if the foot carries load or moves.
    pub fn zero(&mut self) -> Result<ZeroResult, Error> {
        // The insole accepts the request at the end of a second, and then counts whole seconds. The other three seconds are for
        // the answer.
        let patience = Duration::from_secs(u64::from(ZERO_S) + 4);
        self.request_within(patience, ToDevice::Zero, |message| match message {
            ToHost::Zero(result) => Some(*result),
            _ => None,
        })
    }

    /// The load of the day.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn daily_load(&mut self) -> Result<DailyLoad, Error> {
        self.request_daily_load(ToDevice::GetDailyLoad)
    }

    /// Requests that the insole raises no alerts for `snoozed_s` seconds. Returns the load of the day.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn snooze_alerts(&mut self, snoozed_s: u16) -> Result<DailyLoad, Error> {
        self.request_daily_load(ToDevice::SnoozeAlerts { snoozed_s })
    }

    fn request_daily_load(&mut self, request: ToDevice) -> Result<DailyLoad, Error> {
        self.request(request, |message| match message {
            ToHost::DailyLoad(daily) => Some(*daily),
            _ => None,
        })
    }

    fn request_tissue(&mut self, request: ToDevice, is_answer: impl Fn(&Tissue) -> bool) -> Result<Tissue, Error> {
        let tissue = self.request(request, |message| match message {
            ToHost::Tissue(tissue) if is_answer(tissue) => Some(*tissue),
            _ => None,
        })?;
        self.hello.tissue_id = tissue.id;
        Ok(tissue)
    }

    /// The identity that the insole has stored.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn identity(&mut self) -> Result<Identity, Error> {
        self.request_identity(ToDevice::GetIdentity)
    }

    /// Stores the foot and the serial number, which are in force from the insole's next start on. Returns the stored identity.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn set_identity(&mut self, side: Side, serial: Serial) -> Result<Identity, Error> {
        self.request_identity(ToDevice::SetIdentity { side, serial })
    }

    fn request_identity(&mut self, request: ToDevice) -> Result<Identity, Error> {
        self.request(request, |message| match message {
            ToHost::Identity(identity) => Some(*identity),
            _ => None,
        })
    }

    /// Erases everything about the wearer: parameters, rules of alerts, load of the day, bonds, and all stored steps, load bouts
    /// and alerts. The insole restarts afterwards.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn erase_wearer(&mut self) -> Result<(), Error> {
        let identity_answer = |message: &ToHost| matches!(message, ToHost::Identity(_)).then_some(());
        self.request_within(ERASURE, ToDevice::EraseWearer, identity_answer)
    }

    /// Stores the calibrations of all cells in the order of the insole's layout; they are in force from the insole's
    /// next start on. Returns the stored identity.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn calibrate(&mut self, cells: &[CellCalibration]) -> Result<Identity, Error> {
        let mut id = CalibrationId::new();
        id.add(cells);
        for (number, chunk) in (0..).zip(cells.chunks(BLOCK_CELLS)) {
            let mut padded = [CellCalibration::IDEAL; BLOCK_CELLS];
            padded[..chunk.len()].copy_from_slice(chunk);
            self.request(ToDevice::SetCalibrationBlock { block: number, cells: padded }, |message| {
                matches!(message, ToHost::CalibrationBlock { block } if *block == number).then_some(())
            })?;
        }
        let (layout_id, cells) = (self.hello.layout_id, cells.len() as u16);
        self.request_identity(ToDevice::SetCalibration { layout_id, cells, id: id.id() })
    }

    /// The faults that the insole detected in its sensor.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn faults(&mut self) -> Result<Faults, Error> {
        self.request(ToDevice::GetFaults, |message| match message {
            ToHost::Faults(faults) => Some(faults.clone()),
            _ => None,
        })
    }

    /// The configuration of the insole, except its cells.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn setup(&mut self) -> Result<Setup, Error> {
        self.request(ToDevice::GetSetup, |message| match message {
            ToHost::Setup(setup) => Some(*setup),
            _ => None,
        })
    }

    /// The cells of the insole with the calibration in force, in the order of their codes.
    ///
    /// # Errors
    /// See the `impl` block.
    pub fn setup_cells(&mut self) -> Result<Vec<SetupCell>, Error> {
        let mut all = Vec::new();
        loop {
            let next = all.len() as u16;
            let cells = self.request(ToDevice::GetSetupCells { first: next }, |message| match message {
                ToHost::SetupCells { first, cells } if *first == next => Some(cells.clone()),
                _ => None,
            })?;
            let is_last = cells.len() < SETUP_CELLS;
            all.extend(cells);
            // No insole has more cells, so that the loop ends whatever the insole sends.
            if is_last || all.len() >= DEVICE_CELLS {
                return Ok(all);
            }
        }
    }

    /// Turns the stream of cells on or, with `None`, off. It is off after a reconnection.
    ///
    /// # Errors
    /// See the `impl` block; if the carrier is too slow, [`plantar::protocol::Refusal::CellRate`] states the smallest accepted
    /// [`CellStream::every`], or 0 if none is accepted.
    pub fn stream_cells(&mut self, stream: Option<CellStream>) -> Result<(), Error> {
        let former = self.cells;
        let answer = self.request(ToDevice::StreamCells(stream), |message| {
            matches!(message, ToHost::CellStream(running) if *running == stream).then_some(())
        });
        match &answer {
            // This also answers a request of a retransmission.
            Ok(()) => self.cells_requested_us = None,
            // The former stream continues.
            Err(Error::Refused(_)) => self.cells = former,
            Err(_) => {}
        }
        answer
    }

    /// Turns the stream of ellipses on, for one frame in `every`, or off if `every` is 0. It is off after a reconnection. Returns
    /// once the insole has answered a later request, because it answers this one only by a refusal.
    ///
    /// # Errors
    /// See the `impl` block; [`plantar::protocol::Refusal::EllipseRate`] states the smallest accepted `every` if the rate is
    /// above 25 Hz.
    pub fn stream_ellipses(&mut self, every: u8) -> Result<(), Error> {
        let former = self.ellipses_every;
        self.send(ToDevice::StreamEllipses { every })?;
        let answer = self.status().map(drop);
        if let Err(Error::Refused(_)) = answer {
            // The former stream continues.
            self.ellipses_every = former;
        }
        answer
    }

    /// Restarts the insole and opens the session again within `patience`.
    ///
    /// # Errors
    /// See the `impl` block, and [`Client::reconnect`]; [`Error::NotRestarted`] if the insole answers, but did not restart within
    /// `patience`. If the restart closes the carrier, the error is that of the carrier: use [`Client::reconnect_over`] then.
    pub fn restart(&mut self, patience: Duration) -> Result<&Hello, Error> {
        let before = self.status()?;
        self.restart_after(&before, patience)
    }

    /// As [`Client::restart`]; `before` is the insole's status before the restart.
    pub(crate) fn restart_after(&mut self, before: &Status, patience: Duration) -> Result<&Hello, Error> {
        self.send(ToDevice::Restart)?;
        let sent_us = C::now_us();
        let (mut answer_patience, mut last) = (ANSWER_BEFORE_RESTART, Error::NotRestarted);
        while let Some(left) = patience.checked_sub(elapsed::<C>(sent_us)) {
            self.reconnect(left)?;
            // The hello may have been sent before the restart, so the counters decide.
            match self.status_within(answer_patience) {
                Ok(status) if status.is_after_restart(before) => return Ok(&self.hello),
                Ok(_) => last = Error::NotRestarted,
                // The insole has restarted meanwhile, or the carrier is slow and needs the usual time.
                Err(error) => (answer_patience, last) = (ANSWER, error),
            }
        }
        Err(last)
    }
}
