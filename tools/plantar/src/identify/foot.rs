//! One insole in a guided session.

use super::screen::Progress;
use crate::carrier::{AnyClient, InsoleLink, link_problem};
use crate::cells::{CellRecorder, start_slowly};
use crate::params;
use anyhow::{Context, Result, bail, ensure};
use client::{Error, Event, SessionStart, StartedCells, StreamFile};
use fit::live::LiveSteps;
use fit::steps::{ExcludedContact, ExclusionReason};
use parameters::Parameters;
use plantar::Side;
use plantar::pipeline::calibrate::{CellCalibration, zero_offset};
use plantar::pipeline::contact::ContactRule;
use plantar::protocol::{
    CalibrationId, CellFrame, CellStream, LoadRecord, Refusal, Resolution, SUFFICIENT_SUPPLY_MV, Step, ToDevice, ToHost,
};
use recording::{Recording, StandingTrial, StreamedCells};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Parts of a recording of cells are completed after this time.
const PART_TIME: Duration = Duration::from_secs(30);
/// The stream that is recorded during the walk.
const ALL_CELLS: CellStream = CellStream { resolution: Resolution::Converter, every: 1 };
/// Time without a step after which a hint is shown.
const NO_STEP: Duration = Duration::from_secs(6);

/// One insole and its files.
pub struct Foot {
    /// The connection to the insole.
    pub link: InsoleLink,
    /// The foot that the insole is for.
    pub side: Side,
    /// The folder of this foot.
    pub folder: PathBuf,
    /// Stream files of earlier sessions that [`Self::stream_files`] omits, because they cannot be read or contain neither live
    /// frames nor steps.
    pub unusable_files: Vec<PathBuf>,
    /// The state that the screen shows, which another thread draws.
    pub progress: Arc<Mutex<Progress>>,
}

/// A message of an insole, or the start of another session with it, in which streams have to be requested again.
#[allow(clippy::large_enum_variant, reason = "items exist one at a time")]
enum Item {
    Message(ToHost),
    Started,
}

/// The result of the standing trial of one foot.
pub struct StandingResult {
    /// The calibration with the offsets of this trial.
    pub cells: Vec<CellCalibration>,
    /// Mean force while standing, N, above that of the lifted foot.
    pub standing_n: f64,
}

impl Foot {
    /// Checks the insole, and creates its folder. `folder` is the folder of the session.
    pub fn new(mut link: InsoleLink, folder: &Path) -> Result<Self> {
        let client = link.client();
        let hello = client.hello().clone();
        if let Some(fault) = &hello.fault {
            println!("note: the {} insole reports: {fault}", hello.side.name());
        }
        ensure_supply(hello.side, client.status()?.supply_mv)?;
        let faults = client.faults()?;
        ensure!(
            faults.masked_cells.iter().all(|&masked| masked == 0),
            "the {} insole masks faulty cells, which `plantar monitor` lists: repair or replace the insole",
            hello.side.name()
        );
        let folder = folder.join(hello.side.name());
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let progress = Arc::new(Mutex::new(Progress::new(hello.side)));
        println!(
            "{} foot: {} insole, firmware {}, {} cells",
            hello.side.name(),
            hello.board,
            hello.firmware,
            hello.cells
        );
        Ok(Self { link, side: hello.side, folder, unusable_files: Vec::new(), progress })
    }

    /// Sets the contact rule of the insole.
    pub fn set_rule(&mut self, contact: ContactRule) -> Result<()> {
        let before = self.link.client().hello().contact_rule;
        let set = params::set_rule(&mut self.link, contact);
        params::print_new_rule(&mut self.link, before);
        set
    }

