//! Tests `--ble` with a simulation of BlueZ, Linux's Bluetooth service, and of an insole that runs the code of the firmware's
//! session.
#![cfg(all(target_os = "linux", feature = "ble"))]

use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::session::Session;
use plantar::protocol::{MAX_MESSAGE, ToDevice, ToHost, decode};
use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use tempfile::TempDir;
use testkit::{hello, live, status, step};
use zbus::blocking::{Connection, connection};
use zbus::fdo;
use zbus::interface;
use zbus::zvariant::{ObjectPath, OwnedValue, Value};

const ADAPTER: &str = "/org/bluez/hci0";
const DEVICE: &str = "/org/bluez/hci0/dev_C0_00_00_00_00_01";
const SERVICE: &str = "/org/bluez/hci0/dev_C0_00_00_00_00_01/service0010";
/// The GATT characteristics of docs/bluetooth.md: the number in the UUID, and the properties.
const CHARACTERISTICS: [(u8, [&str; 2]); 4] =
    [(1, ["write", "indicate"]), (2, ["notify", "read"]), (3, ["notify", "read"]), (4, ["write", "indicate"])];
/// Length of the longest value that the smallest ATT MTU allows, bytes.
const FRAGMENT: usize = 20;
/// Number of live frames that the insole sends before its first step.
const FRAMES: u32 = 50;

/// The UUID of the service (0) or of a characteristic.
fn uuid(number: u8) -> String {
    format!("dca8c3{number:02x}-cb96-463f-8bec-f2094e1ccf7b")
}

/// The D-Bus path of a characteristic.
fn path(number: u8) -> String {
    format!("{SERVICE}/char{:04x}", 0x10 + number)
}

struct Adapter;

#[interface(name = "org.bluez.Adapter1")]
impl Adapter {
    fn set_discovery_filter(&self, _filter: HashMap<String, OwnedValue>) {}
    fn start_discovery(&self) {}
    fn stop_discovery(&self) {}
    #[zbus(property)]
    fn address(&self) -> &str {
        "C0:00:00:00:00:00"
    }
    #[zbus(property)]
    fn address_type(&self) -> &str {
        "public"
    }
    #[zbus(property)]
    fn name(&self) -> &str {
        "computer"
    }
    #[zbus(property)]
    fn alias(&self) -> &str {
        "computer"
    }
    #[zbus(property)]
    fn modalias(&self) -> &str {
        "usb:v1D6Bp0246d0542"
    }
    #[zbus(property)]
    fn powered(&self) -> bool {
        true
    }
    #[zbus(property)]
    fn set_powered(&self, _powered: bool) {}
    #[zbus(property)]
    fn discovering(&self) -> bool {
        true
    }
}

struct Device {
    connected: Arc<AtomicBool>,
}

#[interface(name = "org.bluez.Device1")]
impl Device {
    fn connect(&mut self) {
        self.connected.store(true, Ordering::SeqCst);
    }
    fn disconnect(&mut self) {
        self.connected.store(false, Ordering::SeqCst);
    }
    #[zbus(property)]
    fn adapter(&self) -> ObjectPath<'_> {
        ObjectPath::from_static_str_unchecked(ADAPTER)
    }
    #[zbus(property)]
    fn address(&self) -> &str {
        "C0:00:00:00:00:01"
    }
    #[zbus(property)]
    fn address_type(&self) -> &str {
        "random"
    }
    #[zbus(property)]
    fn name(&self) -> &str {
        "Plantar L"
    }
    #[zbus(property, name = "UUIDs")]
    fn uuids(&self) -> Vec<String> {
        vec![uuid(0)]
    }
    #[zbus(property)]
    fn connected(&self) -> bool {
        self.connected.load(Ordering::SeqCst)
    }
    #[zbus(property)]
    fn services_resolved(&self) -> bool {
        self.connected.load(Ordering::SeqCst)
    }
    #[zbus(property, name = "RSSI")]
    fn rssi(&self) -> i16 {
        -60
    }
    #[zbus(property)]
    fn paired(&self) -> bool {
        true
    }
    #[zbus(property)]
    fn trusted(&self) -> bool {
        false
    }
    #[zbus(property)]
    fn blocked(&self) -> bool {
        false
    }
    #[zbus(property)]
    fn legacy_pairing(&self) -> bool {
        false
    }
}

