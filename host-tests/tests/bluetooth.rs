//! The real firmware in QEMU and phones in software, on a virtual radio link.
//!
//! The firmware is the file that `PLANTAR_FIRMWARE` names, the phones run in the Python that `PLANTAR_PYTHON` names; without
//! them these tests say so and pass.

mod common;

use common::{firmware, replay, synthetic_walk, tissue};
use emulator::{Board, Radio, Recorded, Scan, Time, Walk};
use plantar::contact::ContactRule;
use plantar::emulation::Head;
use plantar::fragment::{Joiner, Splitter};
use plantar::insole::Tissue;
use plantar::stance::StanceRule;
use plantar::wire::{Live, MAJOR, MINOR, Refusal, Status, Step, ToDevice, ToHost, decode, encode};
use plantar::{Region, Side};
use recording::{Recording, VirtualInsole, synthetic};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

/// Whoever is silent for longer has stopped.
const PATIENCE: Duration = Duration::from_secs(60);

const CONTROL: &str = "dca8c301-cb96-463f-8bec-f2094e1ccf7b";
const LIVE: &str = "dca8c302-cb96-463f-8bec-f2094e1ccf7b";
const STEPS: &str = "dca8c303-cb96-463f-8bec-f2094e1ccf7b";
const PARAMETERS: &str = "dca8c304-cb96-463f-8bec-f2094e1ccf7b";
const OURS: [&str; 4] = [CONTROL, LIVE, STEPS, PARAMETERS];
const CURRENT_TIME: &str = "2a2b";
const CADENCE: &str = "2a53";

/// Errors of the attribute protocol.
const INSUFFICIENT_AUTHENTICATION: u64 = 0x05;
const INVALID_LENGTH: u64 = 0x0d;
const INSUFFICIENT_ENCRYPTION: u64 = 0x0f;
const VALUE_NOT_ALLOWED: u64 = 0x13;
const OUT_OF_ORDER: u64 = 0x80;
const NOT_UNDERSTOOD: u64 = 0x81;

/// Why an order failed.
#[derive(Debug)]
struct Fault {
    /// The attribute error, if it was one.
    att: Option<u64>,
    #[allow(dead_code, reason = "for reading")]
    text: String,
}

/// The phones, the radios, and the air between them.
struct Air {
    python: Child,
    orders: ChildStdin,
    lines: Receiver<Value>,
    /// What came in between, and is for a phone.
    heard: VecDeque<Value>,
}

impl Air {
    fn start() -> Option<Self> {
        let Some(python) = std::env::var_os("PLANTAR_PYTHON") else {
            println!("skipped: set PLANTAR_PYTHON to a Python with bumble (`cargo xtask test` does)");
            return None;
        };
        let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tools/virtual-phone/phone.py");
        let mut command = Command::new(python);
        command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut python = command.spawn().expect("Python starts");
        let orders = python.stdin.take().expect("it was asked for");
        let out = BufReader::new(python.stdout.take().expect("it was asked for"));
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                let line = serde_json::from_str(&line).expect("the phones speak JSON");
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Some(Self { python, orders, lines, heard: VecDeque::new() })
    }

    fn line(&self) -> Value {
        self.lines.recv_timeout(PATIENCE).expect("the phones go on")
    }

    fn attempt(&mut self, order: Value) -> Result<Value, Fault> {
        writeln!(self.orders, "{order}").expect("the phones listen");
        loop {
            let line = self.line();
            if line.get("did").is_none() {
                self.heard.push_back(line);
            } else if let Some(error) = line.get("error") {
                return Err(Fault { att: line["att"].as_u64(), text: error.to_string() });
            } else {
                return Ok(line);
            }
        }
    }

