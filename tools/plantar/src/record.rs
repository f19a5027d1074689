//! `plantar record`: an insole's session as Parquet.

use crate::carrier::Carrier;
use crate::monitor::{Sink, follow};
use crate::summary;
use crate::table::{self, Row, Value};
use crate::view::View;
use anyhow::{Result, bail};
use clap::Args;
use client::Axis;
use plantar::protocol::{Flag, Live, LiveRegion, Quantity, Step, StepRegion, ToDevice};
use plantar::{Region, Side};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Stores what an insole sends, live frames and steps, in a folder of Parquet files.
///
/// FOLDER/live/*.parquet has one row a region of a frame, FOLDER/steps/*.parquet one a region of a step; pandas, Polars,
/// DuckDB and Spark read each as one table. A part is closed every half minute, so a crash costs no more than that of the
/// live frames; steps stay on the insole until their part is closed. An insole that is lost is looked for again. In a
/// terminal press q or Ctrl-C to end.
#[derive(Args)]
pub struct Record {
    /// The folder to write; it must be new or empty.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    carrier: Carrier,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// End after this many seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<u64>,
}

/// A part is closed after this time, or when this many steps wait: an insole sends no more before they are acknowledged.
const PART: Duration = Duration::from_secs(30);
const PART_STEPS: usize = plantar::protocol::session::STEP_QUEUE;

impl Record {
    pub fn run(&self) -> Result<()> {
        if std::fs::read_dir(&self.out).is_ok_and(|mut entries| entries.next().is_some()) {
            bail!("{} holds something already: name a new folder", self.out.display());
        }
        let mut client = self.carrier.connect()?;
        let mut view = View::open(client.hello())?;
        let mut parts = Parts::new(self, client.hello().side);
        let followed = follow(&self.carrier, &mut client, &mut view, &mut parts);
        view.close();
        // What came is stored, however it ended.
        let closed = parts.close();
        if let Some(step) = parts.take_stored()
            && client.hello().side == parts.side
        {
            // The insole may be gone; then it keeps its steps.
            let _ = client.send(ToDevice::Acknowledge { step });
        }
        if closed.is_err() {
            eprintln!("note: {} steps were not stored; the insole keeps its last ones", parts.waiting.len());
        }
        summary::print(&parts.all_steps);
        summary::print_faults_of(&mut client);
        println!("wrote {}: {} frames, {} steps", self.out.display(), parts.frames, parts.all_steps.len());
        followed.and(closed)
    }
}

/// The parts so far and the rows of the next.
struct Parts<'r> {
    record: &'r Record,
    side: Side,
    /// Counts how often the insole was connected: numbers and times start anew when it restarts.
    session: i32,
    number: usize,
    start: Instant,
    opened: Instant,
    live: Vec<Row>,
    steps: Vec<Row>,
    /// Steps since the last part.
    waiting: Vec<u32>,
    stored: Option<u32>,
    all_steps: Vec<Step>,
    frames: usize,
}

impl<'r> Parts<'r> {
    fn new(record: &'r Record, side: Side) -> Self {
        let now = Instant::now();
        Self {
            record,
            side,
            session: 0,
            number: 0,
            start: now,
            opened: now,
            live: Vec::new(),
            steps: Vec::new(),
            waiting: Vec::new(),
            stored: None,
            all_steps: Vec::new(),
            frames: 0,
        }
    }

    /// Writes the rows.
    fn close(&mut self) -> Result<()> {
        let path = |table: &str| self.record.out.join(table).join(format!("part-{:05}.parquet", self.number));
        for (table, rows) in [("live", &mut self.live), ("steps", &mut self.steps)] {
            if !rows.is_empty() {
                table::write(&path(table), None, rows)?;
                rows.clear();
            }
        }
        self.number += 1;
        self.opened = Instant::now();
        self.stored = self.waiting.drain(..).next_back().or(self.stored);
        Ok(())
    }

    fn close_if_due(&mut self) -> Result<()> {
        let is_due = self.waiting.len() >= PART_STEPS || self.opened.elapsed() >= PART;
        if is_due { self.close() } else { Ok(()) }
    }
}

impl Sink for Parts<'_> {
    fn live(&mut self, live: &Live, axis: &Axis) -> Result<()> {
        self.frames += 1;
        for (i, (region, r)) in Region::ALL.iter().zip(&live.regions).enumerate() {
            let mut row: Row = vec![("session", self.session.into()), ("side", self.side.name().into())];
            row.extend(columns(Live::QUANTITIES, live));
            row.push(("unix_s", Value::Real(axis.host_us(live.t_us).map(seconds))));
            row.push(("region", region.name().into()));
            row.extend(columns(LiveRegion::QUANTITIES, r));
            row.extend(flag_columns(Live::FLAGS, live, i));
            self.live.push(row);
        }
        self.close_if_due()
    }

    fn step(&mut self, step: &Step, axis: &Axis) -> Result<()> {
        self.all_steps.push(*step);
        self.waiting.push(step.step);
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
    let (nested, quantities): (Vec<_>, Vec<_>) = StepRegion::QUANTITIES.iter().partition(|q| q.path().0.is_some());
    let (counts, quantities): (Vec<_>, Vec<_>) = quantities.into_iter().partition(|q| q.is_count());
    let (whole, scaled): (Vec<_>, Vec<_>) = quantities.into_iter().partition(|q| q.per_unit == 1);
    let mut row: Row = vec![("session", session.into()), ("side", step.side.name().into())];
    row.extend(columns(Step::QUANTITIES, step));
    row.push(("region", region.into()));
    row.extend(columns(whole, r));
    row.extend(flag_columns(Step::FLAGS, step, i));
    row.extend(columns(counts, r));
    row.extend([
        ("contact_on_kpa", f64::from(step.contact_rule.on_kpa).into()),
        ("contact_off_kpa", f64::from(step.contact_rule.off_kpa).into()),
        ("contact_full_kpa", f64::from(step.contact_rule.full_kpa).into()),
    ]);
    row.extend(columns(scaled, r));
    row.extend(columns(nested, r));
    row
}

fn columns<T: 'static>(
    quantities: impl IntoIterator<Item = &'static Quantity<T>>,
    of: &T,
) -> impl Iterator<Item = (&'static str, Value)> {
    quantities.into_iter().map(move |quantity| {
        let whole = || (quantity.value)(of).and_then(|value| i32::try_from(value).ok());
        let value = if quantity.is_count() { Value::Whole(whole()) } else { Value::Real(quantity.in_unit(of)) };
        (quantity.name, value)
    })
}

fn flag_columns<T: 'static>(
    flags: &'static [Flag<T>],
    of: &T,
    region: usize,
) -> impl Iterator<Item = (&'static str, Value)> {
    flags.iter().map(move |flag| (flag.name, flag.is_set(of, region).into()))
}
