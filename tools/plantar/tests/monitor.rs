//! Tests `plantar monitor` and `plantar record` with the real firmware in the emulator, through a network bridge.
//!
//! The firmware is the file that `PLANTAR_FIRMWARE` names.

use emulation::EmulatorConfig;
use emulator::{Board, Link, Recorded, Time};
use parquet::file::reader::SerializedFileReader;
use parquet::record::{Field, Row};
use plantar::Region;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Decoder, Live, Step, ToHost, decode};
use recording::{Recording, VirtualInsole, synthetic};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write, copy};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Forwards bytes in one direction, in a thread of its own.
fn forward(mut from: impl Read + Send + 'static, mut to: impl Write + Send + 'static) {
    // The thread ends once one of the sockets is closed.
    std::thread::spawn(move || copy(&mut from, &mut to));
}

/// Forwards the insole's bytes until its first status has passed. The live stream is then on.
fn wait_for_stream(link: &mut Link, host: &mut TcpStream) {
    let mut decoder = Decoder::new();
    let mut bytes = [0; 256];
    loop {
        let count = link.read(&mut bytes).expect("the link is open");
        host.write_all(&bytes[..count]).expect("the program is connected");
        let is_status = |&byte: &u8| {
            let message = decoder.push(byte).and_then(decode::<ToHost>);
            matches!(message, Some(ToHost::Status(_)))
        };
        if bytes[..count].iter().any(is_status) {
            return;
        }
    }
}

/// Runs the command line with `arguments`, connected over the network to the real firmware, into which a walk of three steps is
/// played.
fn run_with_insole(arguments: &[&str]) -> Output {
    let firmware = std::env::var_os("PLANTAR_FIRMWARE")
        .expect("set PLANTAR_FIRMWARE to the firmware of the emulated board; `cargo xtask test` does");
    let walk = walk();
    let virtual_insole = VirtualInsole::new(&walk, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let config = EmulatorConfig::new(virtual_insole.setup);
    let cells = virtual_insole.cells.clone();
    let walk = Recorded::new(walk, virtual_insole);
    let board = Board::start(firmware.as_ref(), &config, &cells, Time::Fastest, walk).expect("the board boots");
    let bridge = TcpListener::bind("127.0.0.1:0").expect("a port");
    let program = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(arguments)
        .arg("--tcp")
        .arg(bridge.local_addr().expect("an address").to_string())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let (mut host, _) = bridge.accept().expect("the program connects");
    forward(host.try_clone().expect("a socket"), board.link().expect("the link"));
    let mut link = board.link().expect("the link");
    wait_for_stream(&mut link, &mut host);
    forward(link, host);
    board.play();
    program.wait_with_output().expect("the program ends")
}

/// The processes that a process has started, and that are running.
#[cfg(target_os = "linux")]
fn children(process: u32) -> Vec<u32> {
    let children = std::fs::read_to_string(format!("/proc/{process}/task/{process}/children")).unwrap_or_default();
    children.split_whitespace().map(|child| child.parse().expect("a number")).collect()
}

/// Waits until a process has ended. A process that nothing waits for remains in the state Z.
#[cfg(target_os = "linux")]
fn wait_until_ended(process: u32) {
    let end = Instant::now() + Duration::from_secs(20);
    let is_running = || {
        let state = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
        state.rsplit(')').next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with(" Z"))
    };
    while is_running() {
        assert!(Instant::now() < end, "process {process} is still running");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Neither a program that is killed nor one with an output that nothing reads any more leaves an emulator behind.
#[test]
#[cfg(target_os = "linux")]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn an_emulated_board_ends_with_the_program() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("walk.parquet");
    walk().write(&path).expect("written");
    for is_killed in [true, false] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_plantar"))
            .arg("emulate")
            .arg(&path)
            .arg("--firmware")
            .arg(std::env::var_os("PLANTAR_FIRMWARE").expect("the firmware of the emulated board"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut output = BufReader::new(program.stdout.take().expect("it is piped"));
        let mut emulators = Vec::new();
        while emulators.is_empty() {
            // The second line, with the insole's name, appears once the board runs.
            let count = output.read_line(&mut String::new()).expect("text");
            assert!(count > 0, "no board was started");
            emulators = children(program.id());
        }
        if is_killed {
            program.kill().expect("it is still running");
        }
        drop(output);
        let status = program.wait().expect("it ends");
        if !is_killed {
            assert_eq!(status.code(), Some(128 + 13));
        }
        emulators.into_iter().for_each(wait_until_ended);
    }
}

/// A computed walk of three steps.
fn walk() -> Recording {
    synthetic::walk(&synthetic::SyntheticWalk { steps: 3, ..Default::default() }).recording
}

#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn monitor_names_an_insole_on_the_network_and_stores_its_steps() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let arguments = ["monitor", "--steps", "3", "--json", json.to_str().expect("text")];
    let output = run_with_insole(&arguments);
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{text}");
    assert!(text.contains("right insole, 240 cells at 100 Hz, emulated board"), "{text}");
    let steps: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    let numbers: Vec<_> = steps.as_array().expect("steps").iter().map(|s| s["step"].as_u64()).collect();
    assert_eq!(numbers, [Some(0), Some(1), Some(2)]);
}

/// The rows of all files in the folder of a table, in the order of the files' names.
fn rows(folder: &Path) -> Vec<Row> {
    let files = std::fs::read_dir(folder).expect("a table").map(|entry| entry.expect("a file").path());
    let mut files: Vec<_> = files.collect();
    files.sort();
    let rows = files.iter().flat_map(|file| {
        let file = SerializedFileReader::new(File::open(file).expect("a file")).expect("Parquet");
        file.into_iter().map(|row| row.expect("a row")).collect::<Vec<_>>()
    });
    rows.collect()
}

/// The value of a row in the column `name`.
fn value<'r>(row: &'r Row, name: &str) -> &'r Field {
    let column = row.get_column_iter().find(|(column, _)| *column == name);
    column.unwrap_or_else(|| panic!("no column {name}")).1
}

