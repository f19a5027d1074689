//! Tests how the command line handles a lost link, a missing or busy port, a full disk, and signals.
//!
//! The insole is simulated: the code of the firmware's session runs in the test, on a socket or a pseudo-terminal.

use crate::fit;
use parameters::{InsoleSize, Parameters};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use plantar::Side;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::pipeline::tissue::{AreaFilter, Identified};
use plantar::protocol::session::{RECORD_QUEUE, Session};
use plantar::protocol::{Decoder, Hello, Live, MAX_FRAME, MAX_MESSAGE, Reset, Status, Step, ToDevice, decode, frame};
#[cfg(unix)]
use portable_pty::{CommandBuilder, PtySize, native_pty_system};
use recording::VirtualInsole;
use recording::synthetic::{self, SyntheticWalk};
use std::cell::Cell;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;
use testkit::step;

/// Number of cells of the insole.
const CELLS: usize = 240;

/// A simulated insole at the other end of the link.
struct Insole {
    session: Session,
    side: Side,
    /// If true, the insole ignores all messages.
    is_silent: bool,
    /// Number of the next scan.
    scan: u32,
}

impl Insole {
    /// An insole with unacknowledged steps of these numbers.
    fn with_steps(steps: impl IntoIterator<Item = u32>) -> Self {
        let mut session = Session::new();
        steps.into_iter().for_each(|number| session.push_record(step(number)));
        Self { session, side: Side::Left, is_silent: false, scan: 0 }
    }

    /// Makes the insole able to send its cells: while their stream is on, one scan after each read of the carrier.
    fn with_cells(mut self) -> Self {
        let walk = SyntheticWalk { side: Side::Left, cells: CELLS, steps: 1, ..Default::default() };
        let walk = synthetic::walk(&walk);
        let insole = VirtualInsole::new(&walk.recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
        self.session.set_layout(insole.setup, insole.cells.leak(), None);
        self
    }

    /// Serves the host until a message arrives for which `is_last` is true. Returns true without processing this message, or
    /// false if the host disconnected before.
    fn serve(&mut self, mut carrier: impl Read + Write, is_last: impl Fn(&ToDevice) -> bool) -> bool {
        let mut decoder = Decoder::new();
        let mut received = [0; 256];
        loop {
            let count = match carrier.read(&mut received) {
                Ok(0) => return false,
                Ok(count) => count,
                Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => continue,
                Err(_) => return false,
            };
            for &byte in &received[..count] {
                let Some(message) = decoder.push(byte).and_then(decode::<ToDevice>) else { continue };
                if is_last(&message) {
                    return true;
                }
                if !self.is_silent {
                    self.session.receive(message, 0);
                }
            }
            if self.session.streams_cells() {
                self.session.push_cells(self.scan, &[1000; CELLS]);
                self.scan += 1;
            }
            if !self.send_due(&mut carrier) {
                return false;
            }
        }
    }

    /// Sends the messages that are due. Returns false if the host has disconnected.
    fn send_due(&mut self, carrier: &mut impl Write) -> bool {
        let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
        // The insole uses the settings of its firmware.
        let layout_id = self.session.setup().map_or(0, |setup| setup.layout_id);
        let hello = Hello { side: self.side, layout_id, ..hello() };
        while let Some(message) = self.session.next(&hello, Status::default, &mut buffer) {
            let len = frame(message, &mut framed);
            if carrier.write_all(&framed[..len]).is_err() {
                return false;
            }
        }
        true
    }
}

fn hello() -> Hello {
    Hello { side: Side::Left, tissue_id: 0, reset: Reset::Power, fault: None, ..testkit::hello() }
}

fn is_acknowledgement(message: &ToDevice) -> bool {
    matches!(message, ToDevice::Acknowledge { .. })
}

fn plantar(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn listen() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    (listener, address)
}

/// Waits for the end of a program. Returns its output, and the text that it printed on stderr.
fn wait_for_end(program: Child) -> (Output, String) {
    let output = program.wait_with_output().expect("the program ends");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, text)
}

/// The number of rows of a Parquet file.
fn rows(file: &Path) -> i64 {
    let file = SerializedFileReader::new(File::open(file).expect("a file")).expect("a complete file");
    file.metadata().file_metadata().num_rows()
}

/// The values of a column of integers in a Parquet file.
fn integers(file: &Path, column: &str) -> Vec<i32> {
    let file = SerializedFileReader::new(File::open(file).expect("a file")).expect("a complete file");
    let rows = file.get_row_iter(None).expect("rows").map(|row| row.expect("a row").into_columns());
    let values = rows.map(|row| match row.into_iter().find(|(name, _)| name == column) {
        Some((_, Field::Int(value))) => value,
        other => panic!("not an integer: {other:?}"),
    });
    values.collect()
}