    fn update(&self, change: impl FnOnce(&mut Progress)) {
        change(&mut self.progress.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Shows a remark until the next one.
    pub fn remark(&self, remark: String) {
        self.update(|progress| progress.remark = remark);
    }

    /// Passes each item from the insole to `process` until `process` returns true or `stop` is set. Reconnects when the link is
    /// lost.
    fn follow(&mut self, stop: &AtomicBool, mut process: impl FnMut(&mut Self, Item) -> Result<bool>) -> Result<()> {
        // The live stream is requested again, because a restart of the insole ends it. If this fails because the link is lost,
        // `next_event` opens it again.
        let _ = self.link.start();
        while !stop.load(Ordering::Relaxed) {
            let event = self.link.next_event().with_context(|| format!("{} foot", self.side.name()))?;
            let item = match event {
                Event::Message(message) => {
                    if let ToHost::Live(live) = &message {
                        self.update(|progress| progress.live = *live);
                    }
                    Item::Message(message)
                }
                Event::Started(start) => {
                    let side = self.link.client().hello().side;
                    ensure!(
                        side == self.side,
                        "an insole for the {} foot answers: connect the insole for the {} foot again",
                        side.name(),
                        self.side.name()
                    );
                    if start != SessionStart::Connected {
                        self.update(|progress| {
                            let next = if progress.is_walking() { ": walk on when you are ready" } else { "" };
                            progress.remark = format!("connected again{next}");
                        });
                    }
                    Item::Started
                }
                Event::Timeout => continue,
                Event::Lost(error) if error.is_link_failure() => {
                    let cause = link_problem(&error);
                    // Reading the screen or handling the cable while walking is a risk of falling.
                    self.update(|progress| {
                        let first = if progress.is_walking() { "stop walking; " } else { "" };
                        progress.remark = format!("{first}{cause}");
                    });
                    continue;
                }
                Event::Lost(error) => return Err(error.into()),
            };
            match process(self, item) {
                Ok(true) => return Ok(()),
                Ok(false) => {}
                Err(error) => self.recover(error)?,
            }
        }
        Ok(())
    }

    /// Ends the session with the insole after a failure of the link, so that it is opened again.
    ///
    /// # Errors
    /// Returns any other error.
    pub fn recover(&mut self, error: anyhow::Error) -> Result<()> {
        match error.downcast_ref::<Error>() {
            Some(failure) if failure.is_link_failure() => Ok(self.link.recover(error.downcast()?)?),
            _ => Err(error),
        }
    }

    /// Stores load records until `begins` is set.
    pub fn wait(&mut self, stop: &AtomicBool, begins: &AtomicBool) -> Result<()> {
        let mut file = self.new_stream_file(STAND_PREFIX)?;
        self.update(|progress| progress.needed = 0);
        self.follow(stop, |foot, item| {
            if let Item::Message(message) = item {
                foot.store_record(&mut file, &message)?;
            }
            Ok(begins.load(Ordering::Relaxed))
        })
    }

    /// Records the cells of a standing trial for `time`. `None` if the link of a foot was lost meanwhile: `is_lost`, which all
    /// feet share, is then true, and ends the trial of the other foot, too, because the wearer begins again.
    pub fn stand(&mut self, stop: &AtomicBool, time: Duration, is_lost: &AtomicBool) -> Result<Option<Trial>> {
        let mut trial = match Trial::begin(self.link.client()) {
            Ok(trial) => Some(trial),
            Err(error) => {
                self.link.recover(error)?;
                None
            }
        };
        // The insole also sends load records during the trial.
        let mut file = self.new_stream_file(STAND_PREFIX)?;
        let start = Instant::now();
        self.update(|progress| progress.needed = 0);
        self.follow(stop, |foot, item| {
            match item {
                Item::Message(ToHost::Cells(frame)) => trial.iter_mut().for_each(|trial| trial.frame(&frame)),
                Item::Started => is_lost.store(true, Ordering::Relaxed),
                Item::Message(message) => foot.store_record(&mut file, &message)?,
            }
            Ok(is_lost.load(Ordering::Relaxed) || start.elapsed() >= time)
        })?;
        // If the link is lost, the stream has ended already, and the error is ignored.
        let _ = self.link.client().stream_cells(None);
        Ok(trial.filter(|_| !is_lost.load(Ordering::Relaxed)))
    }

    /// Stores a standing trial in the folder, and determines the offsets from it. The inner error states why the trial has to be
    /// repeated.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn evaluate(&self, trial: &Trial) -> Result<Result<StandingResult>> {
        let name = format!("{} foot", self.side.name());
        let recording = match trial.recording(&name, None) {
            Ok(recording) => recording,
            Err(error) => return Ok(Err(error)),
        };
        recording.write(self.folder.join("standing.parquet"))?;
        Ok(trial.evaluate(&name, &recording))
    }

    /// Stores the calibration on the insole, unless it is in force already.
    pub fn send_calibration(&mut self, cells: &[CellCalibration]) -> Result<()> {
        let mut id = CalibrationId::new();
        id.add(cells);
        if self.link.client().identity()?.calibration_id != id.id() {
            self.link.client().calibrate(cells)?;
            crate::insole::restart(&mut self.link)?;
        }
        Ok(())
    }

    /// Stores the calibration in the folder.
    pub fn store_calibration(&self, cells: &[CellCalibration]) -> Result<()> {
        crate::insole::write_calibration(&self.calibration_file(), cells)
    }

    /// The file with the calibration of this session, in the format of `plantar insole calibrate`.
    pub fn calibration_file(&self) -> PathBuf {
        self.folder.join("calibration.csv")
    }

    /// Stores a load record in the file, and acknowledges it. Other messages are ignored.
    fn store_record(&mut self, file: &mut StreamFile, message: &ToHost) -> Result<()> {
        if let Some(record) = LoadRecord::of(message) {
            file.write(0, message)?;
            self.link.send(ToDevice::Acknowledge { number: record.number() });
        }
        Ok(())
    }

    /// Creates the next stream file with this prefix of its name, and writes the insole's hello to it.
    fn new_stream_file(&mut self, prefix: &str) -> Result<StreamFile> {
        let path = self.next_path(prefix, ".plantar");
        let mut file = StreamFile::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
        file.write(0, &ToHost::Hello(self.link.client().hello().clone()))?;
        Ok(file)
    }

    /// The first path in the folder that does not exist, of the form `prefix`, hyphen, number of three digits, `extension`.
    fn next_path(&self, prefix: &str, extension: &str) -> PathBuf {
        let mut paths = (0..).map(|number| self.folder.join(format!("{prefix}-{number:03}{extension}")));
        // The numbers are unlimited, so there is such a path.
        paths.find(|path| !path.exists()).unwrap_or_default()
    }

    /// The stream files of the walk so far that are not in [`Self::unusable_files`].
    pub fn stream_files(&self) -> Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        let error = || format!("cannot read {}", self.folder.display());
        for entry in std::fs::read_dir(&self.folder).with_context(error)? {
            let path = entry.with_context(error)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let is_stream = name.starts_with(WALK_PREFIX) && name.ends_with(".plantar");
            if is_stream && !self.unusable_files.contains(&path) && std::fs::metadata(&path)?.len() > 0 {
                files.push(path);
            }
        }
        files.sort();
        Ok(files)
    }

