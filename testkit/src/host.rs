//! A host that runs the real client over a simulated cable or radio link.

use crate::board::MAX_VALUE;
use crate::virtual_time::{now_us, with_origin};
use crate::world::SharedWorld;
use client::{Carrier, Client, Framed};
use parameters::{InsoleSize, Parameters};
use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::gatt::GattChannel;
use plantar::protocol::{Alert, Bout, Hello, Live, LoadRecord, Status, Step, ToDevice, ToHost, decode, encode};
use std::cell::Cell;
use std::io::{self, Read, Write};
use std::rc::Rc;
use std::time::Duration;

/// Longest wait for a message in one call, us.
const WAIT_US: u64 = 50_000;
/// Time without bytes of the insole after which the host connects again, us.
const SILENCE_US: u64 = 2_000_000;
/// Longest wait for the answer to a connection request.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// The wall clock's time at the virtual time 0, us since 1970.
const UNIX_ORIGIN_US: u64 = 1_790_000_000_000_000;

/// The link between a host and an insole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkKind {
    /// The serial cable.
    Serial,
    /// The radio link.
    Bluetooth,
}

/// The host's end of a serial cable.
pub struct SerialPort {
    world: SharedWorld,
    insole: usize,
}

impl Read for SerialPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut world = self.world.borrow_mut();
        let cable = world.insoles[self.insole].cable.clone();
        let has_bytes = world.run(now_us() + WAIT_US, |_| !cable.borrow().to_host.is_empty());
        if !has_bytes {
            return Err(io::ErrorKind::TimedOut.into());
        }
        let mut cable = cable.borrow_mut();
        let len = buffer.len().min(cable.to_host.len());
        buffer.iter_mut().zip(cable.to_host.drain(..len)).for_each(|(place, byte)| *place = byte);
        Ok(len)
    }
}

impl Write for SerialPort {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.world.borrow().insoles[self.insole].cable.borrow_mut().write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The host's end of a radio link: a central that is bonded with the insole.
pub struct Central {
    world: SharedWorld,
    insole: usize,
    splitter: Splitter,
    joiners: Vec<(GattChannel, Joiner)>,
    /// Number of received messages that could not be decoded.
    damaged: u32,
}

impl Central {
    /// Connects to an insole.
    ///
    /// # Errors
    /// If the insole remains off.
    fn connect(world: SharedWorld, insole: usize) -> io::Result<Self> {
        {
            let mut world = world.borrow_mut();
            let radio = world.insoles[insole].radio.clone();
            if !world.run(now_us() + WAIT_US, |_| radio.borrow().server.is_some()) {
                return Err(io::ErrorKind::NotFound.into());
            }
            radio.borrow_mut().set_connected(true);
            // The Bluetooth stack needs this time to detect the connection.
            world.run_for(1_000);
        }
        let channels = [GattChannel::Control, GattChannel::Live, GattChannel::Steps, GattChannel::Parameters];
        let joiners = channels.map(|channel| (channel, Joiner::new())).into();
        Ok(Self { world, insole, splitter: Splitter::new(), joiners, damaged: 0 })
    }

    fn is_connected(&self) -> bool {
        self.world.borrow().insoles[self.insole].radio.borrow().is_connected
    }
}

impl Carrier for Central {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        if !self.is_connected() {
            return Err(io::ErrorKind::NotConnected.into());
        }
        let channel = GattChannel::of_request(&message);
        let len = encode(&message, self.splitter.buffer()).map_err(io::Error::other)?.len();
        self.splitter.start(len);
        let world = self.world.borrow();
        let radio = world.insoles[self.insole].radio.clone();
        let (server, origin_us, max_len) = {
            let radio = radio.borrow();
            (radio.server.clone().ok_or(io::ErrorKind::NotConnected)?, radio.origin_us, radio.max_value)
        };
        let mut value = [0; MAX_VALUE];
        while let Some(len) = self.splitter.next(&mut value[..max_len]) {
            with_origin(origin_us, || server.write(channel, &value[..len]))
                .map_err(|error| io::Error::other(format!("{error:?}")))?;
        }
        server.changed().signal(());
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        let mut world = self.world.borrow_mut();
        let radio = world.insoles[self.insole].radio.clone();
        let end_us = now_us() + WAIT_US;
        loop {
            let is_ready = |radio: &crate::board::RadioLink| !radio.to_central.is_empty() || !radio.is_connected;
            if !world.run(end_us, |_| is_ready(&radio.borrow())) {
                return Ok(None);
            }
            let Some((channel, value)) = radio.borrow_mut().to_central.pop_front() else {
                return Err(io::ErrorKind::NotConnected.into());
            };
            let Some((_, joiner)) = self.joiners.iter_mut().find(|(joined, _)| *joined == channel) else { continue };
            match joiner.push(&value).map(|message| message.map(decode)) {
                Ok(None) => {}
                Ok(Some(None)) | Err(_) => self.damaged += 1,
                Ok(Some(message)) => return Ok(message),
            }
        }
    }

