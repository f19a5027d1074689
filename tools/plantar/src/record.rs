//! `plantar record`: stores a session with an insole as Parquet files.

use crate::carrier::{AnyClient, Connection};
use crate::cells::CellRecorder;
use crate::monitor::{Sink, follow};
use crate::params::note_unless_identified;
use crate::records::Records;
use crate::summary::{self, counted};
use crate::view::View;
use anyhow::{Context, Result, bail};
use clap::Args;
use client::{ClockMapping, ReconnectPolicy};
use parameters::DeformationScale;
use plantar::protocol::{Alert, CellFrame, CellStream, Live, LiveRegion, LoadRecord, Resolution, ToDevice};
use plantar::{Region, Side, sequence};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use study::records::{bout_row, columns, flag_columns, step_row};
use study::table::{self, Row, Value};

/// Stores live frames, steps, load bouts and alerts of an insole in a folder of Parquet files.
///
/// The files FOLDER/live/*.parquet have one row per frame and region, the files FOLDER/steps/*.parquet one row per step and
/// region, the files FOLDER/bouts/*.parquet one row per load bout and region, the files FOLDER/alerts/*.parquet one row per alert
/// and region. pandas, Polars, DuckDB and Spark read the files of a folder as one table. While messages arrive, files are
/// completed at least every half minute; after the loss of the link, at the reconnection or the end. So a crash loses at most
/// half a minute of live frames. No step, load bout or alert is lost, because it remains on the insole until its file is
/// complete. When the link is lost, the program reconnects. With --cells, each folder FOLDER/cells/* is a recording that all
/// other commands read; another recording begins after a reconnection, and after a gap of missing frames that is too long to be
/// interpolated. Press Ctrl-C or, in a terminal, q to end; SIGTERM ends the session, too.
#[derive(Args)]
pub struct Record {
    /// The folder to write. It must be new or empty.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
    /// Also record all cells.
    #[arg(long)]
    cells: bool,
    /// With --cells: record one of N frames, for a connection that is too slow for all.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..), requires = "cells")]
    every: u8,
    /// With --cells: record the upper 12 bits of each code, or all 16 bits.
    #[arg(long, value_name = "BITS", default_value = "12", value_parser = ["12", "16"], requires = "cells")]
    bits: String,
    /// End the session after this number of steps has arrived, including those that the insole stored before the session.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// End the session after this number of seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<u64>,
}

/// The current files are completed after this time.
const FILE_TIME: Duration = Duration::from_secs(30);
/// The current files are completed after this number of load records: an insole sends no further record before these are
/// acknowledged.
const FILE_RECORDS: usize = plantar::protocol::session::RECORD_QUEUE;
/// The file in the folder that a recorder reserves, so that no other one writes there. It is hidden, because programs that read
/// a folder as a table ignore such files.
const LOCK_FILE: &str = ".recording";

impl Record {
    pub fn run(&self) -> Result<()> {
        self.check_empty()?;
        let error = || format!("cannot write to {}: check its permissions", self.out.display());
        let lock = create_lock(&self.out).with_context(error)?;
        if let Err(problem) = client::reserve(&lock) {
            bail!("{}: {problem}: choose another folder", self.out.display());
        }
        // The program that reserved the folder before may have written to it since the first check.
        self.check_empty()?;
        // Another folder is created in it for a moment, so that an error is reported before the walk.
        let probe = self.out.join("live");
        fs::create_dir_all(&probe).and_then(|()| fs::remove_dir(&probe)).with_context(error)?;
        let mut insole = self.connection.open(ReconnectPolicy::STREAM)?;
        note_unless_identified(insole.client());
        let mut view = View::open(insole.client().hello())?;
        let mut recorder = Recorder::new(self, insole.client().hello().side);
        recorder.begin_cells(insole.client())?;
        let followed = follow(&self.connection, &mut insole, &mut view, &mut recorder);
        view.close();
        // The messages that arrived are stored even if an error ended the session.
        let completed = recorder.complete_file();
        if let Some(number) = recorder.take_stored()
            && insole.client().hello().side == recorder.side
        {
            // An error is ignored: without the acknowledgement, the insole sends these records again in its next session.
            let _ = insole.client().send(ToDevice::Acknowledge { number });
        }
        // If only the cells could not be written, no record is pending.
        let count = recorder.pending.len();
        if count > 0 {
            eprintln!(
                "note: {count} received steps, load bouts and alerts were not stored; they remain on the insole until its log is full"
            );
        }
        recorder.all.print(&DeformationScale::ALL_ASSUMED);
        summary::print_faults_of(insole.client());
        let (frames, steps) = (counted(recorder.frames, "frame"), counted(recorder.all.steps.len(), "step"));
        println!("wrote {}: {frames}, {steps}", self.out.display());
        if let Some(cells) = &recorder.cells {
            cells.print();
        }
        followed.and(completed)
    }