#[test]
fn monitor_names_the_regions_with_typical_parameters() {
    let mut identified = Identified {
        contact: ContactRule::COUNTED,
        filter: AreaFilter::Direct,
        side: None,
        steps: 20,
        regions: u8::MAX,
    };
    let mut notes = |regions| {
        identified.regions = regions;
        let (listener, address) = listen();
        let program = plantar(&["monitor", "--tcp", &address, "--steps", "1", "--discard"]).spawn().expect("it runs");
        let mut insole = Insole::with_steps([0]);
        let tissue = Parameters::typical(InsoleSize::default()).tissue();
        insole.session.restore_tissue(tissue, (regions > 0).then_some(identified));
        insole.serve(listener.accept().expect("it connects").0, |_| false);
        wait_for_end(program).1
    };
    assert!(notes(0).contains("not known to be the wearer's (all regions)"));
    assert!(notes(0b1110_1110).contains("not known to be the wearer's (heel, metatarsals_35)"));
    assert_eq!(notes(u8::MAX), "");
}

/// The insole deletes an acknowledged record, and all records before it.
#[test]
fn monitor_acknowledges_nothing_from_the_first_record_on_that_no_file_stores() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let cases = [
        (vec![], None, Some("this step")),
        (vec!["--json", json.to_str().expect("text")], Some(0), Some("this load bout")),
        (vec!["--discard"], Some(2), None),
    ];
    for (arguments, expected, noted) in cases {
        let (listener, address) = listen();
        let mut program = plantar(&["monitor", "--tcp", &address]).args(&arguments).spawn().expect("it runs");
        let mut insole = Insole::with_steps([0]);
        insole.session.push_record(testkit::bout(1));
        insole.session.push_record(step(2));
        let newest = Cell::new(None);
        let is_last = after_time_requests(3);
        assert!(insole.serve(listener.accept().expect("it connects").0, |message| {
            if let ToDevice::Acknowledge { number } = message {
                newest.set(Some(*number));
            }
            is_last(message)
        }));
        assert_eq!(newest.get(), expected, "{arguments:?}");
        program.kill().expect("it is still running");
        let (_, text) = wait_for_end(program);
        assert_eq!(text.matches("the insole retains").count(), usize::from(noted.is_some()), "{text}");
        assert!(text.contains(noted.unwrap_or_default()), "{text}");
    }
}

#[test]
fn monitor_reports_that_a_limit_of_steps_without_a_file_cannot_be_reached() {
    let (listener, address) = listen();
    let program = plantar(&["monitor", "--tcp", &address, "--steps", "7"]).spawn().expect("it runs");
    assert!(!Insole::with_steps(0..6).serve(listener.accept().expect("it connects").0, is_acknowledgement));
    let (output, text) = wait_for_end(program);
    assert!(!output.status.success());
    assert!(text.contains("--steps 7: only 6 steps arrive") && text.contains("--discard"), "{text}");
}

/// The log of a server can be on a full disk.
#[test]
#[cfg(target_os = "linux")]
fn a_server_that_cannot_report_a_lost_link_reconnects() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("index.html"), "the page").expect("a page");
    let (listener, address) = listen();
    let full = File::options().write(true).open("/dev/full").expect("a device");
    let mut program = plantar(&["serve", "--port", "0", "--tcp", &address, "--page"])
        .arg(folder.path())
        .stderr(full)
        .spawn()
        .expect("it runs");
    let (connected, connections) = mpsc::channel();
    std::thread::spawn(move || listener.incoming().try_for_each(|host| connected.send(host)));
    let connect = || connections.recv_timeout(Duration::from_secs(20)).expect("it connects").expect("a socket");
    let mut insole = Insole::with_steps([]);
    // The link is lost while the server answers pages.
    assert!(insole.serve(connect(), after_time_requests(3)));
    assert!(insole.serve(connect(), after_time_requests(3)));
    program.kill().expect("it is still running");
    wait_for_end(program);
}

#[test]
fn monitor_reconnects_and_reports_the_loss_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let (listener, address) = listen();
    let program =
        plantar(&["monitor", "--tcp", &address, "--steps", "2", "--json"]).arg(&json).spawn().expect("it runs");
    let mut insole = Insole::with_steps([0]);
    assert!(insole.serve(listener.accept().expect("it connects").0, is_acknowledgement));
    // The link breaks before the insole receives the acknowledgement, and the next link before any message. Nevertheless, each
    // step is written once.
    drop(listener.accept().expect("it connects again").0);
    insole.session.push_record(step(1));
    insole.serve(listener.accept().expect("it connects again").0, |_| false);
    let (output, text) = wait_for_end(program);
    assert!(output.status.success(), "{text}");
    assert_eq!(text.matches("trying again").count(), 1, "{text}");
    assert!(text.contains(&address), "{text}");
    let steps: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    let numbers: Vec<_> = steps.as_array().expect("steps").iter().map(|s| s["step"].as_u64()).collect();
    assert_eq!(numbers, [Some(0), Some(1)]);
}

