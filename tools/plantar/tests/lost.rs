//! What goes wrong around an insole: a lost link, a port that is gone or taken, a full disk, a program that is killed.
//!
//! The insole is the firmware's own link on a socket or a pseudo-terminal.

use parquet::file::reader::{FileReader, SerializedFileReader};
use plantar::Side;
use plantar::protocol::session::{STEP_QUEUE, Session};
use plantar::protocol::{Decoder, Hello, MAX_FRAME, MAX_MESSAGE, Reset, Status, ToDevice, decode, frame};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use testkit::step;

/// An insole at the other end of a carrier; steps wait in it.
struct Insole {
    link: Session,
    /// It hears what is said to it and does nothing.
    is_deaf: bool,
}

impl Insole {
    fn with_steps(steps: impl IntoIterator<Item = u32>) -> Self {
        let mut link = Session::new();
        steps.into_iter().for_each(|number| link.push_step(step(number)));
        Self { link, is_deaf: false }
    }

    /// Talks to the host until `enough` of what it says; false where it left before.
    fn talk(&mut self, mut carrier: impl Read + Write, enough: impl Fn(&ToDevice) -> bool) -> bool {
        let mut decoder = Decoder::new();
        let mut heard = [0; 256];
        loop {
            let count = match carrier.read(&mut heard) {
                Ok(0) => return false,
                Ok(count) => count,
                Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => continue,
                Err(_) => return false,
            };
            for &byte in &heard[..count] {
                let Some(message) = decoder.push(byte).and_then(decode::<ToDevice>) else { continue };
                if enough(&message) {
                    return true;
                }
                if !self.is_deaf {
                    self.link.receive(message, 0);
                }
            }
            let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
            while let Some(message) = self.link.next(&hello(), Status::default, &mut buffer) {
                let len = frame(message, &mut framed);
                if carrier.write_all(&framed[..len]).is_err() {
                    return false;
                }
            }
        }
    }
}

fn hello() -> Hello {
    Hello { side: Side::Left, tissue_id: 0, reset: Reset::Power, last_panic: None, ..testkit::hello() }
}

fn is_acknowledgement(message: &ToDevice) -> bool {
    matches!(message, ToDevice::Acknowledge { .. })
}

fn plantar(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plantar"));
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn listen() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    (listener, address)
}

fn end(program: Child) -> (Output, String) {
    let output = program.wait_with_output().expect("the program ends");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

fn rows(part: &Path) -> i64 {
    let file = SerializedFileReader::new(File::open(part).expect("a part")).expect("a whole file");
    file.metadata().file_metadata().num_rows()
}

#[test]
fn monitor_finds_an_insole_again_and_says_so_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("steps.json");
    let (listener, address) = listen();
    let program =
        plantar(&["monitor", "--tcp", &address, "--steps", "2", "--json"]).arg(&json).spawn().expect("it runs");
    let mut insole = Insole::with_steps([0]);
    assert!(insole.talk(listener.accept().expect("it connects").0, is_acknowledgement));
    // The link broke before the acknowledgement arrived, and once more before anything was said: no step is lost, none comes
    // twice.
    drop(listener.accept().expect("it connects again").0);
    insole.link.push_step(step(1));
    insole.talk(listener.accept().expect("it connects again").0, |_| false);
    let (output, said) = end(program);
    assert!(output.status.success(), "{said}");
    assert_eq!(said.matches("trying again").count(), 1, "{said}");
    assert!(said.contains(&address), "{said}");
    let steps: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    let numbers: Vec<_> = steps.as_array().expect("steps").iter().map(|s| s["step"].as_u64()).collect();
    assert_eq!(numbers, [Some(0), Some(1)]);
}

/// All steps that an insole has at hand were acknowledged, and it did not hear that: it must be told again to send others.
#[test]
fn a_recorder_whose_acknowledgement_was_lost_repeats_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (listener, address) = listen();
    let program = plantar(&["record", "--tcp", &address, "--steps", "7", "--out"])
        .arg(folder.path().join("session"))
        .spawn()
        .expect("it runs");
    let mut insole = Insole::with_steps(0..STEP_QUEUE as u32);
    assert!(insole.talk(listener.accept().expect("it connects").0, is_acknowledgement));
    let mut again = listener.accept().expect("it connects again").0;
    assert!(insole.talk(&mut again, is_acknowledgement));
    insole.link.receive(ToDevice::Acknowledge { step: STEP_QUEUE as u32 - 1 }, 0);
    insole.link.push_step(step(STEP_QUEUE as u32));
    insole.talk(&mut again, |_| false);
    let (output, said) = end(program);
    assert!(output.status.success(), "{said}");
}

/// What is in a file may be nowhere else.
#[test]
fn a_file_that_holds_something_is_not_written_over() {
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
        let (output, said) = end(command.spawn().expect("it runs"));
        assert!(!output.status.success());
        assert!(said.contains("yesterday: it is not empty"), "{said}");
        assert_eq!(std::fs::read_to_string(&path).expect("a file"), "steps");
    }
}

