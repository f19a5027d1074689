//! `plantar monitor`: watch an insole over its link.

use crate::carrier::{ANSWER, Carrier, Session};
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, ensure};
use clap::Args;
use client::{Axis, Error as LinkError, step_to_json};
use plantar::protocol::{Live, Step, ToDevice, ToHost};
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Shows the eight regional loads as they come, and a table of the steps at the end.
///
/// In a terminal press q or Ctrl-C to end. When the insole is lost it is looked for again until then. Steps stay on the insole until they have arrived here and, with --json, are
/// written.
#[derive(Args)]
pub struct Monitor {
    #[command(flatten)]
    carrier: Carrier,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write one object a step to this file, as the steps come. It must be new or empty.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A stream that is silent for longer has ended.
const SILENCE: Duration = Duration::from_secs(2);

/// What becomes of what an insole sends.
pub trait Sink {
    /// Takes a live frame; `axis` tells its time on this computer's clock.
    fn live(&mut self, live: &Live, axis: &Axis) -> Result<()>;

    /// Takes a step.
    fn step(&mut self, step: &Step, axis: &Axis) -> Result<()>;

    /// The number up to which steps are stored since this was last asked: the insole may forget them.
    fn take_stored(&mut self) -> Option<u32>;

    /// The insole was silent and may have started anew: its step numbers and its clock, too.
    fn reconnected(&mut self) -> Result<()>;

    /// Enough was received.
    fn is_full(&self) -> bool;
}

/// Between attempts to reach an insole that was lost.
const RETRY: Duration = Duration::from_secs(1);

/// Shows and passes on what comes until the user or the sink ends it. An insole that is lost is looked for again.
pub fn follow(carrier: &Carrier, client: &mut Session, view: &mut View, sink: &mut dyn Sink) -> Result<()> {
    let side = client.hello().side;
    let same_foot = |client: &Session| {
        let now = client.hello().side;
        ensure!(
            now == side,
            "{carrier}: this insole is for the {} foot, the one before was for the {}: connect that one again",
            now.name(),
            side.name()
        );
        Ok(())
    };
    loop {
        let Err(error) = follow_session(client, view, sink, &same_foot) else { return Ok(()) };
        let is_lost = matches!(error.downcast_ref(), Some(LinkError::Carrier(_) | LinkError::NoAnswer(..)));
        if !is_lost {
            return Err(error);
        }
        view.lost(&format!("{carrier}: {error:#}; trying again"))?;
        // Said once, above: an insole that is switched off may stay so for hours.
        loop {
            if view.wants_to_end()? || sink.is_full() {
                return Ok(());
            }
            std::thread::sleep(RETRY);
            if carrier.reconnect(client).is_ok() {
                break;
            }
        }
        same_foot(client)?;
        sink.reconnected()?;
        view.back(client.hello());
    }
}

fn follow_session(
    client: &mut Session,
    view: &mut View,
    sink: &mut dyn Sink,
    same_foot: &dyn Fn(&Session) -> Result<()>,
) -> Result<()> {
    client.stream()?;
    let mut heard = Instant::now();
    while !view.wants_to_end()? && !sink.is_full() {
        match client.receive()? {
            Some(ToHost::Live(live)) => {
                sink.live(&live, client.axis())?;
                view.live(&live, client.counters())?;
            }
            Some(ToHost::Step(step)) => {
                sink.step(&step, client.axis())?;
                view.step(&step)?;
            }
            Some(_) => {}
            None if heard.elapsed() > SILENCE => {
                // It may have restarted, and then waits for a hello.
                client.reconnect(ANSWER).context("the insole has fallen silent")?;
                same_foot(client)?;
                sink.reconnected()?;
                view.restarted(client.hello());
                client.stream()?;
            }
            None => continue,
        }
        if let Some(step) = sink.take_stored() {
            client.send(ToDevice::Acknowledge { step })?;
        }
        heard = Instant::now();
    }
    Ok(())
}

/// A JSON array in a file, whole after each object.
struct JsonArray<'m> {
    path: &'m Path,
    file: File,
    /// Up to the bracket that closes it.
    len: u64,
}

/// Closes the array.
const END: &[u8] = b"\n]\n";

impl<'m> JsonArray<'m> {
    fn create(path: &'m Path) -> Result<Self> {
        let file = serve::create_new(path).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { path, file, len: 0 })
    }

    /// Adds an object; one that cannot be written leaves those before it as they are.
    fn push(&mut self, object: &serde_json::Value) -> Result<()> {
        let before = if self.len == 0 { "[\n" } else { ",\n" };
        let added = format!("{before}{object:#}");
        let written = self.write(&[added.as_bytes(), END].concat());
        if written.is_ok() {
            self.len += added.len() as u64;
        } else if self.len > 0 {
            let _ = self.file.set_len(self.len).and_then(|()| self.write(END));
        }
        written.with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Writes what follows the objects.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.len))?;
        self.file.write_all(bytes)?;
        match self.file.sync_data() {
            // No file but a device.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => Ok(()),
            synced => synced,
        }
    }
}

/// Keeps the steps, for the table at the end, and writes them.
struct Steps<'m> {
    monitor: &'m Monitor,
    json: Option<JsonArray<'m>>,
    all: Vec<Step>,
    stored: Option<u32>,
}

impl Sink for Steps<'_> {
    fn live(&mut self, _: &Live, _: &Axis) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, step: &Step, _: &Axis) -> Result<()> {
        self.all.push(*step);
        // Stored first: once it is acknowledged the insole forgets it.
        if let Some(json) = &mut self.json {
            json.push(&step_to_json(step))?;
        }
        self.stored = Some(step.step);
        Ok(())
    }

    fn take_stored(&mut self) -> Option<u32> {
        self.stored.take()
    }

    fn reconnected(&mut self) -> Result<()> {
        Ok(())
    }

    fn is_full(&self) -> bool {
        self.monitor.steps.is_some_and(|limit| self.all.len() >= limit)
    }
}

impl Monitor {
    pub fn run(&self) -> Result<()> {
        let json = self.json.as_deref().map(JsonArray::create).transpose()?;
        let mut client = self.carrier.connect()?;
        let mut view = View::open(client.hello())?;
        let mut steps = Steps { monitor: self, json, all: Vec::new(), stored: None };
        let outcome = follow(&self.carrier, &mut client, &mut view, &mut steps);
        view.close();
        summary::print(&steps.all);
        summary::print_faults_of(&mut client);
        outcome
    }
}