    fn order(&mut self, order: Value) -> Value {
        let said = order.to_string();
        self.attempt(order).unwrap_or_else(|fault| panic!("{said}: {fault:?}"))
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

impl Allowed {
    fn up_to(&self, scans: u32) {
        let mut allowed = self.0.lock().expect("nobody panics with it");
        *allowed = (*allowed).max(scans);
        self.1.notify_all();
    }
}

impl Walk for Paced {
    fn scans(&self) -> u32 {
        // The board asks for the time of each scan, and is asked to wait here.
        let allowed = self.allowed.0.lock().expect("nobody panics with it");
        drop(
            self.allowed.1.wait_while(allowed, |allowed| *allowed <= self.scanned && self.scanned < self.walk.scans()),
        );
        self.walk.scans()
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        self.scanned = seq + 1;
        self.walk.scan(seq, codes)
    }
}

/// An insole and its air.
struct World {
    air: Air,
    board: Board,
    allowed: Arc<Allowed>,
    head: Head,
    recording: Recording,
}

impl World {
    fn start(recording: Recording) -> Option<Self> {
        Self::start_with(recording, |_| {}, None)
    }

    fn start_with(recording: Recording, change: fn(&mut Head), bonds: Option<Vec<u8>>) -> Option<Self> {
        let firmware = firmware()?;
        let mut air = Air::start()?;
        let (board, allowed, head) = Self::boot(&mut air, &firmware, &recording, change, bonds);
        Some(Self { air, board, allowed, head, recording })
    }

    fn boot(
        air: &mut Air,
        firmware: &std::path::Path,
        recording: &Recording,
        change: fn(&mut Head),
        bonds: Option<Vec<u8>>,
    ) -> (Board, Arc<Allowed>, Head) {
        let worn = VirtualInsole::new(recording, ContactRule::COUNTED, StanceRule::WALKING);
        let mut head = Head::new(worn.setup);
        change(&mut head);
        let port = air.order(json!({"do": "radio", "name": "insole"}))["port"].as_u64().expect("a port");
        let radio = Radio { hci: Some(([127, 0, 0, 1], port as u16).into()), bonds };
        let cells = worn.cells.clone();
        let allowed = Arc::<Allowed>::default();
        let walk = Paced { walk: Recorded::new(recording.clone(), worn), scanned: 0, allowed: allowed.clone() };
        let board = Board::start_with(firmware, &head, &cells, Time::Max, walk, &radio).expect("the board boots");
        board.play();
        (board, allowed, head)
    }

    /// Resets the board; the bonds stay, nothing else does.
    fn restart(&mut self, change: fn(&mut Head)) {
        let bonds = self.board.bonds().expect("the bonds can be read");
        let firmware = firmware().expect("it was there");
        (self.board, self.allowed, self.head) = Self::boot(&mut self.air, &firmware, &self.recording, change, bonds);
        self.air.heard.clear();
    }

    fn new_phone(&mut self, number: u8) -> Phone {
        let name = format!("phone {number}");
        self.air.order(json!({"do": "phone", "name": name, "address": format!("D0:00:00:00:00:{number:02X}")}));
        Phone { name, room: 20, joiners: BTreeMap::new() }
    }

    /// A phone with a bond, connected, that has subscribed to all of ours.
    fn bonded_phone(&mut self, mtu: u16) -> Phone {
        let mut phone = self.new_phone(1);
        phone.connect(self, mtu);
        self.air.order(json!({"do": "pair", "phone": phone.name}));
        phone.open(self);
        phone
    }

    fn play_all(&self) {
        self.allowed.up_to(u32::MAX);
    }

    fn scans(&self) -> u32 {
        VirtualInsole::new(&self.recording, ContactRule::COUNTED, StanceRule::WALKING).frames(&self.recording) as u32
    }
}

/// A phone as the tests see it.
struct Phone {
    name: String,
    /// Longest value.
    room: usize,
    joiners: BTreeMap<String, Joiner>,
}

impl Phone {
    /// Finds the insole, connects and looks at its table.
    fn connect(&mut self, world: &mut World, mtu: u16) -> Value {
        let found = world.air.order(json!({"do": "scan", "phone": self.name, "name": "Plantar L"}));
        world.air.order(json!({"do": "connect", "phone": self.name, "address": found["address"]}));
        self.joiners.clear();
        self.room = 20;
        if mtu > 23 {
            let agreed = world.air.order(json!({"do": "mtu", "phone": self.name, "mtu": mtu}))["mtu"].as_u64();
            assert_eq!(agreed, Some(mtu.into()));
            self.room = usize::from(mtu) - 3;
        }
        world.air.order(json!({"do": "discover", "phone": self.name}))["table"].clone()
    }

    /// Subscribes to ours and opens a session.
    fn open(&mut self, world: &mut World) {
        for way in OURS {
            world.air.order(json!({"do": "subscribe", "phone": self.name, "to": way}));
        }
        self.send(world, ToDevice::Connect { major: MAJOR, minor: MINOR });
        let hello = self.next(world);
        assert!(matches!(&hello, ToHost::Hello(hello) if hello.last_panic.is_none()), "{hello:?}");
    }

    /// The same, encrypted with the bond of before.
    fn reopen(&mut self, world: &mut World, mtu: u16) {
        self.connect(world, mtu);
        world.air.order(json!({"do": "encrypt", "phone": self.name}));
        self.open(world);
    }

    fn disconnect(&mut self, world: &mut World) {
        world.air.order(json!({"do": "disconnect", "phone": self.name}));
        world.air.heard.clear();
    }

    fn write(&self, world: &mut World, way: &str, value: &[u8]) -> Result<(), Fault> {
        world.air.attempt(json!({"do": "write", "phone": self.name, "of": way, "value": hex(value)})).map(|_| ())
    }

    fn refused(&self, world: &mut World, way: &str, value: &[u8]) -> Option<u64> {
        self.write(world, way, value).expect_err("it is refused").att
    }

    fn read(&self, world: &mut World, way: &str) -> Vec<u8> {
        unhex(&world.air.order(json!({"do": "read", "phone": self.name, "of": way}))["value"])
    }

    fn send(&self, world: &mut World, message: ToDevice) {
        let way = if matches!(message, ToDevice::SetTissue(_) | ToDevice::GetTissue) { PARAMETERS } else { CONTROL };
        for piece in pieces(&message, self.room) {
            self.write(world, way, &piece).expect("the insole takes it");
        }
    }

    /// The next value and where it came.
    fn value(&mut self, world: &mut World) -> (String, Vec<u8>) {
        loop {
            let line = world.air.heard.pop_front().unwrap_or_else(|| world.air.line());
            if let Some(of) = line["of"].as_str() {
                return (of.into(), unhex(&line["value"]));
            }
            assert!(line.get("lost").is_none(), "the connection ended: {line}");
        }
    }

    /// The next message.
    fn next(&mut self, world: &mut World) -> ToHost {
        loop {
            let (of, value) = self.value(world);
            assert!(value.len() <= self.room);
            let joiner = self.joiners.entry(of.clone()).or_default();
            let Some(message) = joiner.push(&value).expect("pieces come in order") else { continue };
            let message = decode(message).expect("one whole message");
            let way = match message {
                ToHost::Live(_) => LIVE,
                ToHost::Step(_) => STEPS,
                ToHost::Tissue(_) | ToHost::Refused(_) => PARAMETERS,
                ToHost::Hello(_) | ToHost::Status(_) | ToHost::Time { .. } => CONTROL,
            };
            assert_eq!(of, way);
            return message;
        }
    }

    fn answer(&mut self, world: &mut World, request: ToDevice) -> ToHost {
        self.send(world, request);
        loop {
            let message = self.next(world);
            if !matches!(message, ToHost::Live(_) | ToHost::Step(_)) {
                return message;
            }
        }
    }

    fn set_tissue(&mut self, world: &mut World, tissue: Tissue) {
        assert_eq!(self.answer(world, ToDevice::SetTissue(tissue)), ToHost::Tissue(tissue));
    }

    fn status(&mut self, world: &mut World) -> Status {
        match self.answer(world, ToDevice::GetStatus) {
            ToHost::Status(status) => status,
            other => panic!("asked for the status, got {other:?}"),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &Value) -> Vec<u8> {
    let text = text.as_str().expect("hex");
    (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).expect("hex")).collect()
}

fn pieces(message: &ToDevice, room: usize) -> Vec<Vec<u8>> {
    let mut splitter = Splitter::new();
    let len = encode(message, splitter.buffer()).expect("it fits").len();
    splitter.start(len);
    let mut piece = vec![0; room];
    std::iter::from_fn(|| splitter.next(&mut piece).map(|len| piece[..len].to_vec())).collect()
}

const WALK: fn(usize) -> Recording = |steps| synthetic_walk(steps, 100.0);

#[test]
fn anyone_finds_the_insole_and_reads_who_it_is_and_nothing_else() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.new_phone(1);
    let table = phone.connect(&mut world, 247);
    let (read, write, notify, indicate) = (0x02, 0x08, 0x10, 0x20);
    let expected: Vec<(&str, Vec<(&str, u64)>)> = vec![
        ("1800", vec![("2a00", read), ("2a01", read)]),
        ("1801", vec![]),
        ("180a", vec![("2a29", read), ("2a24", read), ("2a26", read)]),
        ("180f", vec![("2a19", read)]),
        ("1805", vec![(CURRENT_TIME, read | write | notify)]),
        ("1814", vec![(CADENCE, notify), ("2a54", read)]),
        (
            "dca8c300-cb96-463f-8bec-f2094e1ccf7b",
            vec![(CONTROL, write | indicate), (LIVE, notify), (STEPS, notify), (PARAMETERS, write | indicate)],
        ),
    ];
    let expected: Value = expected
        .into_iter()
        .map(|(uuid, characteristics)| {
            let characteristics: Value = characteristics
                .into_iter()
                .map(|(uuid, properties)| {
                    let descriptors: &[&str] = if properties & (notify | indicate) != 0 { &["2902"] } else { &[] };
                    json!({"uuid": uuid, "properties": properties, "descriptors": descriptors})
                })
                .collect();
            json!({"uuid": uuid, "characteristics": characteristics})
        })
        .collect();
    assert_eq!(table, expected, "{table:#}");

    assert_eq!(phone.read(&mut world, "2a00"), b"Plantar L");
    assert_eq!(phone.read(&mut world, "2a29"), b"Plantar");
    assert_eq!(phone.read(&mut world, "2a24"), b"emulated");
    assert_eq!(phone.read(&mut world, "2a26"), env!("CARGO_PKG_VERSION").as_bytes());
    assert_eq!(phone.read(&mut world, "2a19"), [100]);
    assert_eq!(phone.read(&mut world, CURRENT_TIME), [0; 10], "not set");
    assert_eq!(phone.read(&mut world, "2a54"), [0, 0]);

    let connect = pieces(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
    for way in [CONTROL, PARAMETERS, CURRENT_TIME] {
        assert_eq!(phone.refused(&mut world, way, &connect), Some(INSUFFICIENT_AUTHENTICATION), "{way}");
    }
    for way in OURS {
        let subscribed = world.air.attempt(json!({"do": "subscribe", "phone": phone.name, "to": way}));
        assert_eq!(subscribed.expect_err("it is refused").att, Some(INSUFFICIENT_AUTHENTICATION), "{way}");
        assert!(world.air.attempt(json!({"do": "read", "phone": phone.name, "of": way})).is_err());
    }
    assert_eq!(world.board.bonds().expect("the bonds can be read"), None);
}

/// Streams a whole walk to a phone and compares everything with a replay.
fn stream(world: &mut World, phone: &mut Phone) {
    phone.set_tissue(world, tissue());
    phone.send(world, ToDevice::Stream { live: true });
    let (live, steps) = replay(&world.recording, ContactRule::COUNTED, |_| false);
    let (mut got_live, mut got_steps) = (Vec::<Live>::new(), Vec::<Step>::new());
    while got_live.len() < live.len() || got_steps.len() < steps.len() {
        // The insole keeps eight live frames for a slow phone.
        world.allowed.up_to(got_live.len() as u32 + 6);
        match phone.next(world) {
            ToHost::Live(live) => got_live.push(live),
            ToHost::Step(step) => {
                phone.send(world, ToDevice::Acknowledge { step: step.step });
                got_steps.push(step);
            }
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(got_steps, steps);
    assert_eq!(got_live, live);
    let status = phone.status(world);
    assert_eq!((status.live_due, status.live_sent, status.bad_frames), (world.scans(), world.scans(), 0));
}

#[test]
fn a_bonded_phone_gets_every_frame_and_step_of_a_walk() {
    let Some(mut world) = World::start(WALK(3)) else { return };
    let mut phone = world.bonded_phone(247);
    let begin = Instant::now();
    stream(&mut world, &mut phone);
    let values = f64::from(world.scans()) + 6.0;
    println!("{:.0} notifications a second of at most 90 bytes", values / begin.elapsed().as_secs_f64());
    println!("deepest stack with a pairing: {} bytes", phone.status(&mut world).stack_bytes);
}

#[test]
fn the_smallest_values_carry_the_same() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.bonded_phone(23);
    stream(&mut world, &mut phone);
}

#[test]
fn a_bond_outlives_a_reset_and_a_wrong_key_opens_nothing() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.bonded_phone(247);
    let bonds = world.board.bonds().expect("the bonds can be read").expect("there is one");
    // Bonding is closed after this reset: what opens the link is the bond.
    world.restart(|head| head.bonding_s = 0);
    phone.connect(&mut world, 247);
    let connect = pieces(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
    assert_eq!(phone.refused(&mut world, CONTROL, &connect), Some(INSUFFICIENT_ENCRYPTION));
    world.air.order(json!({"do": "encrypt", "phone": phone.name}));
    phone.open(&mut world);
    stream(&mut world, &mut phone);
    assert_eq!(world.board.bonds().expect("the bonds can be read"), Some(bonds));
    phone.disconnect(&mut world);

    phone.connect(&mut world, 23);
    world.air.order(json!({"do": "spoil_key", "phone": phone.name}));
    world.air.attempt(json!({"do": "encrypt", "phone": phone.name})).expect_err("the key is wrong");
    world.air.heard.clear();
    // The insole is there again, for the others.
    let mut other = world.new_phone(2);
    other.connect(&mut world, 23);
    assert_eq!(other.refused(&mut world, CONTROL, &connect), Some(INSUFFICIENT_AUTHENTICATION));
}

#[test]
fn nobody_bonds_when_bonding_is_closed_and_a_forgotten_phone_bonds_again_when_it_is_open() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.bonded_phone(23);
    world.restart(|head| head.bonding_s = 0);
    let bonds = world.board.bonds().expect("the bonds can be read");
    world.air.order(json!({"do": "forget", "phone": phone.name}));
    let mut other = world.new_phone(2);
    for phone in [&mut phone, &mut other] {
        phone.connect(&mut world, 23);
        world.air.attempt(json!({"do": "pair", "phone": phone.name})).expect_err("bonding is closed");
        let connect = pieces(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
        assert!(phone.write(&mut world, CONTROL, &connect).is_err());
        phone.disconnect(&mut world);
    }
    assert_eq!(world.board.bonds().expect("the bonds can be read"), bonds);

    world.restart(|_| {});
    phone.connect(&mut world, 23);
    world.air.order(json!({"do": "pair", "phone": phone.name}));
    phone.open(&mut world);
    assert_ne!(world.board.bonds().expect("the bonds can be read"), bonds);
}

/// A phone that pairs and does not bond has an encrypted link and may do no more than a stranger.
#[test]
fn a_phone_that_does_not_bond_is_a_stranger() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.new_phone(1);
    world.air.order(json!({"do": "phone", "name": phone.name, "address": "D0:00:00:00:00:01", "bonding": false}));
    phone.connect(&mut world, 23);
    world.air.order(json!({"do": "pair", "phone": phone.name}));
    let connect = pieces(&ToDevice::Connect { major: MAJOR, minor: MINOR }, 20).remove(0);
    assert_eq!(phone.refused(&mut world, CONTROL, &connect), Some(INSUFFICIENT_AUTHENTICATION));
    assert_eq!(world.board.bonds().expect("the bonds can be read"), None);
}

/// The oldest of five bonds is forgotten.
#[test]
fn four_phones_are_remembered() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phones: Vec<_> = (1..=5).map(|number| world.new_phone(number)).collect();
    for phone in &mut phones {
        phone.connect(&mut world, 23);
        world.air.order(json!({"do": "pair", "phone": phone.name}));
        phone.open(&mut world);
        phone.disconnect(&mut world);
    }
    world.restart(|head| head.bonding_s = 0);
    for phone in &mut phones[1..] {
        phone.reopen(&mut world, 23);
        phone.disconnect(&mut world);
    }
    phones[0].connect(&mut world, 23);
    world.air.attempt(json!({"do": "encrypt", "phone": phones[0].name})).expect_err("it is forgotten");
}

/// What a phone stores: each step once, acknowledged when it is stored.
#[derive(Default)]
struct Store(Vec<Step>);

impl Store {
    fn take(&mut self, step: Step) {
        if self.0.last().is_none_or(|last| step.step > last.step) {
            self.0.push(step);
        }
    }
}

#[test]
fn links_that_break_at_any_moment_lose_no_step() {
    const STEPS: usize = 12;
    let Some(mut world) = World::start(WALK(STEPS)) else { return };
    let (_, steps) = replay(&world.recording, ContactRule::COUNTED, |_| false);
    let mut phone = world.bonded_phone(23);
    phone.set_tissue(&mut world, tissue());
    phone.send(&mut world, ToDevice::Stream { live: true });
    let (mut store, mut cuts, mut allowed, mut random) = (Store::default(), 0, 0, 1_u32);
    while store.0.len() < steps.len() {
        // A cut after some messages, in the middle of one or between two.
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        for _ in 0..random >> 24 {
            allowed = (allowed + 2).min(world.scans() + 1);
            world.allowed.up_to(allowed);
            if allowed > world.scans() && store.0.len() == steps.len() {
                break;
            }
            let (of, value) = phone.value(&mut world);
            let joiner = phone.joiners.entry(of).or_default();
            if let Some(message) = joiner.push(&value).expect("pieces come in order")
                && let Some(ToHost::Step(step)) = decode(message)
            {
                store.take(step);
                // Every other acknowledgement is lost with the link.
                if step.step % 2 == 1 {
                    phone.send(&mut world, ToDevice::Acknowledge { step: step.step });
                }
            }
            // Without live frames only steps come, and all came.
            if allowed > world.scans() && store.0.len() == steps.len() {
                break;
            }
        }
        phone.disconnect(&mut world);
        cuts += 1;
        phone.reopen(&mut world, 23);
        phone.send(&mut world, ToDevice::Stream { live: true });
    }
    println!("{cuts} cuts, {} steps", steps.len());
    assert_eq!(store.0, steps);
    let status = phone.status(&mut world);
    assert_eq!((status.steps, status.steps_dropped), (steps.len() as u32, 0));
}

#[test]
fn malformed_values_are_refused_and_the_session_goes_on() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.bonded_phone(247);
    let mut refused = |way: &str, value: &[u8]| phone.refused(&mut world, way, value);
    assert_eq!(refused(CONTROL, &[]), Some(INVALID_LENGTH));
    assert_eq!(refused(CONTROL, &[0x80]), Some(NOT_UNDERSTOOD), "no message");
    assert_eq!(refused(CONTROL, &[0x80, 99]), Some(NOT_UNDERSTOOD), "an unknown message");
    assert_eq!(refused(CONTROL, &[0x81, 3]), Some(OUT_OF_ORDER), "the second piece alone");
    assert_eq!(refused(CONTROL, &[0x80, 5]), Some(NOT_UNDERSTOOD), "parameters on the control point");
    assert_eq!(refused(PARAMETERS, &[0x80, 3]), Some(NOT_UNDERSTOOD), "control among the parameters");
    assert_eq!(refused(CURRENT_TIME, &[0xff; 10]), Some(VALUE_NOT_ALLOWED));
    assert_eq!(refused(CURRENT_TIME, &[0; 9]), Some(VALUE_NOT_ALLOWED));
    // The first piece on one characteristic, the second on another.
    phone.write(&mut world, PARAMETERS, &[0x00, 4]).expect("a first piece");
    assert_eq!(phone.refused(&mut world, CONTROL, &[0x81, 0]), Some(OUT_OF_ORDER));
    // Longer than any message.
    phone.write(&mut world, PARAMETERS, &[0x00; 244]).expect("a first piece");
    assert_eq!(phone.refused(&mut world, PARAMETERS, &[0x01; 244]), Some(INVALID_LENGTH));
    let mut bad = tissue();
    bad.id ^= 1;
    assert_eq!(phone.answer(&mut world, ToDevice::SetTissue(bad)), ToHost::Refused(Refusal::TissueId));
    let mut gauges = tissue().gauges;
    gauges[5].n = 99.0;
    let refusal = ToHost::Refused(Refusal::Tissue(Region::Hallux));
    assert_eq!(phone.answer(&mut world, ToDevice::SetTissue(Tissue::new(gauges))), refusal);
    assert_eq!(phone.status(&mut world).bad_frames, 10);
    stream_steps(&mut world, &mut phone, 1);
}

/// Plays the walk to its end and waits for the steps.
fn stream_steps(world: &mut World, phone: &mut Phone, steps: usize) {
    world.play_all();
    for _ in 0..steps {
        assert!(matches!(phone.next(world), ToHost::Step(_)));
    }
}

#[test]
fn a_watch_sees_the_cadence_and_sets_the_clock() {
    let Some(mut world) = World::start(WALK(3)) else { return };
    let mut phone = world.bonded_phone(247);
    world.air.order(json!({"do": "subscribe", "phone": phone.name, "to": CADENCE}));
    let (_, steps) = replay(&world.recording, ContactRule::COUNTED, |_| false);
    world.play_all();
    let mut measured = Vec::new();
    while measured.len() < 3 {
        let (of, value) = phone.value(&mut world);
        if of == CADENCE {
            assert_eq!((value.len(), &value[..3]), (4, &[0, 0, 0][..]));
            measured.push(value[3]);
        }
    }
    let cadence = |i: usize| (120_000_000 / (steps[i].start_us - steps[i - 1].start_us)) as u8;
    assert_eq!(measured, [0, cadence(1), cadence(2)]);

    // Wednesday, 29 February 2040, 23:59:30.
    let written = [0xf8, 0x07, 2, 29, 23, 59, 30, 3, 0, 0];
    phone.write(&mut world, CURRENT_TIME, &written).expect("it is a time");
    let read = phone.read(&mut world, CURRENT_TIME);
    assert_eq!((&read[..6], read[7]), (&written[..6], 3));
    assert!(read[6] >= 30);
    // 2040-03-01 00:00:00.
    phone.send(&mut world, ToDevice::SetClock { unix_us: 2_214_172_800_000_000 });
    assert_eq!(phone.read(&mut world, CURRENT_TIME)[..6], [0xf8, 0x07, 3, 1, 0, 0]);
}

/// A request leaves before the insole stamps it, and the answer arrives after: that bounds the clock's offset from both
/// sides, however slow the link is. How closely is printed: the emulated port takes 0.1 ms a byte.
#[test]
fn the_time_comes_back_with_the_request() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let mut phone = world.bonded_phone(247);
    let begin = Instant::now();
    let host_us = || begin.elapsed().as_micros() as u64;
    let (mut least_width_us, mut before_us) = (u64::MAX, 0);
    for _ in 0..100 {
        let sent_us = host_us();
        let answer = phone.answer(&mut world, ToDevice::GetTime { host_us: sent_us });
        let ToHost::Time { host_us: echoed_us, device_us } = answer else { panic!("{answer:?}") };
        assert_eq!(echoed_us, sent_us);
        assert!(device_us > before_us, "the clock ran backwards");
        before_us = device_us;
        least_width_us = least_width_us.min(host_us() - sent_us);
    }
    println!("one answer bounds the offset to {} us at best", least_width_us / 2);
}

