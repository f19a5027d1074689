//! `plantar serve --lsl`: pylsl receives every sample of both feet as the insoles sent it, with its time on the common clock.
//!
//! The insoles are simulated: the code of the firmware's session runs in the test, on a socket.
#![cfg(all(target_os = "linux", feature = "serve"))]

use client::unix_us;
use plantar::pipeline::bout::BoutKind;
use plantar::protocol::session::Session;
use plantar::protocol::{
    Alert, Bout, Decoder, Hello, Identity, Live, LiveRegion, LoadRecord, MAX_FRAME, MAX_MESSAGE, Serial, Status, Step,
    ToDevice, decode, frame,
};
use plantar::{Region, Side};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;
use study::table;

/// Timeout for events that take only milliseconds.
const TIMEOUT: Duration = Duration::from_secs(30);
/// Largest error of a time, s: a tenth of the time between two frames.
const TIME_ERROR_S: f64 = 1e-3;
/// Number of frames in each round of messages.
const FRAMES: usize = 40;
/// Number of rounds of messages that the receiver must not miss.
const ROUNDS: usize = 4;
/// The serial number of the right insole; the left one has none.
const SERIAL: &str = "P-0007";

/// An insole and its end of the link.
struct Insole {
    session: Session,
    side: Side,
    /// This computer's time when the insole's clock began, us since 1970.
    begin_us: u64,
    /// The link to the host; `None` before a host connects.
    host: Option<TcpStream>,
    /// Number of the last load record that the host acknowledged.
    acknowledged: u32,
    /// Number of the next load record.
    next_record: u32,
    /// All live frames that were sent.
    frames: Vec<Live>,
    /// All load records that were sent.
    records: Vec<LoadRecord>,
}

/// An insole that the test and the thread of its link share. The condition variable reports each change.
#[derive(Clone)]
struct Shared(Arc<(Mutex<Insole>, Condvar)>);

impl Shared {
    /// Starts an insole. Returns the address at which it waits for a host.
    fn start(side: Side, begin_us: u64) -> (Self, String) {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let mut session = Session::new();
        let serial = if side == Side::Right { Serial::new(SERIAL).expect("valid") } else { Serial::NONE };
        session.restore_identity(Identity { side, serial, calibration_id: 0 });
        let (frames, records) = (Vec::new(), Vec::new());
        let insole = Insole { session, side, begin_us, host: None, acknowledged: 0, next_record: 1, frames, records };
        let shared = Self(Arc::new((Mutex::new(insole), Condvar::new())));
        let serving = shared.clone();
        std::thread::spawn(move || serving.serve(listener.accept().expect("a host").0));
        (shared, address)
    }

    /// Calls `act` with the insole, sends the messages that are then pending, and reports the change.
    fn act<T>(&self, act: impl FnOnce(&mut Insole) -> T) -> T {
        let mut insole = self.0.0.lock().expect("no test panics here");
        let done = act(&mut insole);
        insole.send();
        self.0.1.notify_all();
        done
    }

    /// Serves a host until it disconnects.
    fn serve(&self, mut host: TcpStream) {
        self.act(|insole| insole.host = Some(host.try_clone().expect("a socket")));
        let (mut decoder, mut received) = (Decoder::new(), [0; 256]);
        while let Ok(count @ 1..) = host.read(&mut received) {
            for message in received[..count].iter().filter_map(|&byte| decoder.push(byte).and_then(decode)) {
                self.act(|insole| insole.receive(message));
            }
        }
    }

    /// Sends a round of messages, and waits until the host has acknowledged the records.
    fn round(&self) {
        let last = self.act(|insole| {
            (0..FRAMES).for_each(|_| insole.frame());
            insole.round_of_records();
            insole.next_record - 1
        });
        let insole = self.0.0.lock().expect("no test panics here");
        let is_pending = |insole: &mut Insole| insole.acknowledged < last;
        let waited = self.0.1.wait_timeout_while(insole, TIMEOUT, is_pending).expect("no test panics here");
        assert!(!waited.1.timed_out(), "the host did not acknowledge record {last}");
    }
}