    /// Records live frames, steps and, if the carrier is fast enough, all cells, until there are `needed` good steps, including
    /// the `earlier` ones in the stream files.
    pub fn walk(&mut self, stop: &AtomicBool, earlier: usize, needed: usize) -> Result<()> {
        let mut file = self.new_stream_file(WALK_PREFIX)?;
        let cells_folder = self.next_path("cells", "");
        self.update(|progress| (progress.done, progress.needed, progress.remark) = (earlier, needed, String::new()));
        let mut walk = Walk {
            steps: LiveSteps::new(),
            earlier,
            done: earlier,
            needed,
            evaluated: 0,
            unused: None,
            cells_folder: Some(cells_folder),
            cells: None,
            part_start: Instant::now(),
            last_step: Instant::now(),
        };
        if let Err(error) = walk.start_cells(self.link.client()) {
            self.recover(error)?;
        }
        let followed = self.follow(stop, |foot, item| walk.process(foot, item, &mut file));
        // If the link is lost, the stream has ended already, and the error is ignored.
        let _ = self.link.client().stream_cells(None);
        let completed = walk.cells.map_or(Ok(()), |mut cells| cells.complete_part());
        followed.and(completed).and(file.finish().map_err(Into::into))
    }

    /// Sends the parameters once the link, which was lost, is open again.
    pub fn send_parameters(&mut self, stop: &AtomicBool, parameters: &Parameters) -> Result<()> {
        let mut file = self.new_stream_file(VERIFY_PREFIX)?;
        self.update(|progress| progress.needed = 0);
        self.follow(stop, |foot, item| {
            match item {
                Item::Started => return params::send(&mut foot.link, parameters).map(|()| true),
                Item::Message(message) => foot.store_record(&mut file, &message)?,
            }
            Ok(false)
        })
    }