/// The recorded values equal the values that the library computes on this host from the same walk.
#[test]
#[ignore = "needs the emulated board's firmware: cargo xtask test"]
fn record_stores_the_session_as_tables() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    let output = run_with_insole(&["record", "--steps", "3", "--out", out.to_str().expect("text")]);
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success() && text.contains("3 steps"), "{text}");

    let recording = walk();
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied()).expect("a valid set-up");
    let mut codes = vec![0; virtual_insole.cells.len()];
    let (mut live, mut steps) = (Vec::new(), Vec::new());
    for i in 0..virtual_insole.frames(&recording) {
        virtual_insole.codes_of(&recording, i, &mut codes);
        let toe_off = insole.frame(i as u32, &codes);
        live.push(Live::new(i as u32, 0, insole.loads(), insole.masked(), insole.foot_centre_mm()));
        if toe_off {
            steps.push(Step::new(&insole.whole_step().expect("a step")));
        }
    }
    let stored = rows(&out.join("steps"));
    assert_eq!(stored.len(), 3 * 8);
    for (i, row) in stored.iter().enumerate() {
        let computed = &steps[i / 8].regions[i % 8];
        assert_eq!(value(row, "region"), &Field::Str(Region::ALL[i % 8].name().into()));
        assert_eq!(value(row, "measured_force_peak_n"), &Field::Double(f64::from(computed.measured_peak_dn) / 10.0));
        assert_eq!(value(row, "contact_time_s"), &Field::Double(f64::from(computed.contact_ms) / 1e3));
    }
    let stored = rows(&out.join("live"));
    assert!(stored.len().is_multiple_of(8) && stored.len() > 8 * 100, "{} rows", stored.len());
    for (i, row) in stored.iter().enumerate() {
        // The live stream need not begin with the first frame. A frame takes 10 ms, so its time gives its number in the walk.
        let Field::Double(t_s) = value(row, "t_s") else { panic!("{row:?}") };
        // `unix_s` cannot be compared exactly: the clocks were synchronised before the walk, and that of the emulated insole runs
        // faster.
        let Field::Double(unix_s) = value(row, "unix_s") else { panic!("{row:?}") };
        assert!(*unix_s > 1.7e9);
        let computed = &live[(t_s * 100.0).round() as usize].regions[i % 8];
        assert_eq!(value(row, "measured_force_n"), &Field::Double(f64::from(computed.measured_dn) / 10.0));
        assert_eq!(value(row, "area_mm2"), &Field::Double(f64::from(computed.area_mm2)));
    }

    // The command refuses a folder that is not empty.
    let again = Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(["record", "--tcp", "127.0.0.1:9", "--out"])
        .arg(&out)
        .output()
        .expect("the program starts");
    let text = String::from_utf8(again.stderr).expect("text");
    assert!(!again.status.success() && text.contains("is not empty"), "{text}");
}