#[test]
fn both_insoles_are_there_at_once() {
    let Some(mut world) = World::start(WALK(1)) else { return };
    let firmware = firmware().expect("it was there");
    let right =
        synthetic::walk(&synthetic::SyntheticWalk { steps: 1, side: Side::Right, ..Default::default() }).recording;
    let port = world.air.order(json!({"do": "radio", "name": "other insole"}))["port"].as_u64().expect("a port");
    let worn = VirtualInsole::new(&right, ContactRule::COUNTED, StanceRule::WALKING);
    let head = Head { address: [2, 0, 0, 0, 0, 0xc0], ..Head::new(worn.setup) };
    let radio = Radio { hci: Some(([127, 0, 0, 1], port as u16).into()), bonds: None };
    let cells = worn.cells.clone();
    let _other = Board::start_with(&firmware, &head, &cells, Time::Max, Recorded::new(right, worn), &radio)
        .expect("the board boots");
    let mut left = world.bonded_phone(247);
    let phone = world.new_phone(2);
    let found = world.air.order(json!({"do": "scan", "phone": phone.name, "name": "Plantar R"}));
    world.air.order(json!({"do": "connect", "phone": phone.name, "address": found["address"]}));
    world.air.order(json!({"do": "discover", "phone": phone.name}));
    assert_eq!(phone.read(&mut world, "2a00"), b"Plantar R");
    stream_steps(&mut world, &mut left, 1);
}