    /// Receives and stores steps until `count` of them began after this call, and returns these. The insole evaluates them with
    /// the parameters in force.
    pub fn verify(&mut self, stop: &AtomicBool, count: usize) -> Result<Vec<Step>> {
        let mut begin_us = match self.link.client().status() {
            Ok(status) => status.uptime_us,
            Err(error) => {
                self.link.recover(error)?;
                u64::MAX
            }
        };
        let mut steps: Vec<Step> = Vec::new();
        let mut file = self.new_stream_file(VERIFY_PREFIX)?;
        self.update(|progress| (progress.done, progress.needed, progress.remark) = (0, count, String::new()));
        self.follow(stop, |foot, item| {
            let message = match item {
                Item::Message(message) => message,
                // The link was lost before, or the insole's time has begun again at 0 after a restart.
                Item::Started => {
                    begin_us = begin_us.min(foot.link.client().status()?.uptime_us);
                    return Ok(false);
                }
            };
            foot.store_record(&mut file, &message)?;
            if let ToHost::Step(step) = message
                && step.boots_since == 0
                && step.start_us > begin_us
            {
                steps.push(step);
                foot.update(|progress| progress.done = steps.len());
            }
            Ok(steps.len() >= count)
        })?;
        Ok(steps)
    }
}

/// The result of starting a stream of cells; `None` if the carrier is too slow for all frames.
fn unless_too_slow<T>(started: Result<T>) -> Result<Option<T>> {
    match started {
        Err(error) if matches!(error.downcast_ref(), Some(Error::Refused(Refusal::CellRate { .. }))) => Ok(None),
        started => started.map(Some),
    }
}

/// Refuses an insole that would store neither steps nor results, because its supply is too low. `supply_mv` is `None` if the
/// insole does not measure it.
fn ensure_supply(side: Side, supply_mv: Option<u16>) -> Result<()> {
    let Some(low_mv) = supply_mv.filter(|&supply_mv| supply_mv < SUFFICIENT_SUPPLY_MV) else { return Ok(()) };
    bail!(
        "the {} insole has a supply of {:.2} V and stores nothing below {:.2} V: charge its battery",
        side.name(),
        f64::from(low_mv) / 1000.0,
        f64::from(SUFFICIENT_SUPPLY_MV) / 1000.0
    )
}

/// The remark if the insole seems to lie under the other foot.
const OTHER_FOOT: &str = "the small toes carry more than the big toe: is this insole in the other shoe?";
/// The remark after some time without a step.
const RESTS: &str = "no step: rest as long as you like, the steps so far count; if you are walking, check the shoe";
/// First part of the names of the stream files with the load records that the insole sends before and during the standing trial.
const STAND_PREFIX: &str = "stand";
/// First part of the names of the stream files of the walk.
const WALK_PREFIX: &str = "walk";
/// First part of the names of the stream files with the load records after the walk, among them the steps that verify the result.
const VERIFY_PREFIX: &str = "verify";

/// The walk in progress.
struct Walk {
    steps: LiveSteps,
    /// Number of good steps in earlier stream files.
    earlier: usize,
    /// Number of good steps so far, including the earlier ones.
    done: usize,
    /// Number of good steps at which the walk ends.
    needed: usize,
    /// The value of [`LiveSteps::evaluated`] for which `done` and `unused` were determined.
    evaluated: usize,
    /// Why the last step was not used; `None` if it was used, and before the first step.
    unused: Option<ExclusionReason>,
    /// The folder for the cells; `None` if the carrier is too slow for all frames.
    cells_folder: Option<PathBuf>,
    /// `None` before the first start of the stream of cells, and if the carrier is too slow for it.
    cells: Option<CellRecorder>,
    part_start: Instant,
    last_step: Instant,
}

impl Walk {
    /// Starts the stream of all cells in a new session. After an error, this function can be called again.
    fn start_cells(&mut self, client: &mut AnyClient) -> Result<()> {
        let Some(folder) = &self.cells_folder else { return Ok(()) };
        let started = match &mut self.cells {
            Some(cells) => cells.restart(client),
            None => CellRecorder::begin(client, ALL_CELLS, folder.clone())
                .map(|cells| self.cells = Some(cells))
                .map_err(Into::into),
        };
        if unless_too_slow(started)?.is_none() {
            (self.cells_folder, self.cells) = (None, None);
        }
        Ok(())
    }