    /// Checks that the folder to write has no entry except its lock file, if it exists.
    fn check_empty(&self) -> Result<()> {
        let mut entries = fs::read_dir(&self.out).into_iter().flatten().flatten();
        if entries.any(|entry| entry.file_name() != LOCK_FILE) {
            bail!("{} is not empty: choose another folder", self.out.display());
        }
        Ok(())
    }
}

/// Creates a folder, and the file in it that a recorder reserves. The file remains in the folder, because another program may
/// already have opened it when the recorder ends.
fn create_lock(folder: &Path) -> io::Result<File> {
    fs::create_dir_all(folder)?;
    File::options().write(true).create(true).truncate(false).open(folder.join(LOCK_FILE))
}

/// Collects rows and writes them to successive Parquet files.
struct Recorder<'r> {
    /// The options.
    record: &'r Record,
    /// The foot of the insole with which the recording began.
    side: Side,
    /// Number of the session, from 0. Sequence numbers and times may start again in each session.
    session: i32,
    /// Sequence number of the last live frame of this session; `None` before its first one.
    last_live: Option<u32>,
    /// Number of the next files.
    file_number: usize,
    /// When the recording began.
    start: Instant,
    /// When the collection of rows for the next files began.
    file_start: Instant,
    /// Rows of the table of live frames that are not written yet.
    live: Vec<Row>,
    /// Rows of the table of steps that are not written yet.
    steps: Vec<Row>,
    /// Rows of the table of load bouts that are not written yet.
    bouts: Vec<Row>,
    /// Rows of the table of alerts that are not written yet.
    alerts: Vec<Row>,
    /// Numbers of the load records that are not written yet.
    pending: Vec<u32>,
    /// Number of the newest load record in a complete file, until it is acknowledged.
    stored: Option<u32>,
    /// All records, for the tables at the end.
    all: Records,
    /// Number of received live frames.
    frames: usize,
    /// The recorder of all cells, with --cells.
    cells: Option<CellRecorder>,
}

impl<'r> Recorder<'r> {
    fn new(record: &'r Record, side: Side) -> Self {
        let now = Instant::now();
        Self {
            record,
            side,
            session: 0,
            last_live: None,
            file_number: 0,
            start: now,
            file_start: now,
            live: Vec::new(),
            steps: Vec::new(),
            bouts: Vec::new(),
            alerts: Vec::new(),
            pending: Vec::new(),
            stored: None,
            all: Records::default(),
            frames: 0,
            cells: None,
        }
    }

    /// Starts the stream of cells, if cells are recorded.
    fn begin_cells(&mut self, client: &mut AnyClient) -> Result<()> {
        if self.record.cells {
            let resolution = if self.record.bits == "16" { Resolution::Oversampled } else { Resolution::Converter };
            let stream = CellStream { resolution, every: self.record.every };
            self.cells = Some(CellRecorder::begin(client, stream, self.record.out.join("cells"))?);
        }
        Ok(())
    }

    /// Writes the collected rows as the next file of each table, and the collected cells. The records among the rows can then be
    /// acknowledged, even if the cells could not be written.
    fn complete_file(&mut self) -> Result<()> {
        let path = |table: &str| self.record.out.join(table).join(format!("part-{:05}.parquet", self.file_number));
        let tables = [
            ("live", &mut self.live),
            ("steps", &mut self.steps),
            ("bouts", &mut self.bouts),
            ("alerts", &mut self.alerts),
        ];
        for (table, rows) in tables {
            if !rows.is_empty() {
                table::write(&path(table), None, rows)?;
                rows.clear();
            }
        }
        self.file_number += 1;
        self.file_start = Instant::now();
        self.stored = self.pending.drain(..).next_back().or(self.stored);
        self.cells.as_mut().map_or(Ok(()), CellRecorder::complete_part)
    }

    /// Completes the files after [`FILE_RECORDS`] load records, or [`FILE_TIME`].
    fn complete_file_if_due(&mut self) -> Result<()> {
        let is_due = self.pending.len() >= FILE_RECORDS || self.file_start.elapsed() >= FILE_TIME;
        if is_due { self.complete_file() } else { Ok(()) }
    }
}

