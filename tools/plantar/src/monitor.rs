//! `plantar monitor`: shows an insole's live loads and steps.

use crate::carrier::{AnyClient, Connection, InsoleLink};
use crate::params::note_unless_identified;
use crate::paths::check_written;
use crate::records::Records;
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use client::{ClockMapping, Event, ReconnectPolicy, SessionStart, alert_to_json, bout_to_json, step_to_json};
use parameters::DeformationScale;
use plantar::protocol::session::RECORD_QUEUE;
use plantar::protocol::{CellFrame, Live, LoadRecord, ToDevice, ToHost};
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Shows the live loads of the eight regions, alerts, and tables of the steps and the load bouts at the end.
///
/// Press Ctrl-C or, in a terminal, q to end; SIGTERM ends the session, too. When the link is lost, the program reconnects. The
/// insole deletes steps, load bouts and alerts only once they are written to the files of --json, --bouts and --alerts. Without
/// a file for its kind, a record and all later ones remain on the insole, which sends at most six of them; the live loads
/// continue. `plantar record` stores all records, and --discard deletes those without a file.
#[derive(Args)]
pub struct Monitor {
    #[command(flatten)]
    connection: Connection,
    /// End the session after this number of steps has arrived, including those that the insole stored before the session.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write the steps to this JSON file as they arrive, one object per step. The file must be new or empty.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the load bouts (all load outside steps) to this JSON file as they arrive. The file must be new or empty.
    #[arg(long, value_name = "FILE")]
    bouts: Option<PathBuf>,
    /// Write the alerts, which ask the wearer to unload a region, to this JSON file as they arrive. The file must be new or
    /// empty.
    #[arg(long, value_name = "FILE")]
    alerts: Option<PathBuf>,
    /// Delete all steps, load bouts and alerts that arrive from the insole, also those that no file stores.
    #[arg(long)]
    discard: bool,
}

/// Stores the messages of a session with an insole.
pub trait Sink {
    /// Processes a live frame; `mapping` converts its time to this computer's clock.
    fn live(&mut self, live: &Live, mapping: &ClockMapping) -> Result<()>;

    /// Processes a step, load bout or alert.
    fn load_record(&mut self, record: &LoadRecord, mapping: &ClockMapping) -> Result<()>;

    /// Returns the number of the newest stored record, if one was stored since the last call. This record and all earlier ones
    /// can be acknowledged.
    fn take_stored(&mut self) -> Option<u32>;

    /// Returns a note for the user, if there is a new one.
    fn take_note(&mut self) -> Option<String> {
        None
    }

    /// Processes a frame of all cells.
    fn cells(&mut self, _frame: &CellFrame) -> Result<()> {
        Ok(())
    }

    /// Called when another session began, in which the sequence numbers start again. The insole may have restarted; its clock
    /// then starts again, too. If this function returns an error of the link, another session begins.
    fn reconnected(&mut self, client: &mut AnyClient) -> Result<()>;

    /// True once the user's limit of steps or time is reached. The session then ends.
    fn has_reached_limit(&self) -> bool;
}

/// Passes messages to the view and the sink until the user ends the session or the sink has reached its limit. Reconnects when
/// the link is lost.
pub fn follow(connection: &Connection, insole: &mut InsoleLink, view: &mut View, sink: &mut dyn Sink) -> Result<()> {
    let side = insole.client().hello().side;
    while !view.wants_to_end()? && !sink.has_reached_limit() {
        match insole.next_event().with_context(|| connection.to_string())? {
            Event::Message(ToHost::Live(live)) => {
                let client = insole.client();
                sink.live(&live, client.clock_mapping())?;
                view.live(&live, client.counters())?;
            }
            Event::Message(message) if let Some(record) = LoadRecord::of(&message) => {
                let mapping = insole.client().clock_mapping();
                sink.load_record(&record, mapping)?;
                let start_us = mapping.start_us(&record);
                view.load_record(
                    &record,
                    start_us.map(|us| Duration::from_micros(client::unix_us().saturating_sub(us))),
                );
            }
            Event::Message(ToHost::Cells(frame)) => sink.cells(&frame)?,
            Event::Message(_) | Event::Started(SessionStart::Connected) | Event::Timeout => {}
            Event::Started(start) => {
                let meanwhile = insole.meanwhile();
                let hello = insole.client().hello();
                ensure!(
                    hello.side == side,
                    "{connection}: this insole is for the {} foot, but the session began with an insole for the {} \
                     foot: connect that insole again",
                    hello.side.name(),
                    side.name()
                );
                match start {
                    SessionStart::AfterSilence => view.answered_after_silence(hello, meanwhile),
                    SessionStart::Connected | SessionStart::Reconnected | SessionStart::AfterOtherHost => {
                        view.reconnected(hello);
                    }
                }
                if let Err(error) = sink.reconnected(insole.client()) {
                    insole.recover(error.downcast()?)?;
                }
            }
            Event::Lost(error) if error.is_link_failure() => {
                let error = anyhow::Error::new(error);
                view.lost(&format!("{connection}: {error:#}; trying again"))?;
            }
            Event::Lost(error) => return Err(anyhow::Error::new(error).context(connection.to_string())),
        }
        if let Some(number) = sink.take_stored() {
            insole.send(ToDevice::Acknowledge { number });
        }
        if let Some(note) = sink.take_note() {
            view.note(note)?;
        }
    }
    Ok(())
}

