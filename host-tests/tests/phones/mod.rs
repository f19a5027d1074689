//! Phones in software, the insoles on their boards, and the air between them.
#![allow(dead_code, reason = "not every test needs all of it")]

use crate::common::{firmware, python};
use emulation::EmulatorConfig;
use emulator::{Board, Hardware, Recorded, Scan, Time, Walk};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance::StanceRule;
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::{MAJOR, MINOR, Reset, Status, ToDevice, ToHost, decode, encode};
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
use testkit::nor_flash::{NorFlashChip, now};

/// Whoever is silent for longer has stopped.
pub const PATIENCE: Duration = Duration::from_secs(60);

pub const CONTROL: &str = "dca8c301-cb96-463f-8bec-f2094e1ccf7b";
pub const LIVE: &str = "dca8c302-cb96-463f-8bec-f2094e1ccf7b";
pub const STEPS: &str = "dca8c303-cb96-463f-8bec-f2094e1ccf7b";
pub const PARAMETERS: &str = "dca8c304-cb96-463f-8bec-f2094e1ccf7b";
pub const OURS: [&str; 4] = [CONTROL, LIVE, STEPS, PARAMETERS];
pub const CURRENT_TIME: &str = "2a2b";
pub const CADENCE: &str = "2a53";

/// Why an order failed.
#[derive(Debug)]
pub struct Fault {
    /// The attribute error, if it was one.
    pub att: Option<u64>,
    #[allow(dead_code, reason = "for reading")]
    text: String,
}

/// The phones, the radios, and the air between them.
pub struct Air {
    python: Child,
    orders: ChildStdin,
    lines: Receiver<(Instant, Value)>,
    /// What came in between, and is for a phone.
    heard: VecDeque<(Instant, Value)>,
}

impl Air {
    pub fn start() -> Self {
        let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tools/virtual-phone/phone.py");
        let mut command = Command::new(python());
        command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut python = command.spawn().expect("Python starts");
        let orders = python.stdin.take().expect("it was asked for");
        let out = BufReader::new(python.stdout.take().expect("it was asked for"));
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                let line = serde_json::from_str(&line).expect("the phones speak JSON");
                if sender.send((Instant::now(), line)).is_err() {
                    break;
                }
            }
        });
        Self { python, orders, lines, heard: VecDeque::new() }
    }

    fn line(&self) -> (Instant, Value) {
        self.lines.recv_timeout(PATIENCE).expect("the phones go on")
    }

    pub fn attempt(&mut self, order: Value) -> Result<Value, Fault> {
        writeln!(self.orders, "{order}").expect("the phones listen");
        loop {
            let (at, line) = self.line();
            if line.get("did").is_none() {
                self.heard.push_back((at, line));
            } else if let Some(error) = line.get("error") {
                return Err(Fault { att: line["att"].as_u64(), text: error.to_string() });
            } else {
                return Ok(line);
            }
        }
    }

    pub fn order(&mut self, order: Value) -> Value {
        let said = order.to_string();
        self.attempt(order).unwrap_or_else(|fault| panic!("{said}: {fault:?}"))
    }

    /// The next thing that a phone is told, and when it came.
    fn hear(&mut self, phone: &str) -> (Instant, Value) {
        let mut known = self.heard.iter().position(|(_, line)| line["phone"] == phone);
        loop {
            if let Some(heard) = known.and_then(|at| self.heard.remove(at)) {
                return heard;
            }
            let line = self.line();
            known = (line.1["phone"] == phone).then_some(self.heard.len());
            self.heard.push_back(line);
        }
    }

    /// A new phone, for the insole of this name.
    pub fn phone(&mut self, number: u8, insole: &'static str) -> Phone {
        let name = format!("phone {number}");
        self.order(json!({"do": "phone", "name": name, "address": format!("D0:00:00:00:00:{number:02X}")}));
        Phone { name, insole, room: 20, joiners: BTreeMap::new() }
    }

    /// A phone with a bond, connected, that has subscribed to all of ours.
    pub fn bonded_phone(&mut self, number: u8, insole: &'static str, mtu: u16) -> Phone {
        let mut phone = self.phone(number, insole);
        phone.connect(self, mtu);
        self.order(json!({"do": "pair", "phone": phone.name}));
        phone.open(self);
        phone
    }

    /// Nothing of what was said so far matters.
    pub fn forget(&mut self) {
        self.heard.clear();
    }
}

impl Drop for Air {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.python.kill();
        let _ = self.python.wait();
    }
}

/// A walk whose scans wait until they are allowed, so that a slow link misses none.
struct Paced {
    walk: Recorded,
    scanned: u32,
    allowed: Arc<Allowed>,
}

#[derive(Default)]
struct Allowed(Mutex<u32>, Condvar);

