//! One insole's session: what it says goes to the hub, what pages have taken is acknowledged.

use crate::hub::Hub;
use client::{Carrier, Client, Error};
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::{ToDevice, ToHost};
use std::io;
use std::time::{Duration, Instant};

/// An insole answers a hello within this time.
const ANSWER: Duration = Duration::from_secs(5);
/// A stream that is silent for longer has ended.
const SILENCE: Duration = Duration::from_secs(2);
/// Between attempts to reach an insole that was lost.
const RETRY: Duration = Duration::from_secs(1);
/// Between questions for the insole's counters.
const STATUS: Duration = Duration::from_secs(1);

type Session = Client<Box<dyn Carrier + Send>>;

/// Where an insole is.
pub struct Source {
    /// As the user named it.
    pub name: String,
    /// Opens the carrier, again after it broke.
    pub open: Box<dyn FnMut() -> io::Result<Box<dyn Carrier + Send>> + Send>,
    /// Parameters that the insole is given.
    pub tissue: Option<Tissue>,
}

impl Source {
    /// Opens a session that streams.
    pub(crate) fn connect(&mut self) -> Result<Session, Error> {
        let mut client = Client::connect((self.open)()?, ANSWER)?;
        if let Some(tissue) = &self.tissue {
            client.set_tissue(tissue)?;
        }
        client.stream()?;
        Ok(client)
    }
}

/// Follows an insole until the program ends; what breaks is tried again.
pub(crate) fn run(hub: &Hub, index: usize, mut source: Source, client: Session) {
    let mut session = Some(client);
    loop {
        if let Some(client) = session.take() {
            let Err(error) = follow(hub, index, client);
            hub.lost(index);
            if hub.has_ended() {
                return;
            }
            eprintln!("{}: {error}; trying again", source.name);
        }
        std::thread::sleep(RETRY);
        // Said once, above: an insole that is switched off may stay so for hours.
        session = source.connect().ok();
    }
}

fn follow(hub: &Hub, index: usize, mut client: Session) -> Result<std::convert::Infallible, Error> {
    // An older insole has none to tell.
    let tissue = client.tissue().ok();
    hub.hello(index, client.hello(), tissue);
    let mut heard = Instant::now();
    let mut asked = Instant::now();
    loop {
        let message = client.receive()?;
        if message.is_some() {
            heard = Instant::now();
        }
        match message {
            Some(ToHost::Live(live)) => hub.live(index, live),
            Some(ToHost::Step(step)) => hub.step(index, step),
            Some(ToHost::Status(status)) => hub.status(index, status),
            // The answer to a hello that was said twice, or to what nobody here asks.
            Some(_) => {}
            // It may have restarted, and then waits for a hello.
            None if heard.elapsed() > SILENCE => return Err(Error::NoAnswer(SILENCE, client.counters().crc_errors)),
            None => {}
        }
        send_due(hub, index, &mut client, &mut asked)?;
    }
}

fn send_due(hub: &Hub, index: usize, client: &mut Session, asked: &mut Instant) -> Result<(), Error> {
    hub.clock(index, client.axis());
    if let Some(step) = hub.acknowledgement(index) {
        client.send(ToDevice::Acknowledge { step })?;
    }
    if asked.elapsed() > STATUS {
        *asked = Instant::now();
        client.send(ToDevice::GetStatus)?;
    }
    Ok(())
}