impl Insole {
    fn receive(&mut self, message: ToDevice) {
        // The requests for the insole's time have no delay: each arrives at the moment at which it was sent.
        let device_us = match message {
            ToDevice::GetTime { host_us } => host_us - self.begin_us,
            _ => 0,
        };
        if let ToDevice::Acknowledge { number: step } = message {
            self.acknowledged = step;
        }
        self.session.receive(message, device_us);
    }

    /// Sends the pending messages of the session.
    fn send(&mut self) {
        let Some(host) = &mut self.host else { return };
        let hello = hello(self.side);
        let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
        while let Some(message) = self.session.next(&hello, Status::default, &mut buffer) {
            let len = frame(message, &mut framed);
            // This fails once the host has ended.
            let _ = host.write_all(&framed[..len]);
        }
    }

    /// Sends the next live frame. Each frame has other values, and every third one has no centre of pressure.
    fn frame(&mut self) {
        let Some(sequence) = self.session.next_live() else { return };
        let k = sequence as u16;
        let region = |i: u16| LiveRegion {
            area_mm2: 37 * k + i,
            deformation_um: 1000 + 11 * k + i,
            model_dn: 5 * k + 100 * i,
            measured_dn: 7 * k + 101 * i,
        };
        let on_ground = !k.is_multiple_of(3);
        let live = Live {
            sequence,
            t_us: unix_us_of(sequence) - self.begin_us,
            saturated: k as u8,
            clamped: !k as u8,
            masked: (k / 3) as u8,
            centre_x_dmm: if on_ground { 300 + k as i16 } else { 0 },
            centre_y_dmm: if on_ground { 1000 + k as i16 } else { 0 },
            regions: std::array::from_fn(|i| region(i as u16)),
        };
        self.frames.push(live);
        self.session.push_live(live);
        // Each frame is sent at once, because the session can queue only a few.
        self.send();
    }

    /// Sends a step, a load bout and an alert.
    fn round_of_records(&mut self) {
        let start_us = |number: u32| unix_us_of(100 * number) - self.begin_us;
        let (side, number) = (self.side, self.next_record);
        let kind = BoutKind::ALL[number as usize % BoutKind::ALL.len()];
        let mut step = Step { side, start_us: start_us(number), ..testkit::step(number) };
        step.regions[0].measured_peak_dn = 20 * number as u16 + 1;
        let bout = Bout { side, kind, start_us: start_us(number + 1), ..testkit::bout(number + 1) };
        let alert = Alert { side, start_us: start_us(number + 2), ..testkit::alert(number + 2) };
        for record in [LoadRecord::from(step), bout.into(), alert.into()] {
            // The records are from the current boot.
            let record = record.with_boots_since(0);
            self.records.push(record);
            self.session.push_record(record);
        }
        self.next_record += 3;
    }
}

impl Insole {
    /// The name of a stream of this insole.
    fn stream(&self, name: &str) -> String {
        format!("plantar_{}_{name}", self.side.name())
    }

    /// The first value of the last sample of each stream, except the stream of events: the number of the frame or load record.
    fn last_values(&self) -> [(String, Value); 4] {
        let frame = self.frames.last().expect("a frame").sequence;
        let number = self.next_record;
        let last = [("frames", frame), ("steps", number - 3), ("bouts", number - 2), ("alerts", number - 1)];
        last.map(|(name, number)| (self.stream(name), number.into()))
    }
}

fn hello(side: Side) -> Hello {
    Hello { side, tissue_id: 0, fault: None, ..testkit::hello() }
}

/// This computer's time at frame `sequence`, and at record number `sequence` / 100, us: the same for both feet.
fn unix_us_of(sequence: u32) -> u64 {
    static BEGIN_US: std::sync::LazyLock<u64> = std::sync::LazyLock::new(unix_us);
    *BEGIN_US + 10_000 * u64::from(sequence)
}

