//! Simulated phones, emulated insoles, and the simulated radio between them.

use crate::common::{firmware, python};
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Recorded, Scan, Time, Walk};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::{LoadRecord, MAJOR, MINOR, Reset, Status, ToDevice, ToHost, decode, encode};
use plantar::storage::{Bonds, Store};
use recording::{Recording, VirtualInsole};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};
use testkit::nor_flash::{NorFlashChip, block_on};

/// Longest wait for a line from the simulated phones.
pub const TIMEOUT: Duration = Duration::from_secs(60);

/// UUID of the insole's characteristic Control.
pub const CONTROL: &str = "dca8c301-cb96-463f-8bec-f2094e1ccf7b";
/// UUID of the insole's characteristic Live.
pub const LIVE: &str = "dca8c302-cb96-463f-8bec-f2094e1ccf7b";
/// UUID of the insole's characteristic Steps.
pub const STEPS: &str = "dca8c303-cb96-463f-8bec-f2094e1ccf7b";
/// UUID of the insole's characteristic Parameters.
pub const PARAMETERS: &str = "dca8c304-cb96-463f-8bec-f2094e1ccf7b";
/// UUIDs of the characteristics of the insole's own service.
pub const CHARACTERISTICS: [&str; 4] = [CONTROL, LIVE, STEPS, PARAMETERS];
/// UUID of the characteristic of management tools.
pub const MANAGEMENT: &str = "da2e7828-fbce-4e01-ae9e-261174997c48";
/// UUID of the characteristic Current Time of the standard service of that name.
pub const CURRENT_TIME: &str = "2a2b";
/// UUID of the standard characteristic RSC Measurement (running speed and cadence), which contains the cadence.
pub const RSC_MEASUREMENT: &str = "2a53";

/// The reason why an action of a phone failed.
#[derive(Debug)]
pub struct PhoneError {
    /// The error code of the attribute protocol, if the insole sent one.
    pub att: Option<u64>,
    #[allow(dead_code, reason = "printed by `Debug`")]
    text: String,
}

/// The simulation of phones and radios, a process in Python.
pub struct RadioSimulation {
    python: Child,
    requests: ChildStdin,
    /// The lines that the simulation writes, and their times of arrival.
    lines: Receiver<(Instant, Value)>,
    /// Events of the phones that no test has read yet.
    pub events: VecDeque<(Instant, Value)>,
}

impl RadioSimulation {
    /// Starts the simulation without phones.
    pub fn start() -> Self {
        let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tools/virtual-phone/phone.py");
        let mut command = Command::new(python());
        command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut python = command.spawn().expect("Python starts");
        let requests = python.stdin.take().expect("the pipe was requested");
        let out = BufReader::new(python.stdout.take().expect("the pipe was requested"));
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                let line = serde_json::from_str(&line).expect("the simulated phones write JSON");
                if sender.send((Instant::now(), line)).is_err() {
                    break;
                }
            }
        });
        Self { python, requests, lines, events: VecDeque::new() }
    }

    /// Waits for the next line of the simulation.
    fn line(&self) -> (Instant, Value) {
        self.lines.recv_timeout(TIMEOUT).expect("the simulated phones write a line within a minute")
    }

    /// Sends a request to the simulation; returns its result or its error.
    pub fn try_request(&mut self, request: Value) -> Result<Value, PhoneError> {
        writeln!(self.requests, "{request}").expect("the simulated phones run");
        loop {
            let (arrival, line) = self.line();
            if line.get("did").is_none() {
                self.events.push_back((arrival, line));
            } else if let Some(error) = line.get("error") {
                return Err(PhoneError { att: line["att"].as_u64(), text: error.to_string() });
            } else {
                return Ok(line);
            }
        }
    }

    /// Sends a request that must succeed.
    pub fn request(&mut self, request: Value) -> Value {
        let text = request.to_string();
        self.try_request(request).unwrap_or_else(|error| panic!("{text}: {error:?}"))
    }

    /// The next event of a phone, and its time.
    fn next_event(&mut self, phone: &str) -> (Instant, Value) {
        let mut known = self.events.iter().position(|(_, line)| line["phone"] == phone);
        loop {
            if let Some(event) = known.and_then(|index| self.events.remove(index)) {
                return event;
            }
            let line = self.line();
            known = (line.1["phone"] == phone).then_some(self.events.len());
            self.events.push_back(line);
        }
    }

    /// A new phone with this number, for the insole with this name. The phone is not connected yet.
    pub fn phone(&mut self, number: u8, insole: &'static str) -> Phone {
        let name = format!("phone {number}");
        self.request(json!({"do": "phone", "name": name, "address": format!("D0:00:00:00:00:{number:02X}")}));
        Phone { name, insole, max_len: 20, joiners: BTreeMap::new() }
    }

    /// A bonded phone with a connection and an open session.
    pub fn bonded_phone(&mut self, number: u8, insole: &'static str, mtu: u16) -> Phone {
        let mut phone = self.phone(number, insole);
        phone.connect(self, mtu);
        self.request(json!({"do": "pair", "phone": phone.name}));
        phone.open(self);
        phone
    }

    /// Discards the events that were received while requests waited for their results.
    pub fn discard_events(&mut self) {
        self.events.clear();
    }
}