    fn damaged(&self) -> u32 {
        self.damaged
    }

    fn now_us() -> u64 {
        now_us()
    }

    fn unix_us() -> u64 {
        UNIX_ORIGIN_US + now_us()
    }
}

/// The host's end of a link of either kind.
pub struct Link {
    end: LinkEnd,
    /// Number of received load records, retransmissions included.
    records: Rc<Cell<usize>>,
}

enum LinkEnd {
    Serial(Box<Framed<SerialPort>>),
    Bluetooth(Box<Central>),
}

impl Link {
    /// Opens a link to an insole.
    ///
    /// # Errors
    /// If the link is [`LinkKind::Bluetooth`] and the insole remains off.
    pub fn open(world: &SharedWorld, insole: usize, over: LinkKind) -> io::Result<Self> {
        let end = match over {
            LinkKind::Serial => LinkEnd::Serial(Box::new(Framed::new(SerialPort { world: world.clone(), insole }))),
            LinkKind::Bluetooth => LinkEnd::Bluetooth(Box::new(Central::connect(world.clone(), insole)?)),
        };
        Ok(Self { end, records: Rc::default() })
    }
}

impl Carrier for Link {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        match &mut self.end {
            LinkEnd::Serial(link) => link.send(message),
            LinkEnd::Bluetooth(link) => link.send(message),
        }
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        let message = match &mut self.end {
            LinkEnd::Serial(link) => link.receive(),
            LinkEnd::Bluetooth(link) => link.receive(),
        }?;
        let is_record = message.as_ref().is_some_and(|message| LoadRecord::of(message).is_some());
        self.records.set(self.records.get() + usize::from(is_record));
        Ok(message)
    }

    fn damaged(&self) -> u32 {
        match &self.end {
            LinkEnd::Serial(link) => link.damaged(),
            LinkEnd::Bluetooth(link) => link.damaged(),
        }
    }

    fn now_us() -> u64 {
        now_us()
    }

    fn unix_us() -> u64 {
        UNIX_ORIGIN_US + now_us()
    }
}

/// A host that follows one insole: stores its load records, acknowledges them, and connects again when the link is lost.
pub struct Host {
    world: SharedWorld,
    insole: usize,
    /// The link over which the host connects.
    over: LinkKind,
    /// The session; `None` before the first connection.
    pub client: Option<Client<Link>>,
    /// True if the host has a session or tries to open one.
    pub is_following: bool,
    /// True if the host requests live frames in each session.
    pub wants_live: bool,
    /// True if the host acknowledges the load records that it receives.
    pub acknowledges: bool,
    /// True if the link must be opened before the next message.
    is_broken: bool,
    /// Time of the last message, us.
    last_message_us: u64,
    /// The steps, load bouts and alerts, in the order of their arrival.
    pub records: Vec<LoadRecord>,
    /// Number of load records received over any link, retransmissions included.
    records_with_repetitions: Rc<Cell<usize>>,
    /// Number of live frames that arrived.
    pub live: u64,
    /// The last live frame that arrived.
    pub last_live: Option<Live>,
    /// The hello of each session that the host opened, without those of retransmissions, which the client requests itself.
    pub hellos: Vec<Hello>,
    /// The texts of the client's errors.
    pub errors: Vec<String>,
    /// Number of requests of a scenario that were refused or not answered.
    pub failed_requests: usize,
}

impl Host {
    /// A host without a session.
    pub fn new(world: &SharedWorld, insole: usize) -> Self {
        Self {
            world: world.clone(),
            insole,
            over: LinkKind::Serial,
            client: None,
            is_following: false,
            wants_live: false,
            acknowledges: true,
            is_broken: false,
            last_message_us: 0,
            records: Vec::new(),
            records_with_repetitions: Rc::default(),
            live: 0,
            last_live: None,
            hellos: Vec::new(),
            errors: Vec::new(),
            failed_requests: 0,
        }
    }

    /// Follows the insole over this link from now on; requests live frames if `live` is true.
    pub fn connect(&mut self, over: LinkKind, live: bool) {
        (self.over, self.wants_live, self.is_following) = (over, live, true);
        self.is_broken = true;
    }