/// The acknowledgement of all steps in the insole's RAM is lost. The recorder must repeat it, because otherwise the insole sends
/// no further steps.
#[test]
fn a_recorder_repeats_a_lost_acknowledgement() {
    let folder = tempfile::tempdir().expect("a folder");
    let (listener, address) = listen();
    let program = plantar(&["record", "--tcp", &address, "--steps", "7", "--out"])
        .arg(folder.path().join("session"))
        .spawn()
        .expect("it runs");
    let mut insole = Insole::with_steps(0..RECORD_QUEUE as u32);
    assert!(insole.serve(listener.accept().expect("it connects").0, is_acknowledgement));
    let mut again = listener.accept().expect("it connects again").0;
    assert!(insole.serve(&mut again, is_acknowledgement));
    insole.session.receive(ToDevice::Acknowledge { number: RECORD_QUEUE as u32 - 1 }, 0);
    insole.session.push_record(step(RECORD_QUEUE as u32));
    insole.serve(&mut again, |_| false);
    let (output, text) = wait_for_end(program);
    assert!(output.status.success(), "{text}");
}

/// After a record was lost on the way, the recorder opens the session again over the same link, so that the insole sends its
/// records again. The insole then counts its frames from 0 again.
#[test]
fn no_two_frames_of_a_recorder_have_the_same_session_and_number_after_records_were_sent_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    let (listener, address) = listen();
    let program = plantar(&["record", "--tcp", &address, "--steps", "4", "--out"]).arg(&out).spawn();
    let mut insole = Insole::with_steps([]);
    let mut host = listener.accept().expect("it connects").0;
    let mut t_us = 0;
    let mut send_frames = |insole: &mut Insole, host: &mut TcpStream| {
        for _ in 0..3 {
            let sequence = insole.session.next_live().expect("the stream is on");
            t_us += 10_000;
            insole.session.push_live(Live { sequence, t_us, ..Live::default() });
        }
        assert!(insole.send_due(host));
    };
    assert!(insole.serve(&mut host, time_request_of_stream()));
    send_frames(&mut insole, &mut host);
    insole.session.push_record(step(0));
    assert!(insole.send_due(&mut host));
    // Step 1 is lost on the way, so the recorder opens the session again when step 2 arrives.
    insole.session.push_record(step(1));
    assert!(insole.session.next(&hello(), Status::default, &mut [0; MAX_MESSAGE]).is_some());
    insole.session.push_record(step(2));
    assert!(insole.send_due(&mut host));
    assert!(insole.serve(&mut host, time_request_of_stream()));
    send_frames(&mut insole, &mut host);
    insole.session.push_record(step(3));
    assert!(insole.send_due(&mut host));
    insole.serve(&mut host, |_| false);
    let (output, text) = wait_for_end(program.expect("it runs"));
    assert!(output.status.success(), "{text}");
    // Each frame and each step has eight rows.
    let numbers = |table: &str, number: &str| {
        let file = out.join(table).join("part-00000.parquet");
        let pairs = integers(&file, "session").into_iter().zip(integers(&file, number));
        pairs.step_by(8).collect::<Vec<_>>()
    };
    assert_eq!(numbers("live", "sequence"), [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]);
    // The recorder begins another session with a frame that has no later number than the frame before it. The insole repeats
    // its steps before it sends that frame, so they belong to the session before.
    assert_eq!(numbers("steps", "step"), [(0, 0), (0, 1), (0, 2), (1, 3)]);
}

/// The steps in the folder have the times of this computer's clock, on which both feet can be compared.
#[test]
fn the_measures_of_a_walk_are_computed_from_the_folder_of_a_recorder() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("session");
    let (listener, address) = listen();
    let program = plantar(&["record", "--tcp", &address, "--steps", "4", "--out"]).arg(&session).spawn();
    let mut insole = Insole::with_steps([]);
    for number in 0..4 {
        insole.session.push_record(Step { start_us: 1_200_000 * u64::from(number), ..step(number) });
    }
    insole.serve(listener.accept().expect("it connects").0, |_| false);
    let (output, text) = wait_for_end(program.expect("it runs"));
    assert!(output.status.success(), "{text}");
    let json = folder.path().join("gait.json");
    let program = plantar(&["gait", "--json"]).arg(&json).arg(&session).spawn();
    let (output, text) = wait_for_end(program.expect("it runs"));
    assert!(output.status.success() && !text.contains("the feet are not compared"), "{text}");
    let gait: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    let stride_s = gait["measures"][0]["left"]["mean"].as_f64();
    assert!(stride_s.is_some_and(|stride_s| (stride_s - 1.2).abs() < 1e-5), "{gait:#}");
}