    /// Stores the message of an item, and counts the good steps. Returns true once there are enough.
    fn process(&mut self, foot: &mut Foot, item: Item, file: &mut StreamFile) -> Result<bool> {
        match item {
            Item::Started => {
                file.write(0, &ToHost::Hello(foot.link.client().hello().clone()))?;
                self.steps.session_started();
                self.start_cells(foot.link.client())?;
            }
            Item::Message(ToHost::Cells(frame)) => {
                if let Some(cells) = &mut self.cells {
                    cells.frame(&frame)?;
                }
            }
            Item::Message(message @ ToHost::Live(live)) => {
                file.write(0, &message)?;
                self.steps.frame(&live);
            }
            Item::Message(message) => {
                foot.store_record(file, &message)?;
                if let ToHost::Step(step) = message {
                    self.steps.step(&step);
                    self.last_step = Instant::now();
                }
            }
        }
        if self.part_start.elapsed() >= PART_TIME
            && let Some(cells) = &mut self.cells
        {
            cells.complete_part()?;
            self.part_start = Instant::now();
        }
        if self.steps.evaluated() != self.evaluated {
            self.count_good_steps();
        }
        let remark = match &self.unused {
            _ if self.steps.looks_mirrored() => OTHER_FOOT.into(),
            _ if self.last_step.elapsed() >= NO_STEP => RESTS.into(),
            Some(reason) => format!("a step was not used: {reason}"),
            None => String::new(),
        };
        foot.update(|progress| (progress.done, progress.remark) = (self.done, remark));
        Ok(self.done >= self.needed)
    }

    /// Counts the good steps, and stores the reason if the last step was not used.
    fn count_good_steps(&mut self) {
        let (good, excluded) = self.steps.collected(0);
        // If the insole has restarted, its times have begun again at 0, but a new good step increases the number of good steps.
        let is_good = self.earlier + good.len() > self.done;
        let is_last = |contact: &&ExcludedContact| good.last().is_none_or(|step| step.start_s < contact.at_s);
        self.unused = excluded.last().filter(|_| !is_good).filter(is_last).map(|contact| contact.reason);
        self.done = self.earlier + good.len();
        self.evaluated = self.steps.evaluated();
    }
}

/// Frames of cells per second of a standing trial, unless the connection is too slow for this rate. The trial needs only means
/// over seconds.
const TRIAL_HZ: f64 = 20.0;
/// Longest time between two frames of a standing trial, s. The trial's means are over several seconds.
const TRIAL_GAP_S: f64 = 1.0;

/// Largest increase of a cell's code without load since its calibration, for example by warming. With the law of the reference
/// insole, it is a pressure of 1.7 kPa at the zero.
const MAX_INCREASE: u16 = 400;

/// The offset of a cell after a standing trial, in which its mean code under the lifted foot was `measured`. `calibrated` is its
/// offset in a calibration that the insole stores; `None` without one.
///
/// The insole may be in the shoe during the trial. Subtracting the code of the shoe's pressure from that of a higher pressure is
/// not subtracting the pressures, because the sensor law is not linear. The insole itself subtracts the pressure of the shoe, so
/// a code that is higher by more than [`MAX_INCREASE`] does not change a calibrated offset.
fn offset_in_shoe(measured: u16, calibrated: Option<u16>) -> u16 {
    calibrated.filter(|offset| measured > offset.saturating_add(MAX_INCREASE)).unwrap_or(measured)
}

/// The cells of a standing trial.
pub struct Trial {
    started: StartedCells,
    /// True if the insole stores a calibration, which an earlier session or `plantar insole calibrate` has sent.
    is_calibrated: bool,
    /// The insole sends one of this number of scans.
    every: u8,
    /// The scan number and the codes of each frame that arrived.
    frames: Vec<(u32, Vec<u16>)>,
}

impl Trial {
    /// Starts the stream of cells, at [`TRIAL_HZ`] if the carrier can send as many frames.
    fn begin(client: &mut AnyClient) -> Result<Self, Error> {
        let is_calibrated = client.identity()?.calibration_id != 0;
        let (started, stream) = start_slowly(client, TRIAL_HZ)?;
        Ok(Self { started, is_calibrated, every: stream.every, frames: Vec::new() })
    }