impl Drop for RadioSimulation {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.python.kill();
        let _ = self.python.wait();
    }
}

/// A walk that waits before each scan until the test allows the scan, so that no message is lost on a slow link.
struct Paced {
    walk: Recorded,
    /// Number of scans so far.
    scanned: u32,
    allowed: Arc<Allowed>,
}

/// The number of scans that the test allows, and the notification of its changes.
#[derive(Default)]
struct Allowed(Mutex<u32>, Condvar);

impl Walk for Paced {
    fn scans(&self) -> u32 {
        // The emulator calls this function before each scan, and so waits here.
        let allowed = self.allowed.0.lock().unwrap_or_else(PoisonError::into_inner);
        let waits = |allowed: &mut u32| *allowed <= self.scanned && self.scanned < self.walk.scans();
        drop(self.allowed.1.wait_while(allowed, waits));
        self.walk.scans()
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.scanned = seq + 1;
        self.walk.scan(seq, codes)
    }
}

/// Position of the bonds in the stored keys, after the version and the insole's own key; the first byte is their number.
pub const BONDS_AT: usize = 18;

/// An emulated insole. Its time advances only as far as the test allows with [`Self::play`].
pub struct Insole {
    pub board: Board,
    pub recording: Recording,
    allowed: Arc<Allowed>,
}

impl Insole {
    /// Starts a board that plays this recording. `change` modifies its configuration, and `flash` is the content of its flash
    /// chip; `None` for a new chip.
    pub fn boot(
        radio: &mut RadioSimulation,
        firmware: &Path,
        recording: Recording,
        change: impl FnOnce(&mut EmulatorConfig),
        flash: Option<Vec<u8>>,
    ) -> Self {
        let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        let allowed = Arc::<Allowed>::default();
        let walk = Paced {
            walk: Recorded::new(recording.clone(), virtual_insole.clone()),
            scanned: 0,
            allowed: allowed.clone(),
        };
        let board = boot(radio, firmware, &virtual_insole, Time::Fastest, walk, change, flash);
        board.play();
        Self { board, recording, allowed }
    }

    /// The keys that the insole stores, its own key and those of its bonds; `None` if it stores none.
    pub fn keys(&self) -> Option<Bonds> {
        let mut chip = NorFlashChip::of(self.board.flash().expect("the chip can be read"));
        block_on(async { Store::open(Some(&mut chip), Reset::Power).await.get(0).await }).expect("the chip works")
    }

    /// The content of the flash chip with other keys.
    pub fn flash_with_keys(&self, keys: &Bonds) -> Vec<u8> {
        let mut chip = NorFlashChip::of(self.board.flash().expect("the chip can be read"));
        block_on(async { Store::open(Some(&mut chip), Reset::Power).await.put(0, keys).await })
            .expect("the chip works");
        chip.bytes
    }