/// The receiver of the streams: a Python process that runs `lsl.py` with pylsl, which is independent of this project.
struct Reader {
    python: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Reader {
    /// Starts the process with this configuration file of LSL.
    fn start(configuration: &Path) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/lsl.py");
        let mut command = Command::new(python());
        let command = command.arg(script).env("LSLAPICFG", configuration);
        let mut python = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("Python starts");
        let input = python.stdin.take().expect("piped");
        let output = BufReader::new(python.stdout.take().expect("piped"));
        Self { python, input, output }
    }

    /// Sends a request of `lsl.py`, and returns its answer.
    fn request(&mut self, request: Value) -> Value {
        writeln!(self.input, "{request}").expect("Python runs");
        let mut line = String::new();
        self.output.read_line(&mut line).expect("Python runs");
        serde_json::from_str(&line).expect("Python answers with JSON")
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        let _ = self.python.kill();
        let _ = self.python.wait();
    }
}

fn python() -> PathBuf {
    std::env::var_os("PLANTAR_FORMATS").expect("PLANTAR_FORMATS names a Python with pylsl").into()
}

/// The file of liblsl in the package pylsl.
fn liblsl() -> String {
    let print = "import importlib.util, os; print(os.path.dirname(importlib.util.find_spec('pylsl').origin))";
    let output = Command::new(python()).args(["-c", print]).output().expect("Python starts");
    format!("{}/lib/liblsl.so", String::from_utf8(output.stdout).expect("a path").trim())
}

/// `plantar serve` with a page in this folder and these insoles.
fn serve(folder: &Path, insoles: &[&str]) -> Command {
    std::fs::write(folder.join("index.html"), "the page").expect("a page");
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    command.args(["serve", "--port", "0", "--page"]).arg(folder).arg("--record").arg(folder.join("session.plantar"));
    for address in insoles {
        command.args(["--tcp", address]);
    }
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A received sample: its time on LSL's clock, s, and the value of each channel by its label.
type Sample<'a> = (f64, Vec<(String, &'a Value)>);

/// The samples of a stream, each with its time and its values by label.
fn samples<'a>(answer: &'a Value, streams: &Value, name: &str) -> Vec<Sample<'a>> {
    let label = |channel: &Value| channel["label"].as_str().expect("a label").to_owned();
    let labels: Vec<_> = streams[name]["channels"].as_array().expect("channels").iter().map(label).collect();
    let of_sample = |sample: &'a Value| {
        let values = sample[1].as_array().expect("values");
        assert_eq!(values.len(), labels.len());
        (sample[0].as_f64().expect("a time"), labels.iter().cloned().zip(values).collect())
    };
    answer["samples"][name].as_array().expect("samples").iter().map(of_sample).collect()
}

/// Asserts that both have the same labels and values.
fn assert_same(found: &[(String, &Value)], expected: &[(String, Option<f64>)]) {
    assert_eq!(found.len(), expected.len());
    for (label, expected) in expected {
        let value = found.iter().find(|(found, _)| found == label).unwrap_or_else(|| panic!("no channel {label}")).1;
        assert_eq!(value.as_f64(), *expected, "{label}");
    }
}

/// The channels of a frame, from the integers of the message.
fn frame_values(live: &Live) -> Vec<(String, Option<f64>)> {
    let on_ground = live.centre_y_dmm != 0;
    let mut values = vec![
        ("sequence".into(), Some(f64::from(live.sequence))),
        ("t_s".into(), Some(live.t_us as f64 / 1e6)),
        ("centre_x_mm".into(), on_ground.then_some(f64::from(live.centre_x_dmm) / 10.0)),
        ("centre_y_mm".into(), on_ground.then_some(f64::from(live.centre_y_dmm) / 10.0)),
    ];
    for (i, (region, of)) in Region::ALL.iter().zip(&live.regions).enumerate() {
        let mut push = |name: &str, value: f64| values.push((format!("{}_{name}", region.name()), Some(value)));
        push("area_mm2", f64::from(of.area_mm2));
        push("deformation_mm", f64::from(of.deformation_um) / 1000.0);
        push("model_force_n", f64::from(of.model_dn) / 10.0);
        push("measured_force_n", f64::from(of.measured_dn) / 10.0);
        push("saturated", f64::from(live.saturated >> i & 1));
        push("clamped", f64::from(live.clamped >> i & 1));
        push("masked", f64::from(live.masked >> i & 1));
    }
    values
}