struct Service;

#[interface(name = "org.bluez.GattService1")]
impl Service {
    #[zbus(property, name = "UUID")]
    fn uuid(&self) -> String {
        uuid(0)
    }
    #[zbus(property)]
    fn primary(&self) -> bool {
        true
    }
    #[zbus(property)]
    fn device(&self) -> ObjectPath<'_> {
        ObjectPath::from_static_str_unchecked(DEVICE)
    }
}

struct Characteristic {
    number: u8,
    flags: [&'static str; 2],
    insole: Insole,
}

#[interface(name = "org.bluez.GattCharacteristic1")]
impl Characteristic {
    fn start_notify(&self) -> fdo::Result<()> {
        if self.insole.is_bonded { Ok(()) } else { Err(fdo::Error::AccessDenied("Insufficient Authentication".into())) }
    }
    fn stop_notify(&self) {}
    fn write_value(&mut self, value: Vec<u8>, _options: HashMap<String, OwnedValue>) {
        assert!(value.len() <= FRAGMENT);
        self.insole.write(self.number, &value);
    }
    #[zbus(property, name = "UUID")]
    fn uuid(&self) -> String {
        uuid(self.number)
    }
    #[zbus(property)]
    fn service(&self) -> ObjectPath<'_> {
        ObjectPath::from_static_str_unchecked(SERVICE)
    }
    #[zbus(property)]
    fn flags(&self) -> Vec<&str> {
        self.flags.to_vec()
    }
    #[zbus(property)]
    fn notifying(&self) -> bool {
        false
    }
}

/// The insole behind the radio.
#[derive(Clone)]
struct Insole {
    is_bonded: bool,
    connected: Arc<AtomicBool>,
    /// The link breaks at the next acknowledgement, before the insole receives it.
    breaks_link: Arc<AtomicBool>,
    session: Arc<Mutex<(Session, Joiner)>>,
    /// The numbers of characteristics with values for the host, in the order in which they are sent.
    values: Sender<(u8, Vec<u8>)>,
    /// The numbers of the steps that the host acknowledges.
    acknowledged: Sender<u32>,
}

impl Insole {
    /// Processes a fragment that the host writes to a characteristic.
    fn write(&self, number: u8, fragment: &[u8]) {
        let mut guard = self.session.lock().unwrap();
        let (session, joiner) = &mut *guard;
        let Some(message) = joiner.push(fragment).expect("in order") else { return };
        let message = decode::<ToDevice>(message).expect("a message");
        assert_eq!(number == 4, matches!(message, ToDevice::SetTissue(_) | ToDevice::GetTissue));
        if matches!(message, ToDevice::Acknowledge { .. }) && self.breaks_link.swap(false, Ordering::SeqCst) {
            self.connected.store(false, Ordering::SeqCst);
            session.push_step(step(8));
            return;
        }
        if let ToDevice::Acknowledge { step } = message {
            // Most tests do not follow the acknowledgements.
            let _ = self.acknowledged.send(step);
        }
        session.receive(message, 0);
        // This insole accepts and stores every setting.
        session.complete(Ok(plantar::protocol::session::CommandResult::Stored));
        if let ToDevice::Stream { live: true } = message {
            for number in 0..FRAMES {
                session.push_live(live(number));
                // Each frame is sent at once, because the session can queue only a few.
                self.send(session);
            }
            session.push_step(step(7));
        }
        self.send(session);
    }

    /// Sends the pending messages of the session in fragments.
    fn send(&self, session: &mut Session) {
        let mut buffer = [0; MAX_MESSAGE];
        while let Some(message) = session.next(&hello(), status, &mut buffer) {
            let number = match decode::<ToHost>(message).expect("a message of the session") {
                ToHost::Live(_) => 2,
                ToHost::Step(_) => 3,
                ToHost::Tissue(_) | ToHost::Refused(_) => 4,
                _ => 1,
            };
            let mut splitter = Splitter::new();
            splitter.buffer()[..message.len()].copy_from_slice(message);
            splitter.start(message.len());
            let mut fragment = [0; FRAGMENT];
            while let Some(len) = splitter.next(&mut fragment) {
                self.values.send((number, fragment[..len].to_vec())).expect("the host is connected");
            }
        }
    }
}