/// The file may be the only copy of recorded steps.
#[test]
fn a_file_that_is_not_empty_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("yesterday");
    std::fs::write(&path, "steps").expect("a file");
    for arguments in [["monitor", "--tcp", "127.0.0.1:9", "--json"], ["serve", "--tcp", "127.0.0.1:9", "--record"]] {
        let mut command = plantar(&arguments);
        command.arg(&path);
        if arguments[0] == "serve" {
            std::fs::write(folder.path().join("index.html"), "the page").expect("a page");
            command.arg("--page").arg(folder.path());
        }
        let (output, text) = wait_for_end(command.spawn().expect("it runs"));
        assert!(!output.status.success());
        assert!(text.contains("yesterday: the file is not empty"), "{text}");
        assert_eq!(std::fs::read_to_string(&path).expect("a file"), "steps");
    }
}

/// A second recorder would overwrite files of the first one, and the insole has already deleted the steps in these files.
#[test]
fn a_second_recorder_into_the_same_place_is_refused_until_the_first_one_has_ended() {
    let folder = tempfile::tempdir().expect("a folder");
    for arguments in [["record", "--out"], ["monitor", "--json"]] {
        let out = folder.path().join(arguments[0]);
        let start = |address: &str| plantar(&arguments).arg(&out).args(["--tcp", address]).spawn().expect("it runs");
        let (listener, address) = listen();
        let mut first = start(&address);
        let mut host = listener.accept().expect("it connects").0;
        assert!(Insole::with_steps([]).serve(&mut host, after_time_requests(1)));
        let (output, text) = wait_for_end(start("127.0.0.1:9"));
        assert!(!output.status.success());
        assert!(text.contains("another program records into it") && text.contains("choose another"), "{text}");
        first.kill().expect("it is still running");
        wait_for_end(first);
        // The killed recorder has stored nothing, so its place can be used.
        let (_, text) = wait_for_end(start("127.0.0.1:9"));
        assert!(text.contains("cannot connect to 127.0.0.1:9"), "{text}");
    }
}

/// The recorder acknowledges steps only once their file is complete.
#[test]
fn the_steps_that_a_killed_recorder_acknowledged_are_readable() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    let (listener, address) = listen();
    let mut program = plantar(&["record", "--tcp", &address, "--out"]).arg(&out).spawn().expect("it runs");
    let mut insole = Insole::with_steps(0..10);
    assert!(insole.serve(listener.accept().expect("it connects").0, is_acknowledgement));
    program.kill().expect("it is still running");
    wait_for_end(program);
    let files: Vec<_> = std::fs::read_dir(out.join("steps")).expect("a table").flatten().collect();
    let complete: Vec<_> = files.iter().filter(|file| !file.file_name().to_string_lossy().starts_with('.')).collect();
    assert!(!complete.is_empty());
    // The file has as many steps as fit into the insole's RAM, with one row for each of the eight regions.
    assert_eq!(rows(&complete[0].path()), 8 * RECORD_QUEUE as i64);
}

/// True for each request for the insole's time after the first `count` such requests. A host sends four of them per second.
fn after_time_requests(count: u32) -> impl Fn(&ToDevice) -> bool {
    let left = Cell::new(count);
    move |message| {
        let is_time = matches!(message, ToDevice::GetTime { .. });
        let is_after = is_time && left.get() == 0;
        left.set(left.get().saturating_sub(u32::from(is_time)));
        is_after
    }
}

/// True for each request for the insole's time after the live stream was turned on. Before the first one, the insole has
/// processed all earlier messages.
fn time_request_of_stream() -> impl Fn(&ToDevice) -> bool {
    let is_on = Cell::new(false);
    move |message| {
        is_on.set(is_on.get() || matches!(message, ToDevice::Stream { live: true }));
        is_on.get() && matches!(message, ToDevice::GetTime { .. })
    }
}

#[test]
#[cfg(unix)]
fn a_recorder_that_receives_a_signal_completes_its_files() {
    for signal in ["INT", "TERM"] {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("session");
        let (listener, address) = listen();
        let program = plantar(&["record", "--cells", "--tcp", &address, "--out"]).arg(&out).spawn().expect("it runs");
        let mut insole = Insole::with_steps([]).with_cells();
        let mut host = listener.accept().expect("it connects").0;
        assert!(insole.serve(&mut host, after_time_requests(3)));
        let kill = format!("kill -{signal} {}", program.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().expect("a shell").success());
        insole.serve(&mut host, |_| false);
        let (output, text) = wait_for_end(program);
        assert!(output.status.success(), "SIG{signal}: {:?} {text}", output.status);
        assert!(rows(&out.join("cells/000/part-00000.parquet")) > 1);
    }
}

