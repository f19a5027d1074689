//! `plantar record`: an insole's session as Parquet.

use crate::carrier::Connection;
use crate::monitor::{Sink, follow};
use crate::summary;
use crate::table::{self, Row, Value};
use crate::view::View;
use anyhow::{Result, bail};
use clap::Args;
use client::{Axis, ReconnectPolicy, region_ellipse, region_quantities};
use plantar::protocol::{Live, Step, ToDevice};
use plantar::{Region, Side};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Stores live frames and steps of an insole in a folder of Parquet files.
///
/// FOLDER/live/*.parquet has one row per frame and region, FOLDER/steps/*.parquet one per step and region; pandas, Polars,
/// DuckDB and Spark read each as one table. A file is completed every half minute, so a crash costs at most that much of the
/// live frames; steps remain on the insole until their file is complete. When the link is lost, the program tries to connect
/// again. In a terminal press q or Ctrl-C to end.
#[derive(Args)]
pub struct Record {
    /// The folder to write; it must be new or empty.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// End after this many seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<u64>,
}

/// A file is completed after this time.
const FILE_TIME: Duration = Duration::from_secs(30);
/// A file is completed after this many steps: an insole sends no more before they are acknowledged.
const FILE_STEPS: usize = plantar::protocol::session::STEP_QUEUE;

impl Record {
    pub fn run(&self) -> Result<()> {
        if std::fs::read_dir(&self.out).is_ok_and(|mut entries| entries.next().is_some()) {
            bail!("{} is not empty: name a new folder", self.out.display());
        }
        let mut insole = self.connection.open(ReconnectPolicy::STREAM)?;
        let mut view = View::open(insole.client().hello())?;
        let mut recorder = Recorder::new(self, insole.client().hello().side);
        let followed = follow(&self.connection, &mut insole, &mut view, &mut recorder);
        view.close();
        // Whatever ended the session, the messages that arrived are stored.
        let closed = recorder.close();
        if let Some(step) = recorder.take_stored()
            && insole.client().hello().side == recorder.side
        {
            // Where the link is lost, the insole stores its steps.
            let _ = insole.client().send(ToDevice::Acknowledge { step });
        }
        if closed.is_err() {
            let count = recorder.pending_steps.len();
            eprintln!("note: {count} steps were not stored; they remain on the insole as far as its log reaches");
        }
        summary::print(&recorder.all_steps);
        summary::print_faults_of(insole.client());
        println!("wrote {}: {} frames, {} steps", self.out.display(), recorder.frames, recorder.all_steps.len());
        followed.and(closed)
    }
}

/// Writes Parquet files, one after the other.
struct Recorder<'r> {
    record: &'r Record,
    side: Side,
    /// Counts the sessions: sequence numbers and times start again when the insole restarts.
    session: i32,
    file_number: usize,
    start: Instant,
    file_start: Instant,
    /// Rows of the next file.
    live: Vec<Row>,
    steps: Vec<Row>,
    /// Numbers of the steps in the next file.
    pending_steps: Vec<u32>,
    stored: Option<u32>,
    all_steps: Vec<Step>,
    frames: usize,
}

impl<'r> Recorder<'r> {
    fn new(record: &'r Record, side: Side) -> Self {
        let now = Instant::now();
        Self {
            record,
            side,
            session: 0,
            file_number: 0,
            start: now,
            file_start: now,
            live: Vec::new(),
            steps: Vec::new(),
            pending_steps: Vec::new(),
            stored: None,
            all_steps: Vec::new(),
            frames: 0,
        }
    }

    fn close(&mut self) -> Result<()> {
        let path = |table: &str| self.record.out.join(table).join(format!("part-{:05}.parquet", self.file_number));
        for (table, rows) in [("live", &mut self.live), ("steps", &mut self.steps)] {
            if !rows.is_empty() {
                table::write(&path(table), None, rows)?;
                rows.clear();
            }
        }
        self.file_number += 1;
        self.file_start = Instant::now();
        self.stored = self.pending_steps.drain(..).next_back().or(self.stored);
        Ok(())
    }