/// A private D-Bus with a Bluetooth service and an insole, which run until this is dropped.
struct Bus {
    daemon: Child,
    address: String,
    _service: Connection,
    insole: Insole,
    acknowledged: Receiver<u32>,
    /// The programs that use this bus place their lock files here.
    folder: TempDir,
}

impl Drop for Bus {
    fn drop(&mut self) {
        // This fails if the daemon has already exited.
        let _ = self.daemon.kill();
        let _ = self.daemon.wait();
    }
}

impl Bus {
    /// A bus with an insole in range.
    fn start(is_bonded: bool) -> Self {
        Self::start_with(is_bonded, true)
    }

    fn start_with(is_bonded: bool, is_found: bool) -> Self {
        let arguments = ["--session", "--nofork", "--print-address"];
        let daemon = Command::new("dbus-daemon").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut daemon = daemon.expect("dbus-daemon starts; `cargo xtask setup` installs it");
        let mut address = String::new();
        BufReader::new(daemon.stdout.take().expect("piped")).read_line(&mut address).expect("an address");
        let (values, to_host) = channel();
        let (acknowledged, acknowledgements) = channel();
        let insole = Insole {
            is_bonded,
            connected: Arc::default(),
            breaks_link: Arc::default(),
            session: Arc::new(Mutex::new((Session::new(), Joiner::new()))),
            values,
            acknowledged,
        };
        let service = serve(address.trim(), is_found.then_some(&insole));
        let signals = service.clone();
        std::thread::spawn(move || {
            for (number, value) in to_host {
                let changed = HashMap::from([("Value", Value::from(value))]);
                let body = ("org.bluez.GattCharacteristic1", changed, Vec::<&str>::new());
                let interface = "org.freedesktop.DBus.Properties";
                signals
                    .emit_signal(None::<&str>, path(number), interface, "PropertiesChanged", &body)
                    .expect("the bus");
            }
        });
        let folder = tempfile::tempdir().expect("a folder");
        let address = address.trim().into();
        Self { daemon, address, _service: service, insole, acknowledged: acknowledgements, folder }
    }

    /// The command line with this D-Bus instead of the system's.
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
        command.args(arguments).env("DBUS_SYSTEM_BUS_ADDRESS", &self.address).env("TMPDIR", self.folder.path());
        command
    }

    /// Runs the command line.
    fn plantar(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("the program runs")
    }
}