/// The link is lost again, and an answer does not arrive, while the recorder requests the cells after a reconnection.
#[test]
fn a_recorder_requests_the_cells_until_their_stream_is_on_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    let (listener, address) = listen();
    let program = plantar(&["record", "--cells", "--tcp", &address, "--steps", "1", "--out"]).arg(&out).spawn();
    let mut insole = Insole::with_steps([]).with_cells();
    assert!(insole.serve(listener.accept().expect("it connects").0, after_time_requests(3)));
    let is_cells = |message: &ToDevice| matches!(message, ToDevice::StreamCells(_));
    assert!(insole.serve(listener.accept().expect("it connects again").0, is_cells));
    // This time the insole does not answer `GetSetup`, so the program closes the connection.
    let mut unanswered = listener.accept().expect("it connects again").0;
    assert!(insole.serve(&mut unanswered, |message| matches!(message, ToDevice::GetSetup)));
    assert!(!insole.serve(&mut unanswered, |_| false));
    let mut last = listener.accept().expect("it connects again").0;
    assert!(insole.serve(&mut last, after_time_requests(3)));
    insole.session.push_record(step(0));
    insole.serve(&mut last, |_| false);
    let (output, text) = wait_for_end(program.expect("it runs"));
    assert!(output.status.success(), "{text}");
    // Each recording has a row for each frame. The connections without a stream of cells have no recording.
    let frames = [0, 1].map(|recording| rows(&out.join(format!("cells/00{recording}/part-00000.parquet"))));
    assert!(frames.iter().all(|&frames| frames > 1), "{frames:?}");
    let expected = format!("{} frames in 2 recordings; 0 frames lost", frames.iter().sum::<i64>());
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains(&expected), "{text}");
}

/// If older firmware refuses the request for the origin of the parameters because it does not know this request, they are written
/// as not personal. After any other failure nothing is written, because the parameters may be personal.
#[test]
fn parameters_of_unknown_origin_are_written_only_if_the_firmware_is_too_old_to_state_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("params.toml");
    let (listener, address) = listen();
    let mut insole = Insole::with_steps([]);
    insole.session.restore_tissue(Parameters::typical(InsoleSize::default()).tissue(), None);
    for is_older_firmware in [false, true] {
        let program = plantar(&["params", "pull", "--tcp", &address, "--out"]).arg(&out).spawn().expect("it runs");
        let mut host = listener.accept().expect("it connects").0;
        assert!(insole.serve(&mut host, |message| matches!(message, ToDevice::GetIdentified)));
        if is_older_firmware {
            insole.session.receive_unknown();
            assert!(insole.send_due(&mut host) && !insole.serve(&mut host, |_| false));
        }
        drop(host);
        let (output, text) = wait_for_end(program);
        assert_eq!((output.status.success(), out.exists()), (is_older_firmware, is_older_firmware), "{text}");
    }
    assert!(!Parameters::read(&out).expect("parameters").personal);
}

/// The instructions have fixed times, so a recording that begins later would not match them.
#[test]
fn a_standing_trial_in_which_the_link_was_lost_begins_again_with_its_instructions() {
    let folder = tempfile::tempdir().expect("a folder");
    let (listener, address) = listen();
    let mut program = plantar(&["identify", "--contact-full", "0", "--tcp", &address, "--out"])
        .arg(folder.path())
        .spawn()
        .expect("it runs");
    let serving = std::thread::spawn(move || {
        let mut insole = Insole::with_steps([]).with_cells();
        assert!(insole.serve(listener.accept().expect("it connects").0, after_time_requests(3)));
        insole.serve(listener.accept().expect("it connects again").0, |_| false);
    });
    let lines = BufReader::new(program.stdout.take().expect("it is piped")).lines().map_while(Result::ok);
    let repeated: Vec<_> = lines.skip_while(|line| !line.contains("begins again")).take(2).collect();
    program.kill().expect("it is still running");
    let (_, text) = wait_for_end(program);
    serving.join().expect("no panic");
    assert!(repeated.last().is_some_and(|line| line.contains("the trial has to be repeated")), "{repeated:?} {text}");
}

/// Only the output is piped, so that a person can press keys: Enter begins the session, and the standing trial waits for it.
#[test]
#[cfg(unix)]
fn a_standing_trial_waits_for_a_key_if_the_input_is_a_terminal() {
    let folder = tempfile::tempdir().expect("a folder");
    let (listener, address) = listen();
    let pair = native_pty_system().openpty(PtySize::default()).expect("a terminal");
    let mut command = CommandBuilder::new("sh");
    command.args([
        "-c",
        "\"$0\" identify --contact-full 0 --tcp \"$1\" --out \"$2\" 2>&1 | cat",
        env!("CARGO_BIN_EXE_plantar"),
    ]);
    command.args([address.as_ref(), folder.path().as_os_str()]);
    let mut child = pair.slave.spawn_command(command).expect("it runs");
    drop(pair.slave);
    let serving = std::thread::spawn(move || {
        let mut insole = Insole::with_steps([]).with_cells();
        insole.serve(listener.accept().expect("it connects").0, |_| false);
    });
    let mut keys = pair.master.take_writer().expect("a writer");
    let output = BufReader::new(pair.master.try_clone_reader().expect("a reader"));
    let mut text = String::new();
    for line in output.lines().map_while(Result::ok) {
        if line.contains("Press Enter to begin") {
            keys.write_all(b"\n").expect("it reads");
        } else if line.contains("Press Enter to start it") || line.contains("off the floor") {
            keys.write_all(b"q\n").expect("it reads");
        }
        text += &format!("{line}\n");
    }
    child.wait().expect("it ends");
    serving.join().expect("no panic");
    assert_eq!(text.matches("open wound").count(), 1, "{text}");
    assert!(text.contains("Press Enter to start it") && text.contains("give the same command again"), "{text}");
    assert!(!text.contains("off the floor"), "the trial has begun: {text}");
}