/// The channels of a step, from the table of `plantar record`: its columns without the side, the region and the contact rule,
/// which are no channels.
fn step_values(step: &Step) -> Vec<(String, Option<f64>)> {
    let number = |value: &table::Value| match value {
        table::Value::Integer(value) => value.map(f64::from),
        table::Value::Real(value) => *value,
        table::Value::Flag(value) => value.map(|is_set| f64::from(u8::from(is_set))),
        table::Value::Text(text) => panic!("{text:?}"),
    };
    let rows = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| study::records::step_row(step, i));
    let no_channels = ["side", "region", "contact_on_kpa", "contact_off_kpa", "contact_full_kpa"];
    let mut values = Vec::new();
    for (name, value) in rows[0].iter().filter(|(name, _)| !no_channels.contains(name)) {
        let of_foot = Step::QUANTITIES.iter().map(|quantity| quantity.name);
        let mut of_foot = of_foot.chain(plantar::protocol::StepFoot::QUANTITIES.iter().map(|quantity| quantity.name));
        if of_foot.any(|of_foot| of_foot == *name) {
            values.push(((*name).into(), number(value)));
            continue;
        }
        for (region, row) in Region::ALL.iter().zip(&rows) {
            let value = &row.iter().find(|(column, _)| column == name).expect("the same columns").1;
            values.push((format!("{}_{name}", region.name()), number(value)));
        }
    }
    values
}

/// The channels of a load bout, from the integers of the message.
fn bout_values(bout: &Bout) -> Vec<(String, Option<f64>)> {
    let mut values = vec![
        ("number".into(), Some(f64::from(bout.number))),
        ("start_s".into(), Some(bout.start_us as f64 / 1e6)),
        ("duration_s".into(), Some(f64::from(bout.duration_us) / 1e6)),
        ("boots_since".into(), Some(0.0)),
    ];
    let kinds = BoutKind::ALL.map(|kind| (kind.name().into(), Some(f64::from(u8::from(kind == bout.kind)))));
    values.extend(kinds);
    for (region, of) in Region::ALL.iter().zip(&bout.regions) {
        let mut push = |name: &str, value: f64| values.push((format!("{}_{name}", region.name()), Some(value)));
        push("measured_force_integral_n_s", f64::from(of.measured_integral_cns) / 100.0);
        push("pressure_integral_kpa_s", f64::from(of.pressure_integral_dkpas) / 10.0);
        push("peak_pressure_kpa", f64::from(of.peak_pressure_dkpa) / 10.0);
    }
    values
}

/// The channels of an alert, from the integers of the message.
fn alert_values(alert: &Alert) -> Vec<(String, Option<f64>)> {
    let mut values = vec![
        ("number".into(), Some(f64::from(alert.number))),
        ("start_s".into(), Some(alert.start_us as f64 / 1e6)),
        ("window_s".into(), Some(f64::from(alert.window_s))),
        ("today".into(), Some(f64::from(alert.today))),
        ("boots_since".into(), Some(0.0)),
    ];
    for (i, region) in Region::ALL.iter().enumerate() {
        let mut push =
            |name: &str, bits: u8| values.push((format!("{}_{name}", region.name()), Some(f64::from(bits >> i & 1))));
        push("sustained", alert.sustained);
        push("dose", alert.dose);
    }
    values
}

