//! Tests `--ble` with a simulation of BlueZ and of an insole that runs the code of the firmware's session.
#![cfg(all(target_os = "linux", feature = "ble"))]

use crate::bluez::{ATT_HEADER, Bus, Peripheral};
use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::session::Session;
use plantar::protocol::{MAX_MESSAGE, ToDevice, ToHost, decode};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use testkit::{hello, live, status, step};

/// Number of live frames that the insole sends when its live stream is turned on, the first time before its step.
const FRAMES: u32 = 50;
/// The error of an insole for a central without a bond.
const NO_BOND: &str = "Insufficient Authentication";
/// Longest time until the first program acknowledges a step.
const TIMEOUT: Duration = Duration::from_secs(60);

/// The simulated insole. All clones share its state.
#[derive(Clone)]
struct Insole {
    is_bonded: bool,
    /// The ATT MTU of the connection, bytes.
    mtu: u16,
    /// Length of the longest value that the host has written, bytes.
    longest_written: Arc<AtomicUsize>,
    connected: Arc<AtomicBool>,
    /// If true, the link breaks at the next acknowledgement, before the insole receives it.
    breaks_link: Arc<AtomicBool>,
    /// True once the insole has completed its step.
    has_stepped: Arc<AtomicBool>,
    session: Arc<Mutex<(Session, Joiner)>>,
    /// The values for the host in the order in which they are sent, each with the number of its characteristic.
    values: Sender<(u8, Vec<u8>)>,
    /// The numbers of the steps that the host acknowledges.
    acknowledged: Sender<u32>,
}

impl Peripheral for Insole {
    fn name(&self) -> &str {
        "Plantar L"
    }

    fn connect(&self) -> Result<(), String> {
        self.connected.store(true, Ordering::SeqCst);
        Ok(())
    }

    fn disconnect(&self) {
        self.connected.store(false, Ordering::SeqCst);
    }

    fn is_connected(&self) -> bool {
        self.connected.load(Ordering::SeqCst)
    }

    fn mtu(&self) -> u16 {
        self.mtu
    }

    fn subscribe(&self, _: u8) -> Result<(), String> {
        if self.is_bonded { Ok(()) } else { Err(NO_BOND.into()) }
    }

    /// Processes a fragment that the host writes to a characteristic.
    fn write(&self, number: u8, fragment: &[u8]) -> Result<(), String> {
        self.longest_written.fetch_max(fragment.len(), Ordering::SeqCst);
        let mut guard = self.session.lock().unwrap();
        let (session, joiner) = &mut *guard;
        let Some(message) = joiner.push(fragment).expect("in order") else { return Ok(()) };
        let message = decode::<ToDevice>(message).expect("a message");
        // The characteristic of each request: see docs/bluetooth.md.
        assert_eq!(
            number == 4,
            matches!(message, ToDevice::SetTissue(_) | ToDevice::SetIdentifiedTissue { .. } | ToDevice::GetTissue)
        );
        if matches!(message, ToDevice::Acknowledge { .. }) && self.breaks_link.swap(false, Ordering::SeqCst) {
            self.connected.store(false, Ordering::SeqCst);
            session.push_record(step(8));
            return Ok(());
        }
        if let ToDevice::Acknowledge { number: step } = message {
            // This fails only after the end of the test, which drops the receiver.
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
            if !self.has_stepped.swap(true, Ordering::SeqCst) {
                session.push_record(step(7));
            }
        }
        self.send(session);
        Ok(())
    }
}

impl Insole {
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
            let mut fragment = vec![0; usize::from(self.mtu) - ATT_HEADER];
            while let Some(len) = splitter.next(&mut fragment) {
                self.values.send((number, fragment[..len].to_vec())).expect("the host is connected");
            }
        }
    }
}

/// The simulated Bluetooth service of this computer, and an insole in range.
struct Simulated {
    bus: Bus,
    insole: Insole,
    acknowledged: Receiver<u32>,
}

impl Simulated {
    /// Starts both, with the ATT MTU of an insole.
    fn start(is_bonded: bool) -> Self {
        Self::start_with_mtu(is_bonded, 247)
    }

    fn start_with_mtu(is_bonded: bool, mtu: u16) -> Self {
        let (values, to_host) = channel();
        let (acknowledged, acknowledgements) = channel();
        let insole = Insole {
            is_bonded,
            mtu,
            longest_written: Arc::default(),
            connected: Arc::default(),
            breaks_link: Arc::default(),
            has_stepped: Arc::default(),
            session: Arc::new(Mutex::new((Session::new(), Joiner::new()))),
            values,
            acknowledged,
        };
        let bus = Bus::start(Some(Arc::new(insole.clone())), to_host);
        Self { bus, insole, acknowledged: acknowledgements }
    }

    /// Runs the command line.
    fn plantar(&self, arguments: &[&str]) -> Output {
        command(&self.bus, arguments).output().expect("the program runs")
    }
}

/// The command line with this D-Bus instead of the system's.
fn command(bus: &Bus, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    command.args(arguments).envs(bus.environment());
    command
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("text")
}