/// With `--mass`, the gains of both feet have one scale, which their common standing trial determines.
#[test]
fn a_calibration_is_not_sent_if_the_other_foot_has_none() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("left")).expect("a folder");
    let lines: String = (0..CELLS).map(|cell| format!("{cell},0,1.5\n")).collect();
    std::fs::write(folder.path().join("left/calibration.csv"), format!("cell,offset,gain\n{lines}")).expect("written");
    let [left, right] = [listen(), listen()];
    let mut program =
        plantar(&["identify", "--contact-full", "0", "--mass", "70", "--tcp", &left.1, "--tcp", &right.1])
            .arg("--out")
            .arg(folder.path())
            .spawn()
            .expect("it runs");
    // Each thread returns true if the program requests the cells of its foot, for a standing trial, and false if it first sends
    // a calibration.
    let serving = [(left.0, Side::Left), (right.0, Side::Right)].map(|(listener, side)| {
        std::thread::spawn(move || {
            let mut insole = Insole { side, ..Insole::with_steps([]) }.with_cells();
            let is_trial = Cell::new(false);
            insole.serve(listener.accept().expect("it connects").0, |message| {
                is_trial.set(matches!(message, ToDevice::StreamCells(_)));
                is_trial.get() || matches!(message, ToDevice::SetCalibrationBlock { .. })
            });
            is_trial.get()
        })
    });
    let are_trials = serving.map(|thread| thread.join().expect("no panic"));
    program.kill().expect("it can be ended");
    let (_, text) = wait_for_end(program);
    assert_eq!(are_trials, [true, true], "{text}");
}

/// Longest time until a program sends a request, which may need the parameters of a foot to be identified first.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(60);

/// Closes the connection of a program to its insole at the first request for which `is_requested` is true, and asserts that the
/// program connects again and repeats this request. Then ends the program.
fn assert_requested_twice(
    mut program: Child,
    listener: TcpListener,
    is_requested: impl Fn(&ToDevice) -> bool + Copy + Send + 'static,
) {
    let (requested, requests) = mpsc::channel();
    std::thread::spawn(move || {
        for _ in 0..2 {
            let was_requested = Insole::with_steps([]).with_cells().serve(listener.accept()?.0, is_requested);
            requested.send(was_requested).map_err(std::io::Error::other)?;
        }
        std::io::Result::Ok(())
    });
    let received = [(); 2].map(|()| requests.recv_timeout(REQUEST_TIMEOUT));
    program.kill().expect("it can be ended");
    let (_, text) = wait_for_end(program);
    assert_eq!(received, [Ok(true), Ok(true)], "{text}");
}

/// The link of a foot can be lost between two parts of a session, while nothing is received from this foot.
#[test]
fn a_link_that_was_lost_before_the_walk_is_opened_again_and_the_cells_are_requested() {
    let folder = tempfile::tempdir().expect("a folder");
    let (listener, address) = listen();
    let arguments = ["identify", "--no-standing", "--contact-full", "0", "--tcp", &address, "--out"];
    let program = plantar(&arguments).arg(folder.path()).spawn().expect("it runs");
    let is_cells = |message: &ToDevice| matches!(message, ToDevice::StreamCells(Some(_)));
    assert_requested_twice(program, listener, is_cells);
}

/// The steps of an earlier session suffice, so the session has no walk.
#[test]
fn parameters_are_sent_again_after_the_link_was_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    let walk = SyntheticWalk { side: Side::Left, cells: CELLS, steps: 6, ..Default::default() };
    let messages = fit::messages(&synthetic::walk(&walk).recording, ContactRule::COUNTED);
    std::fs::create_dir(folder.path().join("left")).expect("a folder");
    std::fs::write(folder.path().join("left/walk-000.plantar"), fit::stream(&messages, 0)).expect("written");
    let (listener, address) = listen();
    let arguments = ["identify", "--no-standing", "--contact-full", "0", "--steps", "5", "--tcp", &address, "--out"];
    let program = plantar(&arguments).arg(folder.path()).spawn().expect("it runs");
    let is_parameters = |message: &ToDevice| matches!(message, ToDevice::SetIdentifiedTissue { .. });
    assert_requested_twice(program, listener, is_parameters);
}