/// A file with a JSON array. The file is valid JSON after each object.
struct JsonArray<'m> {
    path: &'m Path,
    file: File,
    /// Length of the file without the closing bracket, bytes.
    len: u64,
}

/// The text at the end of the array.
const END: &[u8] = b"\n]\n";

impl<'m> JsonArray<'m> {
    fn create(path: &'m Path) -> Result<Self> {
        let file = client::create_or_open_empty(path).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { path, file, len: 0 })
    }

    /// Appends an object. If this fails, the file is reset to the previous objects.
    fn push(&mut self, object: &serde_json::Value) -> Result<()> {
        let before = if self.len == 0 { "[\n" } else { ",\n" };
        let added = format!("{before}{object:#}");
        let written = self.write(&[added.as_bytes(), END].concat());
        if written.is_ok() {
            self.len += added.len() as u64;
        } else {
            // If this was the first object, the file becomes empty again, so that the next session can use it.
            let end = if self.len > 0 { END } else { b"" };
            // The error of writing the object is reported, and an error of this reset is ignored.
            let _ = self.file.set_len(self.len).and_then(|()| self.write(end));
        }
        written.with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Writes these bytes after the last complete object, over the end of the array.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.len))?;
        self.file.write_all(bytes)?;
        client::sync_data(&self.file)
    }
}

/// Collects the steps, load bouts and alerts for the tables at the end of the session, and writes them to the JSON files.
struct Collected<'m> {
    monitor: &'m Monitor,
    steps: Option<JsonArray<'m>>,
    bouts: Option<JsonArray<'m>>,
    alerts: Option<JsonArray<'m>>,
    all: Records,
    /// Number of the newest record to acknowledge, until [`Sink::take_stored`] returns it.
    stored: Option<u32>,
    /// Number of the records that remain on the insole: the first one without a file, and all later ones, because an
    /// acknowledgement also covers the records before it.
    retained: usize,
    /// States that records remain on the insole, until [`Sink::take_note`] returns it.
    note: Option<String>,
}

impl Collected<'_> {
    /// Counts a record that remains on the insole. `kind` is its kind, and `option` the option that names its file.
    fn retain(&mut self, kind: &str, option: &str) -> Result<()> {
        if self.retained == 0 {
            self.note = Some(format!(
                "the insole retains this {kind} and all later records, because {option} names no file for it, and sends at most \
                 {RECORD_QUEUE} of them: store all records with `plantar record`, or delete those without a file with --discard"
            ));
        }
        self.retained += 1;
        match self.monitor.steps {
            Some(limit) if self.retained >= RECORD_QUEUE && self.all.steps.len() < limit => bail!(
                "--steps {limit}: only {} steps arrive, because the insole sends no further records before it may delete those that \
                 have no file: add --json, --bouts and --alerts, or --discard",
                self.all.steps.len()
            ),
            _ => Ok(()),
        }
    }
}

impl Sink for Collected<'_> {
    fn live(&mut self, _: &Live, _: &ClockMapping) -> Result<()> {
        Ok(())
    }

    fn load_record(&mut self, record: &LoadRecord, mapping: &ClockMapping) -> Result<()> {
        self.all.push(record);
        // The record is written before it is acknowledged, because the insole deletes an acknowledged record.
        let (file, mut object, kind, option) = match record {
            LoadRecord::Step(step) => (&mut self.steps, step_to_json(step), "step", "--json"),
            LoadRecord::Bout(bout) => (&mut self.bouts, bout_to_json(bout), "load bout", "--bouts"),
            LoadRecord::Alert(alert) => (&mut self.alerts, alert_to_json(alert), "alert", "--alerts"),
        };
        let is_without_file = file.is_none();
        if let Some(start_us) = mapping.start_us(record) {
            object["start_unix_s"] = (start_us as f64 / 1e6).into();
        }
        if let Some(file) = file {
            file.push(&object)?;
        }
        if !self.monitor.discard && (is_without_file || self.retained > 0) {
            return self.retain(kind, option);
        }
        self.stored = Some(record.number());
        Ok(())
    }

    fn take_note(&mut self) -> Option<String> {
        self.note.take()
    }

    fn take_stored(&mut self) -> Option<u32> {
        self.stored.take()
    }

    fn reconnected(&mut self, _: &mut AnyClient) -> Result<()> {
        Ok(())
    }

    fn has_reached_limit(&self) -> bool {
        self.monitor.steps.is_some_and(|limit| self.all.steps.len() >= limit)
    }
}

impl Monitor {
    pub fn run(&self) -> Result<()> {
        let paths = [&self.json, &self.bouts, &self.alerts].map(Option::as_deref);
        check_written(&[], &paths)?;
        let [steps, bouts, alerts] = paths.map(|path| path.map(JsonArray::create).transpose());
        let (steps, bouts, alerts) = (steps?, bouts?, alerts?);
        let mut insole = self.connection.open(ReconnectPolicy::STREAM)?;
        note_unless_identified(insole.client());
        let mut view = View::open(insole.client().hello())?;
        let mut records = Collected {
            monitor: self,
            steps,
            bouts,
            alerts,
            all: Records::default(),
            stored: None,
            retained: 0,
            note: None,
        };
        let outcome = follow(&self.connection, &mut insole, &mut view, &mut records);
        view.close();
        records.all.print(&DeformationScale::ALL_ASSUMED);
        summary::print_faults_of(insole.client());
        outcome
    }
}