    fn frame(&mut self, frame: &CellFrame) {
        let receiver = &mut self.started.receiver;
        if receiver.frame(frame) {
            self.frames.push((frame.scan, receiver.codes().to_vec()));
        }
    }

    /// The number and the codes of every [`Self::every`]th scan, from the first received scan to the last one. A missing frame
    /// has the codes of the frame before it.
    fn regular_frames(&self, name: &str) -> Result<Vec<(u32, &[u16])>> {
        let period_s = f64::from(self.started.setup.period_us) * 1e-6;
        let max_scans = ((TRIAL_GAP_S / period_s) as u32).max(self.every.into());
        let is_whole = self.frames.windows(2).all(|pair| pair[1].0.wrapping_sub(pair[0].0) <= max_scans);
        ensure!(is_whole, "{name}: too many frames were lost while you stood: stand again");
        let (Some((first, _)), Some((last, _))) = (self.frames.first(), self.frames.last()) else {
            return Ok(Vec::new());
        };
        // Scans are counted from the first one, because their numbers wrap.
        let elapsed = |scan: u32| scan.wrapping_sub(*first);
        let regular = (0..=elapsed(*last)).step_by(self.every.into()).map(|due| {
            // The first frame is never after `due`.
            let next = self.frames.partition_point(|(scan, _)| elapsed(*scan) <= due);
            (first.wrapping_add(due), self.frames[next - 1].1.as_slice())
        });
        Ok(regular.collect())
    }

    /// The trial as a recording. If calibrations are given, they replace those of the insole.
    fn recording(&self, name: &str, calibrations: Option<&[CellCalibration]>) -> Result<Recording> {
        let mut cells = self.started.cells.clone();
        for (cell, calibration) in cells.iter_mut().zip(calibrations.unwrap_or_default()) {
            *cell = cell.calibrated(*calibration);
        }
        let mut streamed = StreamedCells::new(self.started.setup, cells, self.every);
        for (scan, codes) in self.regular_frames(name)? {
            streamed.push(scan, codes);
        }
        streamed.take("Standing trial of a guided session").with_context(|| format!("{name}: no cells arrived"))
    }

    fn evaluate(&self, name: &str, recording: &Recording) -> Result<StandingResult> {
        let trial = StandingTrial::find(recording, name)?;
        let frames = self.regular_frames(name)?;
        let lifted = || trial.lifted.iter().flat_map(|lifted| &frames[lifted.clone()]);
        let mut calibrations = Vec::new();
        for (i, cell) in self.started.cells.iter().enumerate() {
            // A standing trial always has frames with a lifted foot, so the offset 0 is never used.
            let offset = zero_offset(lifted().map(|(_, codes)| codes[i])).unwrap_or(0);
            let measured = CellCalibration { offset, ..cell.calibration() };
            if !measured.is_valid() {
                bail!(
                    "{name}: cell {i} reads a code of at least half of its scale without load: it is shorted, or the foot was \
                     not lifted"
                );
            }
            let calibrated = self.is_calibrated.then_some(cell.offset);
            calibrations.push(CellCalibration { offset: offset_in_shoe(offset, calibrated), ..measured });
        }
        let corrected = self.recording(name, Some(&calibrations))?;
        let mean_n = |parts: &[Range<usize>]| {
            let frames: usize = parts.iter().map(Range::len).sum();
            parts.iter().cloned().flatten().map(|i| corrected.force_n(i)).sum::<f64>() / frames as f64
        };
        let standing_n = mean_n(&[trial.standing]) - mean_n(&trial.lifted);
        Ok(StandingResult { cells: calibrations, standing_n })
    }
}

#[cfg(test)]
mod tests {
    use super::{Trial, ensure_supply};
    use client::{CellReceiver, StartedCells};
    use plantar::Side;
    use plantar::pipeline::calibrate::CellCalibration;
    use plantar::pipeline::contact::ContactRule;
    use plantar::pipeline::stance_rule::StanceRule;
    use plantar::protocol::{CellStream, Resolution};
    use recording::VirtualInsole;
    use recording::synthetic::{self, SyntheticStanding};