#[test]
#[ignore = "needs pylsl: cargo xtask test"]
fn pylsl_receives_every_sample_of_both_feet_on_one_clock() {
    let folder = tempfile::tempdir().expect("a folder");
    // The streams are found without multicast, which many networks lack, and are separate from other streams on this computer.
    let configuration = folder.path().join("lsl_api.cfg");
    let session = format!("plantar-{}", std::process::id());
    let text = format!(
        "[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {{127.0.0.1}}\nSessionID = {session}\n[ports]\nPortRange = 200\n"
    );
    std::fs::write(&configuration, text).expect("a file");

    let begin_us = unix_us_of(0);
    // The clocks of the insoles began a quarter of an hour apart.
    let (left, left_address) = Shared::start(Side::Left, begin_us - 1_000_000_000);
    let (right, right_address) = Shared::start(Side::Right, begin_us - 1_900_000_000);
    let mut command = serve(folder.path(), &[&left_address, &right_address]);
    let mut program =
        command.arg(format!("--lsl={}", liblsl())).env("LSLAPICFG", &configuration).spawn().expect("it runs");
    let mut line = String::new();
    BufReader::new(program.stdout.take().expect("piped")).read_line(&mut line).expect("a line");
    assert!(line.contains("The page is at"), "{line}");

    let mut reader = Reader::start(&configuration);
    let streams = reader.request(json!({"streams": 10}));
    assert_eq!(streams.as_object().map(|by_name| by_name.len()), Some(10), "{streams}");
    assert_description(&streams);

    // A stream that a receiver has just opened can lose its first samples.
    let warm_up = (0..20).find(|_| {
        [&left, &right].iter().for_each(|insole| insole.round());
        reader.request(json!({"first": 1.0})) == 0
    });
    assert!(warm_up.is_some(), "a stream has no samples");
    for _ in 0..ROUNDS {
        [&left, &right].iter().for_each(|insole| insole.round());
    }
    let last: serde_json::Map<_, _> =
        [&left, &right].iter().flat_map(|insole| insole.act(|insole| insole.last_values())).collect();
    let answer = reader.request(json!({"last": last}));
    drop(reader);
    // The program ends without an error, although it has published streams.
    terminate(&program);
    let output = program.wait_with_output().expect("it ends");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let [lsl_s, unix_s] = [0, 1].map(|i| answer["clock_s"][i].as_f64().expect("a time"));
    let time = |unix_us: u64| unix_us as f64 / 1e6 - unix_s + lsl_s;
    for insole in [left, right] {
        insole.act(|insole| assert_received(insole, &answer, &streams, &time));
    }
}

/// Asserts that the samples are those of the last messages of `sent`, at least `least` of them, with these values and these
/// times on LSL's clock, s.
fn assert_samples<T>(
    found: &[Sample],
    sent: &[T],
    least: usize,
    values: impl Fn(&T) -> Vec<(String, Option<f64>)>,
    time_s: impl Fn(&T) -> f64,
) {
    for ((t_s, found), sent) in tail(found, sent, least) {
        assert_same(found, &values(sent));
        assert_time(*t_s, time_s(sent));
    }
}

fn assert_time(found_s: f64, expected_s: f64) {
    assert!((found_s - expected_s).abs() < TIME_ERROR_S, "{found_s} s for {expected_s} s");
}

/// Asserts that the samples of each stream are the last messages that the insole sent, at least those of the last [`ROUNDS`]
/// rounds, with the right values and times. `time` converts this computer's time, us since 1970, to LSL's clock, s.
fn assert_received(insole: &Insole, answer: &Value, streams: &Value, time: &impl Fn(u64) -> f64) {
    let time_s = |device_us: u64| time(device_us + insole.begin_us);
    let samples = |name: &str| samples(answer, streams, &insole.stream(name));
    assert_samples(&samples("frames"), &insole.frames, FRAMES * ROUNDS, frame_values, |live| time_s(live.t_us));
    let records = &insole.records;
    let steps: Vec<_> = records.iter().filter_map(|record| record.step()).collect();
    assert_samples(&samples("steps"), &steps, ROUNDS, |step| step_values(step), |step| time_s(step.start_us));
    let bouts: Vec<_> = records.iter().filter_map(|record| record.bout()).collect();
    assert_samples(&samples("bouts"), &bouts, ROUNDS, |bout| bout_values(bout), |bout| time_s(bout.start_us));
    let alerts: Vec<_> = records.iter().filter_map(|record| record.alert()).collect();
    assert_samples(&samples("alerts"), &alerts, ROUNDS, |alert| alert_values(alert), |alert| time_s(alert.start_us));
    let events_of =
        |step: &&Step| [("heel_strike", step.start_us), ("toe_off", step.start_us + u64::from(step.duration_us))];
    let events: Vec<_> = steps.iter().flat_map(events_of).collect();
    for ((t_s, values), (name, device_us)) in tail(&samples("events"), &events, 2 * ROUNDS) {
        assert_eq!(values[..], [("event".into(), &json!(name))]);
        assert_time(*t_s, time_s(*device_us));
    }
}