/// The objects of a JSON array, with null instead of the time of day, `start_unix_s`, which each of them must have.
fn without_time_of_day(json: &str) -> Vec<serde_json::Value> {
    let mut objects: Vec<serde_json::Value> = serde_json::from_str(json).expect("JSON");
    for object in &mut objects {
        assert!(object["start_unix_s"].take().is_f64(), "{object}");
    }
    objects
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn monitor_receives_the_step_after_many_frames() {
    let simulated = Simulated::start(true);
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let output =
        simulated.plantar(&["monitor", "--ble", "left", "--steps", "1", "--json", json.to_str().expect("text")]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let steps = std::fs::read_to_string(json).expect("written");
    let expected = client::step_to_json(&step(7));
    assert_eq!(without_time_of_day(&steps), [expected]);
    // The step was acknowledged, so the insole does not send it again in a new session.
    let session = &mut simulated.insole.session.lock().expect("no panic").0;
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
    let simulated = Simulated::start(true);
    simulated.insole.breaks_link.store(true, Ordering::SeqCst);
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let output =
        simulated.plantar(&["monitor", "--ble", "left", "--steps", "2", "--json", json.to_str().expect("text")]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("trying again"), "{}", text(&output.stderr));
    let steps = std::fs::read_to_string(json).expect("written");
    let expected = [7, 8].map(|number| client::step_to_json(&step(number)));
    assert_eq!(without_time_of_day(&steps), expected);
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn parameters_are_sent_and_read_back_in_fragments_that_fill_the_mtu() {
    for (mtu, longest) in [(23, 20), (100, 97)] {
        let simulated = Simulated::start_with_mtu(true, mtu);
        send_and_read_parameters(&simulated);
        assert_eq!(simulated.insole.longest_written.load(Ordering::SeqCst), longest);
    }
}

/// Sends parameters to the insole, reads them back, and sends what was read.
fn send_and_read_parameters(simulated: &Simulated) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let run = |arguments: &[&str]| {
        let output = simulated.plantar(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    };
    let [typical, pulled] = [path("typical.toml"), path("pulled.toml")];
    let [typical, pulled] = [&typical, &pulled].map(|path| path.to_str().expect("text"));
    run(&["params", "typical", "--out", typical]);
    run(&["params", "push", typical, "--ble", "C0:00:00:00:00:01"]);
    run(&["params", "pull", "--out", pulled, "--ble", "left"]);
    let stored_id = || simulated.insole.session.lock().expect("no panic").0.tissue().id;
    let pushed = stored_id();
    run(&["params", "push", pulled, "--ble", "left"]);
    assert_ne!(pushed, 0);
    assert_eq!(stored_id(), pushed);
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn an_insole_without_a_bond_is_reported_with_the_remedy() {
    let simulated = Simulated::start(false);
    let output = simulated.plantar(&["monitor", "--ble", "left"]);
    assert!(!output.status.success());
    let text = text(&output.stderr);
    assert!(text.contains("pair it in this computer's Bluetooth settings"), "{text}");
    assert!(text.contains(NO_BOND), "{text}");
}

/// An insole does not advertise while it is connected to another phone or computer.
#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn the_error_for_an_insole_that_does_not_advertise_names_another_phone_or_computer() {
    let output = command(&Bus::start(None, channel().1), &["monitor", "--ble", "left"]).output().expect("it runs");
    assert!(!output.status.success());
    let text = text(&output.stderr);
    assert!(text.contains("the left insole was not found") && text.contains("another phone or computer"), "{text}");
}

#[test]
#[ignore = "needs a D-Bus daemon: cargo xtask test"]
fn a_second_program_on_this_computer_is_refused_and_the_first_one_loses_nothing() {
    let simulated = Simulated::start(true);
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let arguments = ["monitor", "--ble", "left", "--steps", "2", "--json", json.to_str().expect("text")];
    let mut first =
        command(&simulated.bus, &arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs");
    let acknowledged = simulated.acknowledged.recv_timeout(TIMEOUT);
    if acknowledged != Ok(7) {
        // This fails if the program has already ended.
        let _ = first.kill();
        let output = first.wait_with_output().expect("it ends");
        panic!("{acknowledged:?} instead of step 7: {}", text(&output.stderr));
    }
    let second = simulated.plantar(&["monitor", "--ble", "C0:00:00:00:00:01"]);
    assert!(!second.status.success());
    let refusal = text(&second.stderr);
    assert!(
        refusal.contains("C0:00:00:00:00:01 is in use") && refusal.contains("close the other program"),
        "{refusal}"
    );
    {
        let session = &mut simulated.insole.session.lock().expect("no panic").0;
        session.push_record(step(8));
        simulated.insole.send(session);
    }
    let output = first.wait_with_output().expect("it ends");
    assert!(output.status.success() && !text(&output.stderr).contains("trying again"), "{}", text(&output.stderr));
    let expected = [7, 8].map(|number| client::step_to_json(&step(number)));
    let steps = std::fs::read_to_string(json).expect("written");
    assert_eq!(without_time_of_day(&steps), expected);
}