    /// The keys that the insole stores; `None` without a bond.
    pub fn bonds(&self) -> Option<Bonds> {
        self.keys().filter(|Bonds(bytes)| bytes[BONDS_AT] > 0)
    }

    /// Allows time to advance until this number of scans is complete.
    pub fn play(&self, scans: u32) {
        let mut allowed = self.allowed.0.lock().unwrap_or_else(PoisonError::into_inner);
        *allowed = (*allowed).max(scans);
        self.allowed.1.notify_all();
    }

    /// Number of scans of the whole walk.
    pub fn scans(&self) -> u32 {
        let virtual_insole = VirtualInsole::new(&self.recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        virtual_insole.frames(&self.recording) as u32
    }
}

/// Starts a board with a simulated radio of its own. `change` modifies the configuration, and `flash` is the content of the flash
/// chip; `None` for a new chip.
pub fn boot(
    radio: &mut RadioSimulation,
    firmware: &Path,
    virtual_insole: &VirtualInsole,
    time: Time,
    walk: impl Walk,
    change: impl FnOnce(&mut EmulatorConfig),
    flash: Option<Vec<u8>>,
) -> Board {
    let side = virtual_insole.setup.side;
    let address = [1 + side as u8, 0, 0, 0, 0, 0xc0];
    // On a slow computer, some phones take minutes to pair.
    let mut config = EmulatorConfig { address, bonding_s: 600, ..EmulatorConfig::new(virtual_insole.setup) };
    change(&mut config);
    let port = radio.request(json!({"do": "radio", "name": side.name()}))["port"]
        .as_u64()
        .expect("the simulation returns a port");
    let hardware = Hardware { hci: Some(([127, 0, 0, 1], port as u16).into()), flash, swapped: false };
    Board::start_with(firmware, &config, &virtual_insole.cells, time, walk, &hardware).expect("the board boots")
}

/// A left insole and the radio simulation.
pub struct World {
    pub radio: RadioSimulation,
    pub insole: Insole,
}

impl World {
    /// Starts the simulation and the insole.
    pub fn start(recording: Recording) -> Self {
        Self::start_with(recording, |_| {})
    }

    /// Starts the simulation and an insole with a changed configuration.
    pub fn start_with(recording: Recording, change: fn(&mut EmulatorConfig)) -> Self {
        let firmware = firmware();
        let mut radio = RadioSimulation::start();
        let insole = Insole::boot(&mut radio, &firmware, recording, change, None);
        Self { radio, insole }
    }

    /// Switches the board off and on again, with a changed configuration.
    pub fn restart(&mut self, change: fn(&mut EmulatorConfig)) {
        let flash = self.insole.board.flash().expect("the chip can be read");
        self.restart_with(change, flash);
    }

    /// Restarts the board as [`Self::restart`] does, with another content of the flash chip.
    pub fn restart_with(&mut self, change: fn(&mut EmulatorConfig), flash: Vec<u8>) {
        let firmware = firmware();
        let recording = self.insole.recording.clone();
        self.insole = Insole::boot(&mut self.radio, &firmware, recording, change, Some(flash));
        self.radio.discard_events();
    }

    /// A new phone that can connect to the insole.
    pub fn new_phone(&mut self, number: u8) -> Phone {
        self.radio.phone(number, "Plantar L")
    }

    /// A bonded phone with a connection to the insole and an open session.
    pub fn bonded_phone(&mut self, mtu: u16) -> Phone {
        self.radio.bonded_phone(1, "Plantar L", mtu)
    }
}

/// A simulated phone.
pub struct Phone {
    /// The name of the phone in the simulation.
    pub name: String,
    /// The name of the insole to which the phone connects.
    insole: &'static str,
    /// Largest length of a characteristic's value, bytes.
    max_len: usize,
    /// The joiner of the fragments of each characteristic, by its UUID.
    pub joiners: BTreeMap<String, Joiner>,
}

impl Phone {
    /// Finds the insole, connects to it, and returns its GATT table.
    pub fn connect(&mut self, radio: &mut RadioSimulation, mtu: u16) -> Value {
        self.connect_without_discovery(radio, mtu);
        radio.request(json!({"do": "discover", "phone": self.name}))["table"].clone()
    }