/// Pairs each received sample with the message that it is from: they are the last messages of `sent`, at least `least` of them.
fn tail<'a, R, S>(received: &'a [R], sent: &'a [S], least: usize) -> impl Iterator<Item = (&'a R, &'a S)> {
    assert!((least..=sent.len()).contains(&received.len()), "{} of {}", received.len(), sent.len());
    received.iter().zip(&sent[sent.len() - received.len()..])
}

/// Asserts the descriptions of the streams and of their channels.
fn assert_description(streams: &Value) {
    for side in ["left", "right"] {
        let stream = |name: &str| &streams[format!("plantar_{side}_{name}")];
        let channel = |name: &str, label: &str| {
            let channels = stream(name)["channels"].as_array().expect("channels");
            let found = channels.iter().find(|channel| channel["label"] == label);
            found.unwrap_or_else(|| panic!("{name} has no channel {label}"))
        };
        for (name, count) in [("frames", 60), ("alerts", 5 + 16), ("bouts", 8 + 24), ("events", 1)] {
            assert_eq!(stream(name)["count"], count);
        }
        for name in ["frames", "steps", "bouts", "alerts", "events"] {
            let stream = stream(name);
            assert_eq!(stream["channels"].as_array().map(Vec::len), stream["count"].as_u64().map(|n| n as usize));
            assert_eq!(stream["type"], if name == "events" { "Markers" } else { "Insole" });
            assert_eq!(stream["is_text"], name == "events");
            assert_eq!(stream["rate_hz"], 0.0);
            let properties = &stream["properties"];
            assert_eq!(properties["side"], side);
            assert_eq!(properties["frame_rate_hz"], "100");
            assert_eq!(properties["cells"], "200");
            // The source id of an insole with a serial number lets receivers find its streams again after an interruption.
            let source_id = stream["source_id"].as_str().expect("a text");
            assert_eq!(source_id.contains(SERIAL), side == "right", "{source_id}");
        }
        let force = channel("frames", "heel_measured_force_n");
        assert_eq!((&force["unit"], &force["region"]), (&json!("N"), &json!("heel")));
        assert_eq!(force["type"], "measured_force_n");
        assert_eq!(channel("frames", "toe_2_area_mm2")["unit"], "mm2");
        assert_eq!(channel("frames", "centre_x_mm")["unit"], "mm");
        assert_eq!(channel("frames", "hallux_masked")["unit"], "boolean");
        assert_eq!(channel("steps", "heel_measured_force_peak_n")["unit"], "N");
        assert_eq!(channel("steps", "foot_force_integral_n_s")["unit"], "N s");
        assert_eq!(channel("bouts", "heel_pressure_integral_kpa_s")["unit"], "kPa s");
    }
}

/// Sends SIGTERM to a program, with which the system asks a program to end.
fn terminate(program: &Child) {
    let killed = Command::new("kill").args(["-s", "TERM", &program.id().to_string()]).status().expect("kill");
    assert!(killed.success());
}

#[test]
fn a_missing_library_is_an_error_with_a_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let missing = folder.path().join("liblsl.so");
    let mut command = serve(folder.path(), &["127.0.0.1:1"]);
    let output = command.arg(format!("--lsl={}", missing.display())).output().expect("it runs");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    for part in [&*format!("cannot load {}", missing.display()), "No such file", "conda install", "--lsl=LIBRARY"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

/// Without a recording, nobody stores the records, so an insole would send no further ones.
#[test]
fn streams_need_a_recording() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    let output = command.args(["serve", "--tcp", "127.0.0.1:1", "--lsl"]).output().expect("it runs");
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("--record"));
}