#[test]
fn a_guided_session_names_a_file_of_an_earlier_session_that_it_cannot_use() {
    let folder = tempfile::tempdir().expect("a folder");
    let earlier = folder.path().join("left/walk-000.plantar");
    std::fs::create_dir(folder.path().join("left")).expect("a folder");
    std::fs::write(&earlier, "damaged").expect("written");
    let (listener, address) = listen();
    let arguments = ["identify", "--no-standing", "--contact-full", "0", "--tcp", &address, "--out"];
    let mut program = plantar(&arguments).arg(folder.path()).spawn().expect("it runs");
    let is_cells = |message: &ToDevice| matches!(message, ToDevice::StreamCells(_));
    assert!(Insole::with_steps([]).with_cells().serve(listener.accept().expect("it connects").0, is_cells));
    program.kill().expect("it is still running");
    let (_, text) = wait_for_end(program);
    assert!(text.contains("walk-000.plantar") && text.contains("not used"), "{text}");
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_reported_and_nothing_is_acknowledged() {
    let (listener, address) = listen();
    let program = plantar(&["monitor", "--tcp", &address, "--json", "/dev/full"]).spawn().expect("it runs");
    assert!(!Insole::with_steps([0]).serve(listener.accept().expect("it connects").0, is_acknowledgement));
    let (output, text) = wait_for_end(program);
    assert!(!output.status.success());
    assert!(text.contains("cannot write /dev/full: No space left on device"), "{text}");
}

/// The test limits the size of files, which has the same effect as a full disk.
#[test]
#[cfg(target_os = "linux")]
fn a_recorder_that_cannot_write_leaves_the_steps_on_the_insole() {
    let folder = tempfile::tempdir().expect("a folder");
    let (listener, address) = listen();
    let program = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 0; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_plantar"), "record", "--tcp"])
        .args([&address, "--out"])
        .arg(folder.path().join("session"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it runs");
    assert!(!Insole::with_steps(0..10).serve(listener.accept().expect("it connects").0, is_acknowledgement));
    let (output, text) = wait_for_end(program);
    assert!(!output.status.success());
    let expected =
        ["cannot write", "part-00000.parquet", "File too large", "were not stored; they remain on the insole"];
    assert!(expected.iter().all(|part| text.contains(part)), "{text}");
}

/// The steps are in their file, so it makes no difference to the insole that the cells could not be written.
#[test]
fn the_steps_of_a_recorder_that_cannot_write_the_cells_are_acknowledged() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    let (listener, address) = listen();
    let program = plantar(&["record", "--cells", "--tcp", &address, "--steps", "3", "--out"]).arg(&out).spawn();
    let mut insole = Insole::with_steps([]).with_cells();
    let mut host = listener.accept().expect("it connects").0;
    assert!(insole.serve(&mut host, after_time_requests(3)));
    // A file takes the place of the folder of the cells.
    std::fs::write(out.join("cells"), "").expect("written");
    (0..3).for_each(|number| insole.session.push_record(step(number)));
    assert!(insole.serve(&mut host, is_acknowledgement));
    insole.serve(&mut host, |_| false);
    let (output, text) = wait_for_end(program.expect("it runs"));
    assert!(!output.status.success());
    assert!(text.contains("cannot create") && text.contains("cells") && !text.contains("not stored"), "{text}");
    assert_eq!(rows(&out.join("steps/part-00000.parquet")), 8 * 3);
}

#[test]
fn an_address_without_an_insole_is_reported() {
    let (listener, address) = listen();
    drop(listener);
    let (output, text) = wait_for_end(plantar(&["monitor", "--tcp", &address]).spawn().expect("it runs"));
    assert!(!output.status.success());
    assert!(text.contains(&format!("cannot connect to {address}")) && text.contains("is the insole"), "{text}");
}

/// Serves a program over `link` while a second program tries to connect to the same insole, and fails. The first program must
/// then receive its second step. `arguments` select the insole. Returns what the second program printed.
fn assert_second_program_is_refused<L: Read + Write>(arguments: &[&str], link: impl FnOnce() -> L) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let arguments = [&["monitor"], arguments].concat();
    let first = plantar(&arguments).args(["--steps", "2", "--json"]).arg(&json).spawn().expect("it runs");
    let mut insole = Insole::with_steps([0]);
    let mut link = link();
    assert!(insole.serve(&mut link, is_acknowledgement));
    insole.session.receive(ToDevice::Acknowledge { number: 0 }, 0);
    let has_ended = AtomicBool::new(false);
    let text = std::thread::scope(|scope| {
        let second = scope.spawn(|| {
            let ended = wait_for_end(plantar(&arguments).spawn().expect("it runs"));
            has_ended.store(true, Ordering::Relaxed);
            ended
        });
        // The first program requests the time several times a second, so `has_ended` is checked as often.
        assert!(insole.serve(&mut link, |_| has_ended.load(Ordering::Relaxed)));
        let (output, text) = second.join().expect("no panic");
        assert!(!output.status.success(), "{text}");
        text
    });
    insole.session.push_record(step(1));
    assert!(insole.serve(&mut link, |message| matches!(message, ToDevice::Acknowledge { number: 1 })));
    let (output, first_text) = wait_for_end(first);
    assert!(output.status.success() && !first_text.contains("trying again"), "{first_text}");
    let steps: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    let numbers: Vec<_> = steps.as_array().expect("steps").iter().map(|s| s["step"].as_u64()).collect();
    assert_eq!(numbers, [Some(0), Some(1)]);
    text
}

/// A program that connects an insole to the network, and serves one client at a time, leaves the next one in the queue of
/// connections, without an answer.
#[test]
fn a_second_program_at_a_network_address_ends_with_a_remedy_and_the_first_one_loses_nothing() {
    let (listener, address) = listen();
    let text = assert_second_program_is_refused(&["--tcp", &address], || listener.accept().expect("it connects").0);
    assert!(text.contains(&address) && text.contains("another program may be connected to it"), "{text}");
}

/// Other bridges close the connection of the next program at once.
#[test]
fn a_connection_that_is_closed_at_once_is_reported_with_a_remedy() {
    let (listener, address) = listen();
    let program = plantar(&["monitor", "--tcp", &address]).spawn().expect("it runs");
    drop(listener.accept().expect("it connects"));
    let (output, text) = wait_for_end(program);
    assert!(!output.status.success());
    assert!(text.contains(&address) && text.contains("another program may be connected to it"), "{text}");
}

#[cfg(unix)]
mod serial {
    use super::*;
    use serialport::{SerialPort, TTYPort};

    /// Opens a pseudo-terminal. Returns the insole's end, the host's end, which is open but not locked, and the name of the
    /// host's end.
    fn port() -> (TTYPort, TTYPort, String) {
        let (insole, host) = TTYPort::pair().expect("a pseudo-terminal");
        let name = host.name().expect("a name");
        (insole, host, name)
    }

    #[test]
    fn a_missing_port_is_reported() {
        let (output, text) = wait_for_end(plantar(&["monitor", "--serial", "/dev/insole"]).spawn().expect("it runs"));
        assert!(!output.status.success());
        assert!(text.contains("cannot open /dev/insole") && text.contains("plug the insole in"), "{text}");
    }

    #[test]
    fn a_second_program_at_a_port_is_refused_and_the_first_one_loses_nothing() {
        let (insole, _host, name) = port();
        let text = assert_second_program_is_refused(&["--serial", &name], || insole);
        assert!(
            text.contains(&format!("cannot open {name}")) && text.contains("another program is connected"),
            "{text}"
        );
    }

    /// The insole is switched off for some time, while its serial adapter remains plugged in.
    #[test]
    fn an_insole_that_was_silent_for_long_is_found_on_the_same_port() {
        let (mut port, _host, name) = port();
        let program = plantar(&["monitor", "--steps", "2", "--discard", "--serial", &name]).spawn().expect("it runs");
        let mut insole = Insole::with_steps([0]);
        assert!(insole.serve(&mut port, is_acknowledgement));
        insole.is_silent = true;
        // After this number of unanswered requests, the program has opened the port again.
        const REQUESTS_BEFORE_REOPENED: u32 = 15;
        let connect_requests = Cell::new(0);
        assert!(insole.serve(&mut port, |message| {
            connect_requests.set(connect_requests.get() + u32::from(matches!(message, ToDevice::Connect { .. })));
            connect_requests.get() > REQUESTS_BEFORE_REOPENED
        }));
        insole.is_silent = false;
        insole.session.push_record(step(1));
        assert!(insole.serve(&mut port, |message| matches!(message, ToDevice::Acknowledge { number: 1 })));
        let (output, text) = wait_for_end(program);
        assert!(output.status.success(), "{text}");
        assert!(text.contains("trying again"), "{text}");
    }

    #[test]
    fn an_unplugged_port_is_reported_and_the_received_steps_are_stored() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("session");
        let (mut port, _host, name) = port();
        // The port is never plugged in again, so the option --seconds ends the program.
        let program =
            plantar(&["record", "--seconds", "3", "--serial", &name, "--out"]).arg(&out).spawn().expect("it runs");
        assert!(Insole::with_steps(0..RECORD_QUEUE as u32).serve(&mut port, is_acknowledgement));
        drop(port);
        let (output, text) = wait_for_end(program);
        assert!(output.status.success(), "{text}");
        assert!(text.contains(&name) && text.contains("trying again"), "{text}");
        assert_eq!(rows(&out.join("steps/part-00000.parquet")), 8 * RECORD_QUEUE as i64);
    }
}