/// Offers the Bluetooth service on the D-Bus at this address, with an insole if one is in range.
fn serve(address: &str, insole: Option<&Insole>) -> Connection {
    let mut builder = connection::Builder::address(address)
        .and_then(|b| b.name("org.bluez"))
        .and_then(|b| b.serve_at("/", fdo::ObjectManager))
        .and_then(|b| b.serve_at(ADAPTER, Adapter))
        .expect("paths");
    if let Some(insole) = insole {
        builder = builder
            .serve_at(DEVICE, Device { connected: insole.connected.clone() })
            .and_then(|b| b.serve_at(SERVICE, Service))
            .expect("paths");
        for (number, flags) in CHARACTERISTICS {
            let characteristic = Characteristic { number, flags, insole: insole.clone() };
            builder = builder.serve_at(path(number), characteristic).expect("a path");
        }
    }
    builder.build().expect("the bus")
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("text")
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn monitor_receives_the_step_after_many_frames() {
    let bus = Bus::start(true);
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let output = bus.plantar(&["monitor", "--ble", "left", "--steps", "1", "--json", json.to_str().expect("text")]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let steps = std::fs::read_to_string(json).expect("written");
    let expected = client::step_to_json(&step(7));
    assert_eq!(serde_json::from_str::<Vec<serde_json::Value>>(&steps).expect("JSON"), [expected]);
    // The step was acknowledged, so the insole does not send it again in a new session.
    let session = &mut bus.insole.session.lock().expect("no panic").0;
    session.receive(ToDevice::Connect { major: plantar::protocol::MAJOR, minor: plantar::protocol::MINOR }, 0);
    let mut sent = Vec::new();
    let mut buffer = [0; MAX_MESSAGE];
    while let Some(message) = session.next(&hello(), status, &mut buffer) {
        sent.push(decode::<ToHost>(message).expect("a message of the session"));
    }
    assert!(matches!(sent[..], [ToHost::Hello(_)]), "{sent:?}");
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn monitor_reconnects_after_a_broken_link() {
    let bus = Bus::start(true);
    bus.insole.breaks_link.store(true, Ordering::SeqCst);
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let output = bus.plantar(&["monitor", "--ble", "left", "--steps", "2", "--json", json.to_str().expect("text")]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("trying again"), "{}", text(&output.stderr));
    let steps = std::fs::read_to_string(json).expect("written");
    let expected = [7, 8].map(|number| client::step_to_json(&step(number)));
    assert_eq!(serde_json::from_str::<Vec<serde_json::Value>>(&steps).expect("JSON"), expected);
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn parameters_are_sent_and_read_back_in_fragments() {
    let bus = Bus::start(true);
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let run = |arguments: &[&str]| {
        let output = bus.plantar(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    };
    let [typical, pulled] = [path("typical.toml"), path("pulled.toml")];
    let [typical, pulled] = [&typical, &pulled].map(|path| path.to_str().expect("text"));
    run(&["params", "typical", "--out", typical]);
    run(&["params", "push", typical, "--ble", "C0:00:00:00:00:01"]);
    run(&["params", "pull", "--out", pulled, "--ble", "left"]);
    let stored_id = || bus.insole.session.lock().expect("no panic").0.tissue().id;
    let pushed = stored_id();
    run(&["params", "push", pulled, "--ble", "left"]);
    assert_ne!(pushed, 0);
    assert_eq!(stored_id(), pushed);
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn an_insole_without_a_bond_is_reported_with_the_remedy() {
    let bus = Bus::start(false);
    let output = bus.plantar(&["monitor", "--ble", "left"]);
    assert!(!output.status.success());
    assert!(text(&output.stderr).contains("pair it in this computer's Bluetooth settings"), "{}", text(&output.stderr));
}

/// While an insole is connected to another phone or computer, it does not advertise.
#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn an_insole_that_does_not_advertise_may_be_connected_elsewhere() {
    let output = Bus::start_with(true, false).plantar(&["monitor", "--ble", "left"]);
    assert!(!output.status.success());
    let text = text(&output.stderr);
    assert!(text.contains("the left insole was not found") && text.contains("another phone or computer"), "{text}");
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn a_second_program_on_this_computer_is_refused_and_the_first_one_loses_nothing() {
    let bus = Bus::start(true);
    let json = bus.folder.path().join("steps.json");
    let arguments = ["monitor", "--ble", "left", "--steps", "2", "--json", json.to_str().expect("text")];
    let first = bus.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs");
    assert_eq!(bus.acknowledged.recv(), Ok(7));
    let second = bus.plantar(&["monitor", "--ble", "C0:00:00:00:00:01"]);
    assert!(!second.status.success());
    let refusal = text(&second.stderr);
    assert!(refusal.contains("C0:00:00:00:00:01 is in use") && refusal.contains("close that program"), "{refusal}");
    {
        let session = &mut bus.insole.session.lock().expect("no panic").0;
        session.push_step(step(8));
        bus.insole.send(session);
    }
    let output = first.wait_with_output().expect("it ends");
    assert!(output.status.success() && !text(&output.stderr).contains("trying again"), "{}", text(&output.stderr));
    let expected = [7, 8].map(|number| client::step_to_json(&step(number)));
    let steps = std::fs::read_to_string(json).expect("written");
    assert_eq!(serde_json::from_str::<Vec<serde_json::Value>>(&steps).expect("JSON"), expected);
}