impl Sink for Recorder<'_> {
    fn live(&mut self, live: &Live, mapping: &ClockMapping) -> Result<()> {
        self.frames += 1;
        // After the loss of a record, the client opens the session again over the same link, and the insole counts its frames
        // from 0. The insole repeats its records before it sends further frames, so the session number changes only after them.
        if self.last_live.is_some_and(|last| !sequence::is_after(live.sequence, last)) {
            self.session += 1;
        }
        self.last_live = Some(live.sequence);
        for (i, (region, r)) in Region::ALL.iter().zip(&live.regions).enumerate() {
            let mut row: Row = vec![("session", self.session.into()), ("side", self.side.name().into())];
            row.extend(columns(Live::QUANTITIES, live));
            row.push(("unix_s", Value::Real(mapping.host_us(live.t_us).map(seconds))));
            row.push(("region", region.name().into()));
            row.extend(columns(LiveRegion::QUANTITIES, r));
            row.extend(flag_columns(Live::FLAGS, live, i));
            self.live.push(row);
        }
        self.complete_file_if_due()
    }

    fn load_record(&mut self, record: &LoadRecord, mapping: &ClockMapping) -> Result<()> {
        self.all.push(record);
        self.pending.push(record.number());
        let start = Value::Real(mapping.start_us(record).map(seconds));
        for (i, region) in Region::ALL.iter().enumerate() {
            let (rows, columns) = match record {
                LoadRecord::Step(step) => (&mut self.steps, step_row(step, i)),
                LoadRecord::Bout(bout) => (&mut self.bouts, bout_row(bout, i)),
                LoadRecord::Alert(alert) => (&mut self.alerts, alert_row(alert, i, region.name())),
            };
            let mut row: Row = vec![("session", self.session.into())];
            row.extend(columns);
            row.push(("start_unix_s", start.clone()));
            row.push(("is_start_comparable", mapping.is_start_comparable(record).into()));
            rows.push(row);
        }
        self.complete_file_if_due()
    }

    fn take_stored(&mut self) -> Option<u32> {
        self.stored.take()
    }

    fn cells(&mut self, frame: &CellFrame) -> Result<()> {
        self.cells.as_mut().map_or(Ok(()), |cells| cells.frame(frame))
    }

    fn reconnected(&mut self, client: &mut AnyClient) -> Result<()> {
        self.complete_file()?;
        // This may be another insole, on which the number of the last record is that of another record. So the number is not
        // sent now; the client acknowledges the records if the insole repeats them.
        if let Some(number) = self.stored.take() {
            client.mark_stored(number);
        }
        self.session += 1;
        self.last_live = None;
        self.cells.as_mut().map_or(Ok(()), |cells| cells.restart(client))
    }

    fn has_reached_limit(&self) -> bool {
        let is_over = |seconds| self.start.elapsed() >= Duration::from_secs(seconds);
        self.record.steps.is_some_and(|limit| self.all.steps.len() >= limit) || self.record.seconds.is_some_and(is_over)
    }
}

/// Converts microseconds to seconds.
fn seconds(us: u64) -> f64 {
    us as f64 / 1e6
}

/// The row of the region with index `i` and name `region` in an alert.
fn alert_row(alert: &Alert, i: usize, region: &str) -> Row {
    let mut row: Row = vec![("side", alert.side.name().into())];
    row.extend(columns(Alert::QUANTITIES, alert));
    row.push(("region", region.into()));
    row.extend(flag_columns(Alert::FLAGS, alert, i));
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::live::session::timed_steps;
    use clap::Parser;
    use plantar::protocol::Step;

    #[derive(Parser)]
    struct Arguments {
        #[command(flatten)]
        record: Record,
    }

    /// Steps of the last seconds, of an hour ago, and of an earlier boot.
    #[test]
    fn a_folder_states_which_steps_have_times_that_can_be_compared_with_those_of_the_other_foot() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().to_str().expect("UTF-8");
        let arguments = Arguments::parse_from(["plantar", "--tcp", "127.0.0.1:9", "--out", out]);
        let mut mapping = ClockMapping::new();
        mapping.answer(1_700_000_000_000_000, 3_700_000_000);
        let mut recorder = Recorder::new(&arguments.record, Side::Left);
        for (number, start_s, boots_since) in [(0, 3_690, 1), (1, 100, 0), (2, 3_690, 0)] {
            let step = Step { start_us: start_s * 1_000_000, boots_since, ..testkit::step(number) };
            recorder.load_record(&step.into(), &mapping).expect("collected");
        }
        recorder.complete_file().expect("written");
        let steps = timed_steps(folder.path()).expect("steps");
        let comparable: Vec<_> = steps.iter().map(|(step, _, is_comparable)| (step.step, *is_comparable)).collect();
        assert_eq!(comparable, [(0, false), (1, false), (2, true)]);
    }
}