/// Steps are acknowledged once their part is whole, and whole it stays.
#[test]
fn what_a_killed_recorder_acknowledged_is_readable() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("session");
    let (listener, address) = listen();
    let mut program = plantar(&["record", "--tcp", &address, "--out"]).arg(&out).spawn().expect("it runs");
    let mut insole = Insole::with_steps(0..10);
    assert!(insole.talk(listener.accept().expect("it connects").0, is_acknowledgement));
    program.kill().expect("it runs still");
    end(program);
    let parts: Vec<_> = std::fs::read_dir(out.join("steps")).expect("a table").flatten().collect();
    let whole: Vec<_> = parts.iter().filter(|part| !part.file_name().to_string_lossy().starts_with('.')).collect();
    assert!(!whole.is_empty());
    // All steps that an insole has at hand, eight regions each.
    assert_eq!(rows(&whole[0].path()), 8 * STEP_QUEUE as i64);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_named_and_nothing_is_acknowledged() {
    let (listener, address) = listen();
    let program = plantar(&["monitor", "--tcp", &address, "--json", "/dev/full"]).spawn().expect("it runs");
    assert!(!Insole::with_steps([0]).talk(listener.accept().expect("it connects").0, is_acknowledgement));
    let (output, said) = end(program);
    assert!(!output.status.success());
    assert!(said.contains("cannot write /dev/full: No space left on device"), "{said}");
}

/// No file may grow: as a full disk, for any folder.
#[test]
#[cfg(target_os = "linux")]
fn a_recorder_that_cannot_write_leaves_the_steps_to_the_insole() {
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
    assert!(!Insole::with_steps(0..10).talk(listener.accept().expect("it connects").0, is_acknowledgement));
    let (output, said) = end(program);
    assert!(!output.status.success());
    let expected =
        ["cannot write", "part-00000.parquet", "File too large", "were not stored; they remain on the insole"];
    assert!(expected.iter().all(|part| said.contains(part)), "{said}");
}

#[test]
fn nothing_at_an_address_is_named() {
    let (listener, address) = listen();
    drop(listener);
    let (output, said) = end(plantar(&["monitor", "--tcp", &address]).spawn().expect("it runs"));
    assert!(!output.status.success());
    assert!(said.contains(&format!("cannot reach {address}")) && said.contains("is the insole"), "{said}");
}

#[cfg(unix)]
mod serial {
    use super::*;
    use serialport::{SerialPort, TTYPort};
    use std::cell::Cell;

    /// The insole's end, the host's, which is open and not taken, and its name.
    fn port() -> (TTYPort, TTYPort, String) {
        let (insole, host) = TTYPort::pair().expect("a pseudo-terminal");
        let name = host.name().expect("a name");
        (insole, host, name)
    }

    #[test]
    fn a_port_that_is_not_there_is_named() {
        let (output, said) = end(plantar(&["monitor", "--serial", "/dev/insole"]).spawn().expect("it runs"));
        assert!(!output.status.success());
        assert!(said.contains("cannot open /dev/insole") && said.contains("plug the insole in"), "{said}");
    }

    #[test]
    fn a_port_belongs_to_one_program() {
        let (_insole, _host, name) = port();
        let _holder = serialport::new(&name, 115_200).open().expect("it is free");
        let (output, said) = end(plantar(&["monitor", "--serial", &name]).spawn().expect("it runs"));
        assert!(!output.status.success());
        assert!(said.contains(&format!("cannot open {name}")) && said.contains("another program holds it"), "{said}");
    }

    /// As one that is switched off behind an adapter, which stays.
    #[test]
    fn an_insole_that_was_silent_for_long_is_found_on_the_same_port() {
        let (mut port, _host, name) = port();
        let program = plantar(&["monitor", "--steps", "2", "--serial", &name]).spawn().expect("it runs");
        let mut insole = Insole::with_steps([0]);
        assert!(insole.talk(&mut port, is_acknowledgement));
        // More hellos than are said before the port is let go of.
        insole.is_deaf = true;
        let hellos = Cell::new(0);
        assert!(insole.talk(&mut port, |message| {
            hellos.set(hellos.get() + u32::from(matches!(message, ToDevice::Connect { .. })));
            hellos.get() > 15
        }));
        insole.is_deaf = false;
        insole.link.push_step(step(1));
        assert!(insole.talk(&mut port, |message| matches!(message, ToDevice::Acknowledge { step: 1 })));
        let (output, said) = end(program);
        assert!(output.status.success(), "{said}");
        assert!(said.contains("trying again"), "{said}");
    }

    #[test]
    fn an_unplugged_port_is_named_and_what_came_is_stored() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("session");
        let (mut port, _host, name) = port();
        // It ends by itself: nothing is plugged in again.
        let program =
            plantar(&["record", "--seconds", "3", "--serial", &name, "--out"]).arg(&out).spawn().expect("it runs");
        assert!(Insole::with_steps(0..STEP_QUEUE as u32).talk(&mut port, is_acknowledgement));
        drop(port);
        let (output, said) = end(program);
        assert!(output.status.success(), "{said}");
        assert!(said.contains(&name) && said.contains("trying again"), "{said}");
        assert_eq!(rows(&out.join("steps/part-00000.parquet")), 8 * STEP_QUEUE as i64);
    }
}
