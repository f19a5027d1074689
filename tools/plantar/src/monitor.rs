//! `plantar monitor`: watch an insole over its link.

use crate::replay::write_json;
use crate::summary;
use crate::view::View;
use anyhow::{Context, Result, bail};
use clap::Args;
use client::Client;
use plantar::wire::{Step, ToDevice, ToHost};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Shows the eight regional loads as they come, and a table of the steps at the end.
///
/// In a terminal press q or Ctrl-C to end. Steps stay on the insole until they have arrived here and, with --json, are
/// written.
#[derive(Args)]
pub struct Monitor {
    /// Network address of an insole, HOST:PORT.
    #[arg(long, value_name = "ADDRESS", required_unless_present = "serial", conflicts_with = "serial")]
    tcp: Option<String>,
    /// Serial port of an insole, such as /dev/ttyACM0 or COM3.
    #[arg(long, value_name = "PORT")]
    serial: Option<String>,
    /// Bit rate of the serial port.
    #[arg(long, default_value_t = 460_800, requires = "serial")]
    baud: u32,
    /// End after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write one object a step to this file, as the steps come.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Longest silence of a carrier before control comes back to look at the keyboard.
pub const PATIENCE: Duration = Duration::from_millis(50);
/// A stream that is silent for longer has ended.
const SILENCE: Duration = Duration::from_secs(2);
/// An insole answers a hello within this time.
pub const ANSWER: Duration = Duration::from_secs(5);

impl Monitor {
    pub fn run(&self) -> Result<()> {
        match (&self.tcp, &self.serial) {
            (Some(address), _) => {
                let stream = TcpStream::connect(address)
                    .with_context(|| format!("cannot reach {address}: is the insole or its bridge running there?"))?;
                stream.set_read_timeout(Some(PATIENCE))?;
                stream.set_nodelay(true)?;
                self.watch(stream)
            }
            (None, Some(port)) => self.watch(open_serial(port, self.baud)?),
            (None, None) => bail!("give --tcp or --serial"),
        }
    }

    fn watch(&self, carrier: impl Read + Write) -> Result<()> {
        let mut client = Client::connect(carrier, ANSWER)?;
        let mut view = View::open(client.hello())?;
        let mut steps = Vec::new();
        let outcome = self.follow(&mut client, &mut view, &mut steps);
        view.close();
        summary::print(&steps);
        outcome
    }

    fn follow<C: Read + Write>(&self, client: &mut Client<C>, view: &mut View, steps: &mut Vec<Step>) -> Result<()> {
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

fn open_serial(port: &str, baud: u32) -> Result<Box<dyn serialport::SerialPort>> {
    serialport::new(port, baud).timeout(PATIENCE).open().with_context(|| {
        let known = serialport::available_ports().unwrap_or_default();
        let names: Vec<_> = known.iter().map(|p| p.port_name.as_str()).collect();
        let there =
            if names.is_empty() { "no serial port is here".into() } else { format!("here are {}", names.join(", ")) };
        format!("cannot open {port}; {there}; another program may hold it, or your user may lack the right to it")
    })
}