    fn close_if_due(&mut self) -> Result<()> {
        let is_due = self.pending_steps.len() >= FILE_STEPS || self.file_start.elapsed() >= FILE_TIME;
        if is_due { self.close() } else { Ok(()) }
    }
}

impl Sink for Recorder<'_> {
    fn live(&mut self, live: &Live, axis: &Axis) -> Result<()> {
        self.frames += 1;
        for (i, (region, r)) in Region::ALL.iter().zip(&live.regions).enumerate() {
            let set = |bits: u8| bits >> i & 1 == 1;
            self.live.push(vec![
                ("session", self.session.into()),
                ("side", self.side.name().into()),
                ("sequence", Value::Whole(i32::try_from(live.sequence).ok())),
                ("t_s", (live.t_us as f64 / 1e6).into()),
                ("unix_s", Value::Real(axis.host_us(live.t_us).map(seconds))),
                ("region", region.name().into()),
                ("area_mm2", f64::from(r.area_mm2).into()),
                ("deformation_mm", (f64::from(r.deformation_um) / 1e3).into()),
                ("model_force_n", (f64::from(r.model_dn) / 10.0).into()),
                ("measured_force_n", (f64::from(r.measured_dn) / 10.0).into()),
                ("saturated", set(live.saturated).into()),
                ("clamped", set(live.clamped).into()),
                ("masked", set(live.masked).into()),
            ]);
        }
        self.close_if_due()
    }

    fn step(&mut self, step: &Step, axis: &Axis) -> Result<()> {
        self.all_steps.push(*step);
        self.pending_steps.push(step.step);
        let start = Value::Real(axis.step_us(step).map(seconds));
        let rows = Region::ALL.iter().enumerate().map(|(i, region)| {
            let mut row = step_row(self.session, step, i, region.name());
            row.push(("start_unix_s", start.clone()));
            row
        });
        self.steps.extend(rows);
        self.close_if_due()
    }

    fn take_stored(&mut self) -> Option<u32> {
        self.stored.take()
    }

    fn reconnected(&mut self) -> Result<()> {
        self.close()?;
        self.session += 1;
        Ok(())
    }

    fn is_full(&self) -> bool {
        let is_over = |seconds| self.start.elapsed() >= Duration::from_secs(seconds);
        self.record.steps.is_some_and(|limit| self.all_steps.len() >= limit) || self.record.seconds.is_some_and(is_over)
    }
}

fn seconds(us: u64) -> f64 {
    us as f64 / 1e6
}

fn step_row(session: i32, step: &Step, i: usize, region: &str) -> Row {
    let r = &step.regions[i];
    let set = |bits: u8| bits >> i & 1 == 1;
    let mut row: Row = vec![
        ("session", session.into()),
        ("side", step.side.name().into()),
        ("step", Value::Whole(i32::try_from(step.step).ok())),
        ("start_s", (step.start_us as f64 / 1e6).into()),
        ("duration_s", (f64::from(step.duration_us) / 1e6).into()),
        ("sample_s", (f64::from(step.sample_us) / 1e6).into()),
        ("bridged_frames", i32::from(step.bridged_frames).into()),
        ("starts_ago", Value::Whole(i32::try_from(step.boots_since).ok())),
        ("region", region.into()),
        ("area_peak_mm2", f64::from(r.area_peak_mm2).into()),
        ("saturated", set(step.saturated).into()),
        ("clamped", set(step.clamped).into()),
        ("masked_cells", i32::from(r.masked_cells).into()),
        ("contact_on_kpa", f64::from(step.contact_rule.on_kpa).into()),
        ("contact_off_kpa", f64::from(step.contact_rule.off_kpa).into()),
        ("contact_full_kpa", f64::from(step.contact_rule.full_kpa).into()),
    ];
    row.extend(region_quantities(r).map(|(name, value)| (name, value.into())));
    row.extend(region_ellipse(r).map(|(name, value)| (name, Value::Real(value))));
    row
}