    /// As [`Self::connect`], without its last step.
    pub fn connect_without_discovery(&mut self, radio: &mut RadioSimulation, mtu: u16) {
        let found = radio.request(json!({"do": "scan", "phone": self.name, "name": self.insole}));
        radio.request(json!({"do": "connect", "phone": self.name, "address": found["address"]}));
        self.joiners.clear();
        self.max_len = 20;
        if mtu > 23 {
            let agreed = radio.request(json!({"do": "mtu", "phone": self.name, "mtu": mtu}))["mtu"].as_u64();
            assert_eq!(agreed, Some(mtu.into()));
            self.max_len = usize::from(mtu) - 3;
        }
    }

    /// Subscribes to the insole's own characteristics and opens a session.
    pub fn open(&mut self, radio: &mut RadioSimulation) {
        for characteristic in CHARACTERISTICS {
            radio.request(json!({"do": "subscribe", "phone": self.name, "to": characteristic}));
        }
        self.send(radio, ToDevice::Connect { major: MAJOR, minor: MINOR });
        let hello = self.next(radio);
        assert!(matches!(&hello, ToHost::Hello(hello) if hello.fault.is_none()), "{hello:?}");
    }

    /// Connects again with the existing bond and the known GATT table, and opens a session.
    pub fn reopen(&mut self, radio: &mut RadioSimulation, mtu: u16) {
        self.connect_without_discovery(radio, mtu);
        radio.request(json!({"do": "encrypt", "phone": self.name}));
        self.open(radio);
    }

    /// Ends the connection. Events that were not read are discarded.
    pub fn disconnect(&mut self, radio: &mut RadioSimulation) {
        radio.request(json!({"do": "disconnect", "phone": self.name}));
        radio.events.retain(|(_, line)| line["phone"] != self.name);
    }

    /// Waits until the insole has ended the connection.
    pub fn wait_for_disconnection(&mut self, radio: &mut RadioSimulation) {
        while radio.next_event(&self.name).1.get("lost").is_none() {}
    }

    /// Breaks the link, as if the phone were out of range.
    pub fn cut(&mut self, radio: &mut RadioSimulation) {
        radio.request(json!({"do": "cut", "phone": self.name}));
        radio.events.retain(|(_, line)| line["phone"] != self.name);
    }

    /// Writes a value to a characteristic.
    pub fn write(&self, radio: &mut RadioSimulation, characteristic: &str, value: &[u8]) -> Result<(), PhoneError> {
        radio
            .try_request(json!({"do": "write", "phone": self.name, "of": characteristic, "value": hex(value)}))
            .map(|_| ())
    }

    /// Writes a value that must be refused; returns the error code of the attribute protocol.
    pub fn refused(&self, radio: &mut RadioSimulation, characteristic: &str, value: &[u8]) -> Option<u64> {
        self.write(radio, characteristic, value).expect_err("the value must be refused").att
    }

    /// The value of a characteristic.
    pub fn read(&self, radio: &mut RadioSimulation, characteristic: &str) -> Vec<u8> {
        unhex(&radio.request(json!({"do": "read", "phone": self.name, "of": characteristic}))["value"])
    }

    /// Writes a value to a characteristic without a response, and at once reads the characteristic. An error in response to the
    /// write would be taken for the response to the read request.
    pub fn command_and_read(&self, radio: &mut RadioSimulation, characteristic: &str, value: &[u8]) -> Vec<u8> {
        let command = json!({"do": "command", "phone": self.name, "of": characteristic, "value": hex(value)});
        unhex(&radio.request(command)["value"])
    }

    /// Sends content on a channel of L2CAP, whether it is valid or not.
    pub fn packets(&self, radio: &mut RadioSimulation, channel: u16, contents: &[Vec<u8>]) {
        let contents: Vec<_> = contents.iter().map(|content| hex(content)).collect();
        radio.request(json!({"do": "packets", "phone": self.name, "channel": channel, "contents": contents}));
    }