    /// Ends the session.
    pub fn disconnect(&mut self) {
        self.is_following = false;
        if self.over == LinkKind::Bluetooth {
            self.world.borrow().insoles[self.insole].radio.borrow_mut().set_connected(false);
        } else if let Some(client) = &mut self.client {
            // No message ends a session over a cable: turn the stream off instead.
            let _ = client.send(ToDevice::Stream { live: false });
        }
    }

    /// Receives one message or waits a short time. Connects again if the link was lost.
    pub fn poll(&mut self) {
        if !self.is_following {
            self.world.borrow_mut().run_for(WAIT_US);
            return;
        }
        if self.is_broken || now_us() - self.last_message_us > SILENCE_US {
            self.open();
            return;
        }
        let Some(client) = &mut self.client else { return };
        let before_us = now_us();
        match client.receive() {
            Ok(Some(message)) => {
                self.last_message_us = now_us();
                self.handle(message);
            }
            // The client handled a message itself, such as the insole's time, which it requests all the time, or a part of a
            // frame arrived.
            Ok(None) if now_us() - before_us < WAIT_US => self.last_message_us = now_us(),
            Ok(None) => {}
            Err(error) => self.fail(&error),
        }
    }

    /// Records an error, and lets the next [`Self::poll`] open the link again.
    fn fail(&mut self, error: &client::Error) {
        self.errors.push(error.to_string());
        self.is_broken = true;
    }

    /// Opens the link and a session.
    fn open(&mut self) {
        let open = || {
            let link = Link::open(&self.world, self.insole, self.over).map_err(client::Error::Carrier)?;
            Ok(Link { records: self.records_with_repetitions.clone(), ..link })
        };
        let hello = match &mut self.client {
            Some(client) => client.reconnect_over(open, CONNECT_TIMEOUT).cloned(),
            None => open().and_then(|link| Client::connect(link, CONNECT_TIMEOUT)).map(|client| {
                let hello = client.hello().clone();
                self.client = Some(client);
                hello
            }),
        };
        match hello {
            Ok(hello) => {
                self.hellos.push(hello);
                self.is_broken = false;
                self.last_message_us = now_us();
                if self.wants_live
                    && let Some(client) = &mut self.client
                    && let Err(error) = client.stream()
                {
                    self.fail(&error);
                }
            }
            Err(error) => {
                self.fail(&error);
                self.world.borrow_mut().run_for(WAIT_US);
            }
        }
    }

    fn handle(&mut self, message: ToHost) {
        match message {
            ToHost::Live(live) => {
                self.live += 1;
                self.last_live = Some(live);
            }
            message => {
                let Some(record) = LoadRecord::of(&message) else { return };
                self.records.push(record);
                if self.acknowledges
                    && let Some(client) = &mut self.client
                    && let Err(error) = client.send(ToDevice::Acknowledge { number: record.number() })
                {
                    self.fail(&error);
                }
            }
        }
    }

    /// Number of times that a load record arrived again.
    pub fn repetitions(&self) -> usize {
        self.records_with_repetitions.get() - self.records.len()
    }

    /// The load bouts, in the order of their arrival.
    pub fn bouts(&self) -> impl Iterator<Item = &Bout> {
        self.records.iter().filter_map(LoadRecord::bout)
    }

    /// The alerts, in the order of their arrival.
    pub fn alerts(&self) -> impl Iterator<Item = &Alert> {
        self.records.iter().filter_map(LoadRecord::alert)
    }

    /// The steps, in the order of their arrival.
    pub fn steps(&self) -> impl Iterator<Item = &Step> {
        self.records.iter().filter_map(LoadRecord::step)
    }

    /// Sets typical parameters. An error is added to [`Host::errors`].
    pub fn set_parameters(&mut self) {
        let tissue = Parameters::typical(InsoleSize::default()).tissue();
        if let Some(Err(error)) = self.client.as_mut().map(|client| client.set_tissue(&tissue)) {
            self.fail(&error);
        }
    }

    /// Restarts the insole. An error is added to [`Host::errors`].
    pub fn restart(&mut self) {
        if let Some(Err(error)) = self.client.as_mut().map(|client| client.send(ToDevice::Restart)) {
            self.fail(&error);
        }
    }

    /// The insole's counters; `None` if the insole does not answer.
    pub fn status(&mut self) -> Option<Status> {
        self.client.as_mut()?.status().ok()
    }
}
