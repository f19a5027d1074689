//! `plantar monitor`: watch an insole over its link.

use crate::carrier::{ANSWER, Carrier, Session};
use crate::replay::write_json;
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, bail};
use clap::Args;
use client::{Axis, Error as LinkError};
use plantar::wire::{Live, Step, ToDevice, ToHost};
use std::path::PathBuf;
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
    /// Write one object a step to this file, as the steps come.
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
    loop {
        let Err(error) = follow_session(client, view, sink) else { return Ok(()) };
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
        if client.hello().side != side {
            bail!("{carrier}: this insole is for the {} foot, the one before was not", client.hello().side.name());
        }
        sink.reconnected()?;
        view.back(client.hello());
    }
}

fn follow_session(client: &mut Session, view: &mut View, sink: &mut dyn Sink) -> Result<()> {
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
                let hello = client.reconnect(ANSWER).context("the insole has fallen silent")?;
                sink.reconnected()?;
                view.restarted(hello);
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

/// Keeps the steps, for the table at the end, and writes them.
struct Steps<'m> {
    monitor: &'m Monitor,
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
        if let Some(path) = &self.monitor.json {
            write_json(path, &self.all)?;
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
        let mut client = self.carrier.connect()?;
        let mut view = View::open(client.hello())?;
        let mut steps = Steps { monitor: self, all: Vec::new(), stored: None };
        let outcome = follow(&self.carrier, &mut client, &mut view, &mut steps);
        view.close();
        summary::print(&steps.all);
        summary::print_faults_of(&mut client);
        outcome
    }
}