    /// Sends a message in fragments.
    pub fn send(&self, radio: &mut RadioSimulation, message: ToDevice) {
        let characteristic =
            if matches!(message, ToDevice::SetTissue(_) | ToDevice::SetIdentifiedTissue { .. } | ToDevice::GetTissue) {
                PARAMETERS
            } else {
                CONTROL
            };
        for fragment in fragments(&message, self.max_len) {
            self.write(radio, characteristic, &fragment).expect("the insole accepts the value");
        }
    }

    /// The next value that the insole sends, and its characteristic.
    pub fn value(&mut self, radio: &mut RadioSimulation) -> (String, Vec<u8>) {
        let (_, characteristic, value) = self.value_with_arrival(radio);
        (characteristic, value)
    }

    /// The same as [`Self::value`], with the time of arrival.
    fn value_with_arrival(&mut self, radio: &mut RadioSimulation) -> (Instant, String, Vec<u8>) {
        let (arrival, line) = radio.next_event(&self.name);
        let Some(characteristic) = line["of"].as_str() else { panic!("the connection ended: {line}") };
        (arrival, characteristic.into(), unhex(&line["value"]))
    }

    /// The next message that the insole sends.
    pub fn next(&mut self, radio: &mut RadioSimulation) -> ToHost {
        self.next_with_arrival(radio).1
    }

    /// The next message, and the time at which its last fragment arrived.
    pub fn next_with_arrival(&mut self, radio: &mut RadioSimulation) -> (Instant, ToHost) {
        loop {
            let (arrival, characteristic, value) = self.value_with_arrival(radio);
            assert!(value.len() <= self.max_len);
            let joiner = self.joiners.entry(characteristic.clone()).or_default();
            let Some(message) = joiner.push(&value).expect("fragments arrive in order") else { continue };
            let message = decode(message).expect("the bytes are one complete message");
            let expected = match message {
                ToHost::Live(_) | ToHost::Cells(_) | ToHost::Ellipses(_) => LIVE,
                ToHost::Step(_) | ToHost::Bout(_) | ToHost::Alert(_) => STEPS,
                ToHost::Tissue(_) | ToHost::Refused(_) => PARAMETERS,
                _ => CONTROL,
            };
            assert_eq!(characteristic, expected, "{message:?}");
            return (arrival, message);
        }
    }

    /// Sends a request and returns its answer.
    pub fn answer(&mut self, radio: &mut RadioSimulation, request: ToDevice) -> ToHost {
        self.send(radio, request);
        loop {
            let message = self.next(radio);
            if !matches!(message, ToHost::Live(_) | ToHost::Cells(_)) && LoadRecord::of(&message).is_none() {
                return message;
            }
        }
    }

    /// Sets the wearer's parameters, which the insole must confirm.
    pub fn set_tissue(&mut self, radio: &mut RadioSimulation, tissue: Tissue) {
        assert_eq!(self.answer(radio, ToDevice::SetTissue(tissue)), ToHost::Tissue(tissue));
    }

    /// The insole's counters.
    pub fn status(&mut self, radio: &mut RadioSimulation) -> Status {
        match self.answer(radio, ToDevice::GetStatus) {
            ToHost::Status(status) => status,
            other => panic!("the insole answered a request for its status with {other:?}"),
        }
    }
}

/// Bytes as hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of a JSON string of hexadecimal digits.
pub fn unhex(text: &Value) -> Vec<u8> {
    let text = text.as_str().expect("the text is hexadecimal");
    (0..text.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(&text[i..i + 2], 16).expect("the text is hexadecimal"))
        .collect()
}

/// The fragments of a message, each of at most `max_len` bytes.
pub fn fragments(message: &ToDevice, max_len: usize) -> Vec<Vec<u8>> {
    let mut splitter = Splitter::new();
    let len = encode(message, splitter.buffer()).expect("the message fits").len();
    splitter.start(len);
    let mut fragment = vec![0; max_len];
    std::iter::from_fn(|| splitter.next(&mut fragment).map(|len| fragment[..len].to_vec())).collect()
}
