//! `plantar monitor`: watch an insole over its link.

use crate::carrier::{ANSWER, Carrier, Session};
use crate::replay::write_json;
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result};
use clap::Args;
use plantar::wire::{Step, ToDevice, ToHost};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Shows the eight regional loads as they come, and a table of the steps at the end.
///
/// In a terminal press q or Ctrl-C to end. Steps stay on the insole until they have arrived here and, with --json, are
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

impl Monitor {
    pub fn run(&self) -> Result<()> {
        let mut client = self.carrier.connect()?;
        let mut view = View::open(client.hello())?;
        let mut steps = Vec::new();
        let outcome = self.follow(&mut client, &mut view, &mut steps);
        view.close();
        summary::print(&steps);
        outcome
    }

    fn follow(&self, client: &mut Session, view: &mut View, steps: &mut Vec<Step>) -> Result<()> {
        client.stream()?;
        let mut heard = Instant::now();
        while !view.wants_to_end()? && self.steps.is_none_or(|limit| steps.len() < limit) {
            match client.receive()? {
                Some(ToHost::Live(live)) => view.live(&live, client.counters())?,
                Some(ToHost::Step(step)) => {
                    steps.push(step);
                    // Stored first: once it is acknowledged the insole forgets it.
                    if let Some(path) = &self.json {
                        write_json(path, steps)?;
                    }
                    client.send(ToDevice::Acknowledge { step: step.step })?;
                    view.step(&step)?;
                }
                Some(_) => {}
                None if heard.elapsed() > SILENCE => {
                    // It may have restarted, and then waits for a hello.
                    let hello = client.reconnect(ANSWER).context("the insole has fallen silent")?;
                    view.restarted(hello);
                    client.stream()?;
                }
                None => continue,
            }
            heard = Instant::now();
        }
        Ok(())
    }
}