    /// A computed standing trial in which the wearer stands with 400 N on the foot. Without load, each cell reads the code
    /// `unloaded`; in the calibration of the insole, this code is `offset`. The shoe presses on each cell with `shoe_kpa`.
    fn trial(unloaded: u16, offset: u16, shoe_kpa: f32, is_calibrated: bool) -> Trial {
        let standing = synthetic::standing(&SyntheticStanding { standing_n: 400.0, ..Default::default() });
        let mut insole = VirtualInsole::new(&standing, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let frame = |i: usize| {
            let pressed_kpa: Vec<f32> = standing.frame(i).iter().map(|kpa| kpa + shoe_kpa).collect();
            let mut codes = vec![0; insole.cells.len()];
            insole.codes(&pressed_kpa, &mut codes);
            (i as u32, codes.iter().map(|code| code + unloaded).collect())
        };
        let frames = (0..standing.frames()).map(frame).collect();
        for cell in &mut insole.cells {
            *cell = cell.calibrated(CellCalibration { offset, ..CellCalibration::IDEAL });
        }
        let stream = CellStream { resolution: Resolution::Oversampled, every: 1 };
        let receiver = CellReceiver::new(&stream, insole.cells.len());
        let started = StartedCells { setup: insole.setup, cells: insole.cells, receiver };
        Trial { started, is_calibrated, every: 1, frames }
    }

    /// Evaluates a [`trial`]. Returns the new offset of the cells, which is the same for all, and the force while standing, N.
    fn evaluate(unloaded: u16, offset: u16, shoe_kpa: f32, is_calibrated: bool) -> (u16, f64) {
        let trial = trial(unloaded, offset, shoe_kpa, is_calibrated);
        let recording = trial.recording("trial", None).expect("a recording");
        let result = trial.evaluate("trial", &recording).expect("a standing trial");
        let [first, ..] = result.cells[..] else { panic!("the insole has cells") };
        assert!(result.cells.iter().all(|cell| *cell == first), "all cells have the same offset and gain");
        (first.offset, result.standing_n)
    }

    #[test]
    fn the_pressure_of_the_shoe_does_not_become_an_offset_of_a_calibrated_insole() {
        let (without_shoe, expected_n) = evaluate(1500, 1500, 0.0, true);
        assert_eq!(without_shoe, 1500);
        assert!((expected_n - 400.0).abs() < 4.0, "{expected_n:.1} N of 400 N");
        for shoe_kpa in [4.0, 8.0, 16.0] {
            let (offset, standing_n) = evaluate(1500, 1500, shoe_kpa, true);
            assert_eq!(offset, 1500, "in a shoe that presses with {shoe_kpa} kPa");
            assert!((standing_n - expected_n).abs() < 0.01 * expected_n, "{standing_n:.1} of {expected_n:.1} N");
        }
        // The reading of an unloaded cell has changed since its calibration.
        assert_eq!(evaluate(1200, 1500, 0.0, true).0, 1200);
        assert_eq!(evaluate(1800, 1500, 0.0, true).0, 1800);
    }

    #[test]
    fn a_shorted_cell_is_named_also_on_a_calibrated_insole() {
        for is_calibrated in [false, true] {
            let mut trial = trial(1500, 1500, 0.0, is_calibrated);
            trial.frames.iter_mut().for_each(|(_, codes)| codes[7] = u16::MAX);
            let recording = trial.recording("trial", None).expect("a recording");
            let error = trial.evaluate("trial", &recording).err().expect("the cell is shorted").to_string();
            assert!(error.contains("cell 7 reads") && error.contains("shorted"), "{error}");
        }
    }

    #[test]
    fn the_offsets_of_an_insole_without_calibration_are_measured() {
        let (offset, standing_n) = evaluate(5956, 0, 0.0, false);
        assert_eq!(offset, 5956);
        assert!((standing_n - 400.0).abs() < 4.0, "{standing_n:.1} N of 400 N");
    }

    #[test]
    fn an_insole_that_stores_nothing_is_refused_before_the_session() {
        assert!(ensure_supply(Side::Left, None).is_ok());
        assert!(ensure_supply(Side::Left, Some(2_800)).is_ok());
        let error = ensure_supply(Side::Left, Some(2_650)).unwrap_err().to_string();
        assert!(error.contains("left") && error.contains("2.65 V") && error.contains("charge"), "{error}");
    }
}