impl Walk for Paced {
    fn scans(&self) -> u32 {
        // The board asks for the time of each scan, and is asked to wait here.
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

/// An insole on its board, whose time goes as far as it is allowed to.
pub struct Insole {
    pub board: Board,
    pub recording: Recording,
    allowed: Arc<Allowed>,
}

impl Insole {
    /// Starts the board.
    pub fn boot(
        air: &mut Air,
        firmware: &Path,
        recording: Recording,
        change: impl FnOnce(&mut EmulatorConfig),
        flash: Option<Vec<u8>>,
    ) -> Self {
        let worn = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::WALKING);
        let allowed = Arc::<Allowed>::default();
        let walk = Paced { walk: Recorded::new(recording.clone(), worn.clone()), scanned: 0, allowed: allowed.clone() };
        let board = boot(air, firmware, &worn, Time::Max, walk, change, flash);
        board.play();
        Self { board, recording, allowed }
    }

    /// The bonds that the board keeps.
    pub fn bonds(&self) -> Option<Bonds> {
        let mut chip = NorFlashChip::of(self.board.flash().expect("the chip can be read"));
        now(async { Store::open(Some(&mut chip), Reset::Power).await.get(0).await }).expect("the chip works")
    }

    /// Lets time go on until so many scans are done.
    pub fn play(&self, scans: u32) {
        let mut allowed = self.allowed.0.lock().unwrap_or_else(PoisonError::into_inner);
        *allowed = (*allowed).max(scans);
        self.allowed.1.notify_all();
    }

    /// Scans of the whole walk.
    pub fn scans(&self) -> u32 {
        let worn = VirtualInsole::new(&self.recording, ContactRule::COUNTED, StanceRule::WALKING);
        worn.frames(&self.recording) as u32
    }
}

/// Starts a board with a radio of its own.
pub fn boot(
    air: &mut Air,
    firmware: &Path,
    worn: &VirtualInsole,
    time: Time,
    walk: impl Walk,
    change: impl FnOnce(&mut EmulatorConfig),
    flash: Option<Vec<u8>>,
) -> Board {
    let side = worn.setup.side;
    let mut head = EmulatorConfig { address: [1 + side as u8, 0, 0, 0, 0, 0xc0], ..EmulatorConfig::new(worn.setup) };
    change(&mut head);
    let port = air.order(json!({"do": "radio", "name": side.name()}))["port"].as_u64().expect("a port");
    let hardware = Hardware { hci: Some(([127, 0, 0, 1], port as u16).into()), flash, swapped: false };
    Board::start_with(firmware, &head, &worn.cells, time, walk, &hardware).expect("the board boots")
}

/// A left insole and its air.
pub struct World {
    pub air: Air,
    pub insole: Insole,
}

impl World {
    pub fn start(recording: Recording) -> Self {
        let firmware = firmware();
        let mut air = Air::start();
        let insole = Insole::boot(&mut air, &firmware, recording, |_| {}, None);
        Self { air, insole }
    }

    /// Switches the board off and on.
    pub fn restart(&mut self, change: fn(&mut EmulatorConfig)) {
        let flash = self.insole.board.flash().expect("the chip can be read");
        let firmware = firmware();
        let recording = self.insole.recording.clone();
        self.insole = Insole::boot(&mut self.air, &firmware, recording, change, Some(flash));
        self.air.forget();
    }

    pub fn new_phone(&mut self, number: u8) -> Phone {
        self.air.phone(number, "Plantar L")
    }

    pub fn bonded_phone(&mut self, mtu: u16) -> Phone {
        self.air.bonded_phone(1, "Plantar L", mtu)
    }
}

/// A phone as the tests see it.
pub struct Phone {
    pub name: String,
    /// The insole's name.
    insole: &'static str,
    /// Longest value.
    room: usize,
    pub joiners: BTreeMap<String, Joiner>,
}

impl Phone {
    /// Finds the insole, connects and looks at its table.
    pub fn connect(&mut self, air: &mut Air, mtu: u16) -> Value {
        self.reach(air, mtu);
        air.order(json!({"do": "discover", "phone": self.name}))["table"].clone()
    }

    fn reach(&mut self, air: &mut Air, mtu: u16) {
        let found = air.order(json!({"do": "scan", "phone": self.name, "name": self.insole}));
        air.order(json!({"do": "connect", "phone": self.name, "address": found["address"]}));
        self.joiners.clear();
        self.room = 20;
        if mtu > 23 {
            let agreed = air.order(json!({"do": "mtu", "phone": self.name, "mtu": mtu}))["mtu"].as_u64();
            assert_eq!(agreed, Some(mtu.into()));
            self.room = usize::from(mtu) - 3;
        }
    }

    /// Subscribes to ours and opens a session.
    pub fn open(&mut self, air: &mut Air) {
        for way in OURS {
            air.order(json!({"do": "subscribe", "phone": self.name, "to": way}));
        }
        self.send(air, ToDevice::Connect { major: MAJOR, minor: MINOR });
        let hello = self.next(air);
        assert!(matches!(&hello, ToHost::Hello(hello) if hello.last_panic.is_none()), "{hello:?}");
    }

    /// The same again with the bond and the table of before.
    pub fn reopen(&mut self, air: &mut Air, mtu: u16) {
        self.reach(air, mtu);
        air.order(json!({"do": "encrypt", "phone": self.name}));
        self.open(air);
    }

    pub fn disconnect(&mut self, air: &mut Air) {
        air.order(json!({"do": "disconnect", "phone": self.name}));
        air.heard.retain(|(_, line)| line["phone"] != self.name);
    }

    /// Waits until the insole has ended the connection.
    pub fn lose(&mut self, air: &mut Air) {
        while air.hear(&self.name).1.get("lost").is_none() {}
    }

    /// The link breaks, as when the phone is carried away.
    pub fn cut(&mut self, air: &mut Air) {
        air.order(json!({"do": "cut", "phone": self.name}));
        air.heard.retain(|(_, line)| line["phone"] != self.name);
    }

    pub fn write(&self, air: &mut Air, way: &str, value: &[u8]) -> Result<(), Fault> {
        air.attempt(json!({"do": "write", "phone": self.name, "of": way, "value": hex(value)})).map(|_| ())
    }

    pub fn refused(&self, air: &mut Air, way: &str, value: &[u8]) -> Option<u64> {
        self.write(air, way, value).expect_err("it is refused").att
    }

    pub fn read(&self, air: &mut Air, way: &str) -> Vec<u8> {
        unhex(&air.order(json!({"do": "read", "phone": self.name, "of": way}))["value"])
    }

    pub fn send(&self, air: &mut Air, message: ToDevice) {
        let way = if matches!(message, ToDevice::SetTissue(_) | ToDevice::GetTissue) { PARAMETERS } else { CONTROL };
        for piece in pieces(&message, self.room) {
            self.write(air, way, &piece).expect("the insole takes it");
        }
    }

    /// The next value and where it came.
    pub fn value(&mut self, air: &mut Air) -> (String, Vec<u8>) {
        let (_, of, value) = self.value_at(air);
        (of, value)
    }

    fn value_at(&mut self, air: &mut Air) -> (Instant, String, Vec<u8>) {
        let (at, line) = air.hear(&self.name);
        let Some(of) = line["of"].as_str() else { panic!("the connection ended: {line}") };
        (at, of.into(), unhex(&line["value"]))
    }

    /// The next message.
    pub fn next(&mut self, air: &mut Air) -> ToHost {
        self.next_at(air).1
    }

    /// The next message and when its last piece came.
    pub fn next_at(&mut self, air: &mut Air) -> (Instant, ToHost) {
        loop {
            let (at, of, value) = self.value_at(air);
            assert!(value.len() <= self.room);
            let joiner = self.joiners.entry(of.clone()).or_default();
            let Some(message) = joiner.push(&value).expect("pieces come in order") else { continue };
            let message = decode(message).expect("one whole message");
            let way = match message {
                ToHost::Live(_) => LIVE,
                ToHost::Step(_) => STEPS,
                ToHost::Tissue(_) | ToHost::Refused(_) => PARAMETERS,
                ToHost::Hello(_)
                | ToHost::Status(_)
                | ToHost::Time { .. }
                | ToHost::Faults(_)
                | ToHost::Identity(_)
                | ToHost::CalibrationBlock { .. }
                | ToHost::Update(_) => CONTROL,
            };
            assert_eq!(of, way);
            return (at, message);
        }
    }

    pub fn answer(&mut self, air: &mut Air, request: ToDevice) -> ToHost {
        self.send(air, request);
        loop {
            let message = self.next(air);
            if !matches!(message, ToHost::Live(_) | ToHost::Step(_)) {
                return message;
            }
        }
    }

    pub fn set_tissue(&mut self, air: &mut Air, tissue: Tissue) {
        assert_eq!(self.answer(air, ToDevice::SetTissue(tissue)), ToHost::Tissue(tissue));
    }

    pub fn status(&mut self, air: &mut Air) -> Status {
        match self.answer(air, ToDevice::GetStatus) {
            ToHost::Status(status) => status,
            other => panic!("asked for the status, got {other:?}"),
        }
    }
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub fn unhex(text: &Value) -> Vec<u8> {
    let text = text.as_str().expect("hex");
    (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).expect("hex")).collect()
}

pub fn pieces(message: &ToDevice, room: usize) -> Vec<Vec<u8>> {
    let mut splitter = Splitter::new();
    let len = encode(message, splitter.buffer()).expect("it fits").len();
    splitter.start(len);
    let mut piece = vec![0; room];
    std::iter::from_fn(|| splitter.next(&mut piece).map(|len| piece[..len].to_vec())).collect()
}
