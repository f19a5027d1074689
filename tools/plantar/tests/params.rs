//! Tests `plantar params` and `plantar insole` with files, and with a simulated insole on the network that runs the code of the
//! firmware's session.

use client::{Client, Framed, READ_TIMEOUT, ReconnectPolicy};
use parameters::{DIRECT, Identified, InsoleSize, Parameters};
use plantar::pipeline::alert::{AlertRules, DailyLoad};
use plantar::pipeline::baseline::ZeroResult;
use plantar::pipeline::calibrate::CellCalibration;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::cumulative::LoadLimits;
use plantar::pipeline::region::{Region, Side};
use plantar::pipeline::tissue::Tissue;
use plantar::protocol::CalibrationId;
use plantar::protocol::session::{Command, CommandResult, Session};
use plantar::protocol::{self, Decoder, Hello, Identity, MAX_FRAME, MAX_MESSAGE, Reset, Settings, Status, ToDevice};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{self, Output};
use std::sync::{Arc, Mutex};

/// The result with which the simulated insole answers a request to measure its baselines (`plantar insole zero`).
const ZERO_RESULT: ZeroResult =
    ZeroResult { changed: 17, with_former_baseline: [0, 2, 0, 0, 0, 0, 0, 0], residual_dn: [31, 0, 0, 0, 0, 0, 0, 0] };

/// Starts an insole that serves one host after the other until the test ends. Returns its address and its session.
fn insole() -> (SocketAddr, Arc<Mutex<Session>>) {
    insole_with(None)
}

/// As [`insole`], with settings that it has stored and does not use before its next restart.
fn insole_with(mut stored: Option<Settings>) -> (SocketAddr, Arc<Mutex<Session>>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let session = Arc::new(Mutex::new(Session::new()));
    session.lock().expect("no panic").set_layout(testkit::SETUP, &[], stored);
    let insole = session.clone();
    std::thread::spawn(move || {
        let mut status = Status::default();
        // The settings since the last restart.
        let mut in_use: Option<Settings> = None;
        for mut host in listener.incoming().map(|host| host.expect("a host")) {
            let mut decoder = Decoder::new();
            let mut received = [0; 64];
            while let Ok(count @ 1..) = host.read(&mut received) {
                let mut session = insole.lock().expect("no panic");
                for &byte in &received[..count] {
                    if let Some(message) = decoder.push(byte).and_then(protocol::decode::<ToDevice>) {
                        session.receive(message, 0);
                        let identity = session.identity();
                        let result = match session.command() {
                            Some(Command::SetIdentity(side, serial)) => {
                                CommandResult::Identity(Identity { side, serial, ..identity })
                            }
                            Some(Command::Calibration { id, .. }) => {
                                CommandResult::Identity(Identity { calibration_id: id, ..identity })
                            }
                            Some(Command::Settings(settings)) => {
                                stored = settings;
                                CommandResult::Stored
                            }
                            _ => CommandResult::Stored,
                        };
                        session.complete(Ok(result));
                        let requests = session.take_to_insole();
                        if requests.zero {
                            session.answer_zero(Ok(ZERO_RESULT));
                        }
                        if let Some(snoozed_s) = requests.snooze_s {
                            session.set_daily_load(DailyLoad { snoozed_s, ..testkit::daily_load() }, true);
                        }
                        if message == ToDevice::Restart {
                            status.contents.start += 1;
                            in_use = stored;
                            let setup = in_use.map_or(testkit::SETUP, |settings| settings.apply_to(testkit::SETUP));
                            session.set_layout(setup, &[], in_use);
                        }
                    }
                }
                let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
                let contact_rule = session.setup().expect("it has a layout").contact;
                let layout_id = testkit::SETUP.layout_id;
                let layout_id = in_use.map_or(layout_id, |settings| settings.id(layout_id));
                let hello = Hello { contact_rule, layout_id, ..hello() };
                while let Some(message) = session.next(&hello, || status, &mut buffer) {
                    let len = protocol::frame(message, &mut framed);
                    host.write_all(&framed[..len]).expect("the host is connected");
                }
            }
        }
    });
    (address, session)
}

fn hello() -> Hello {
    Hello { side: Side::Left, tissue_id: 0, reset: Reset::Power, fault: None, ..testkit::hello() }
}

/// Runs `plantar params` with these arguments.
fn params(folder: &Path, arguments: &str) -> Output {
    plantar(folder, &format!("params {arguments}"))
}

fn plantar(folder: &Path, arguments: &str) -> Output {
    process::Command::new(env!("CARGO_BIN_EXE_plantar"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

/// Runs `plantar insole` with these arguments and the insole at this address. Returns whether it succeeded, and what it printed
/// on stdout and on stderr.
fn run_insole(folder: &Path, address: SocketAddr, arguments: &str) -> (bool, String, String) {
    let output = plantar(folder, &format!("insole {arguments} --tcp {address}"));
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (output.status.success(), text(output.stdout), text(output.stderr))
}

/// Runs `plantar params`, asserts that it succeeds, and returns what it printed on stdout.
fn succeed(folder: &Path, arguments: &str) -> String {
    let output = params(folder, arguments);
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Runs `plantar params`, and asserts that it ends with this exit status and prints a message that contains all of `words`.
fn fail(folder: &Path, arguments: &str, code: i32, words: &[&str]) {
    let output = params(folder, arguments);
    let text = String::from_utf8(output.stderr).expect("text");
    assert_eq!(output.status.code(), Some(code), "{arguments}: {text}");
    for word in words {
        assert!(text.contains(word), "{arguments}: no \"{word}\" in: {text}");
    }
}

#[test]
fn parameters_are_sent_shown_and_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let (address, session) = insole();
    let id = || format!("{:08x}", session.lock().expect("no panic").tissue().id);
    for command in ["show", "pull --out pulled.toml"] {
        fail(path, &format!("{command} --tcp {address}"), 1, &["no parameters", "params push"]);
    }

    succeed(path, "typical --size 40 --out params.toml");
    let text = succeed(path, &format!("push params.toml --tcp {address}"));
    let first = id();
    assert!(text.contains(&format!("none before, now {first}")) && text.contains("they are stored"), "{text}");
    succeed(path, "typical --size 41 --out other.toml");
    let text = succeed(path, &format!("push other.toml --tcp {address}"));
    assert!(text.contains(&format!("{first} before, now {}", id())), "{text}");

    let text = succeed(path, &format!("pull --out pulled.toml --tcp {address}"));
    assert!(text.contains("pulled.toml") && text.contains(&id()), "{text}");
    let text = std::fs::read_to_string(path.join("pulled.toml")).expect("a file");
    assert!(text.contains("a = b = sqrt(A B), d0 = C"), "{text}");
    let pulled = Parameters::read(&path.join("pulled.toml")).expect("a valid file");
    assert_eq!(pulled.tissue(), *session.lock().expect("no panic").tissue());

    // The insole, the file that was sent and the file that was read back have the same force laws. The files also have
    // ellipsoids.
    let on_insole = succeed(path, &format!("show --tcp {address}"));
    assert!(on_insole.contains(&id()) && on_insole.contains("K kPa") && !on_insole.contains("d0 mm"), "{on_insole}");
    let on_insole = on_insole.strip_prefix("not known to be personal\n").expect("typical parameters");
    for file in ["other.toml", "pulled.toml"] {
        let shown = succeed(path, &format!("show {file}"));
        assert!(shown.ends_with(on_insole) && shown.contains("d0 mm"), "{shown}");
    }
    let shown = succeed(path, "show other.toml");
    assert!(shown.starts_with("typical, size 41, not personal"));
    for (size, subject, is_extrapolated) in [
        ("", "typical, size 42 assumed, not personal", false),
        ("--size 46", "typical, size 46, not personal", false),
        ("--size 50", "typical, size 50, not personal", true),
        ("--size 20", "typical, size 20, not personal", true),
    ] {
        let output = params(path, &format!("typical {size} --out sized.toml"));
        let [text, notes] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("text"));
        assert!(output.status.success() && text.contains(subject), "{size}: {text}{notes}");
        assert_eq!(notes.contains("outside of the sizes of the paper (35 to 46)"), is_extrapolated, "{size}: {notes}");
        assert!(succeed(path, "show sized.toml").starts_with(subject), "{size}");
    }

    // A control character in a text that the program prints would have an effect on the terminal.
    let text = std::fs::read_to_string(path.join("other.toml")).expect("a file");
    let text = text.replacen("subject = \"typical,", "subject = \"typical,\\u001b", 1);
    std::fs::write(path.join("control.toml"), text).expect("written");
    assert_eq!(succeed(path, "show control.toml"), shown.replacen("typical,", "typical, ", 1));
}

#[test]
fn parameters_and_their_contact_rule_are_set_together() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let (address, session) = insole();
    let mut parameters = Parameters::typical(InsoleSize::default());
    parameters.personal = true;
    parameters.identified = Some(Identified {
        filter: DIRECT.into(),
        contact: ContactRule::COVERED,
        side: "right".into(),
        steps: 31,
        regions: vec![Region::Heel, Region::Hallux],
    });
    // In former files, the filter "step" is the smoothing of the paper. Insoles applied it then, but do not any more, so such
    // parameters must be identified again.
    std::fs::write(path.join("params.toml"), parameters.to_toml()).expect("written");
    let text = std::fs::read_to_string(path.join("params.toml")).expect("a file");
    std::fs::write(path.join("old.toml"), text.replace("\"direct\"", "\"step\"")).expect("written");
    let output = params(path, &format!("push old.toml --tcp {address}"));
    let stderr = String::from_utf8(output.stderr).expect("text");
    assert!(!output.status.success() && stderr.contains("fit --filter direct"), "{stderr}");

    let output = params(path, &format!("push params.toml --tcp {address}"));
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).expect("text"));
    assert!(output.status.success() && stdout.contains("sqrt(p / 150 kPa)"), "{stdout} {stderr}");
    assert!(stderr.contains("identified from the right foot, but this is the left foot"), "{stderr}");
    {
        let session = session.lock().expect("no panic");
        assert_eq!(session.setup().map(|setup| setup.contact), Some(ContactRule::COVERED));
        assert_eq!(*session.tissue(), parameters.tissue());
    }
    // The insole stores the conditions of the identification, which are read back with the parameters.
    let shown = succeed(path, &format!("show --tcp {address}"));
    assert!(shown.contains("identified from 31 steps (right)") && shown.contains("kPa: heel, hallux"), "{shown}");
    succeed(path, &format!("pull --out pulled.toml --tcp {address}"));
    let pulled = Parameters::read(&path.join("pulled.toml")).expect("a valid file");
    assert_eq!((pulled.personal, pulled.identified), (true, parameters.identified));

    // Files of former programs do not list the regions: all of them count as identified.
    let former: String =
        text.lines().filter(|line| !line.starts_with("regions = ")).map(|line| format!("{line}\n")).collect();
    let former = Parameters::parse(&former, Path::new("former.toml")).expect("a valid file").identified.expect("known");
    assert_eq!(former.regions, Region::ALL);
    let unknown = Parameters::parse(&text.replace("\"hallux\"", "\"toe\""), Path::new("unknown.toml"));
    assert!(unknown.is_err_and(|error| error.to_string().contains("\"toe\" is not a region")), "{text}");

    // The insole accepts parameters that were identified with the filter of the live stream, but does not track their changes,
    // because it evaluates its steps with the other filter.
    std::fs::write(path.join("live.toml"), text.replace("\"direct\"", "\"live\"")).expect("written");
    let output = params(path, &format!("push live.toml --tcp {address}"));
    let stderr = String::from_utf8(output.stderr).expect("text");
    assert!(output.status.success() && stderr.contains("does not follow changes"), "{stderr}");
}

#[test]
fn settings_are_set_shown_and_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (address, session) = insole();
    let run = |arguments: &str| run_insole(folder, address, arguments);
    let (done, text, _) = run("show");
    assert!(done && text.contains("of the firmware") && text.contains("whole cells"), "{text}");
    let (done, text, error) = run("set --contact-full 150 --rate 200 --size 39 --strike 40 --max-stance 2000");
    let words = [
        "set by a host",
        "sqrt(p / 150 kPa)",
        "adaptive thresholds, from 40 N until below 70 N",
        "to 2000 ms",
        "200 frames/s",
        "92.9 %",
    ];
    assert!(done && words.iter().all(|words| text.contains(words)), "{text} {error}");
    // Other values remain as they are.
    let (done, text, _) = run("set --contact-on 12");
    assert!(done && text.contains("on at 12 kPa, off below 7.5 kPa") && text.contains("200 frames/s"), "{text}");
    for (arguments, words) in [
        ("set", "nothing to change"),
        ("set --contact-full 150", "nothing to change"),
        ("set --contact-on 5", "off_kpa <= on_kpa"),
        ("set --rate 500", "50..=400"),
        ("set --size 53", "from 32 to 52"),
        // The firmware limits the scale of its layout to 0.75 to 1.25.
        ("set --size 31", "from 32 to 52"),
        ("set --reset --rate 100", "cannot be used with"),
    ] {
        let (done, _, text) = run(arguments);
        assert!(!done && text.contains(words), "{arguments}: {text}");
    }
    let (done, text, _) = run("set --reset");
    assert!(done && text.contains("of the firmware") && text.contains("100 frames/s"), "{text}");
    assert_eq!(session.lock().expect("no panic").setup(), Some(&testkit::SETUP));
}

/// The restart after the size was set has failed.
#[test]
fn a_size_that_is_not_in_force_yet_is_shown_as_such_and_can_be_set_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let stored = Settings { scale: 39.0 / 42.0, ..Settings::of(&testkit::SETUP) };
    let (address, _session) = insole_with(Some(stored));
    let run = |arguments: &str| run_insole(folder.path(), address, arguments);
    let pending = "in force once the insole restarts";
    let (done, text, _) = run("show");
    assert!(done && text.contains("92.9 %") && text.contains(pending), "{text}");
    let (done, text, error) = run("set --size 39");
    assert!(done && text.contains("92.9 %") && !text.contains(pending), "{text}{error}");
    let (done, _, text) = run("set --size 39");
    assert!(!done && text.contains("nothing to change"), "{text}");
}

/// The restart after the settings of a host were removed has failed: the insole uses them until its next start.
#[test]
fn removed_settings_that_are_still_in_use_are_neither_shown_as_those_of_the_firmware_nor_stored_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let (address, session) = insole();
    let run = |arguments: &str| run_insole(folder.path(), address, arguments);
    let (done, text, error) = run("set --rate 200");
    assert!(done && text.contains("200 frames/s"), "{text}{error}");
    let stream = TcpStream::connect(address).expect("the insole listens");
    stream.set_read_timeout(Some(READ_TIMEOUT)).expect("a valid timeout");
    let mut client = Client::connect(Framed::new(stream), ReconnectPolicy::STREAM.answer).expect("a session");
    client.set_settings(None).expect("the insole stores them");
    drop(client);
    let (done, text, _) = run("show");
    assert!(done && text.contains("those of the firmware, in force once the insole restarts"), "{text}");
    assert!(!text.contains("200 frames/s"), "{text}");
    let (done, text, error) = run("set --size 40");
    assert!(done && text.contains("95.2 %"), "{text}{error}");
    let setup = *session.lock().expect("no panic").setup().expect("it has a layout");
    assert_eq!(setup.period_us, testkit::SETUP.period_us);
}

/// The restart after another rule was set has failed. The insole would adopt this rule at its next start, and then could not
/// use the parameters that it received before it.
#[test]
fn a_rule_that_is_not_in_force_yet_is_replaced_by_that_of_the_parameters() {
    let folder = tempfile::tempdir().expect("a folder");
    let stored = Settings { contact: ContactRule::COVERED, ..Settings::of(&testkit::SETUP) };
    let (address, session) = insole_with(Some(stored));
    let identified = Identified {
        filter: DIRECT.into(),
        contact: testkit::SETUP.contact,
        side: "left".into(),
        steps: 31,
        regions: vec![Region::Heel],
    };
    let parameters =
        Parameters { personal: true, identified: Some(identified), ..Parameters::typical(InsoleSize::default()) };
    std::fs::write(folder.path().join("params.toml"), parameters.to_toml()).expect("written");
    succeed(folder.path(), &format!("push params.toml --tcp {address}"));
    // The insole restarts for this change.
    let (done, text, error) = run_insole(folder.path(), address, "set --rate 200");
    assert!(done, "{text}{error}");
    let setup = *session.lock().expect("no panic").setup().expect("it has a layout");
    assert_eq!(setup.contact, testkit::SETUP.contact);
}

#[test]
fn a_note_states_that_parameters_remain_in_use_if_the_size_changes() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let (address, _session) = insole();
    let has_note = |arguments: &str| {
        let (done, _, stderr) = run_insole(path, address, arguments);
        assert!(done, "{arguments}: {stderr}");
        stderr.contains("the size has changed, and the parameters on the insole remain in use")
    };
    assert!(!has_note("set --size 41"), "the insole has no parameters");
    succeed(path, "typical --size 41 --out params.toml");
    succeed(path, &format!("push params.toml --tcp {address}"));
    assert!(!has_note("set --rate 200"), "the size is unchanged");
    assert!(has_note("set --size 39"));
    assert!(has_note("set --reset"));
}

#[test]
fn bad_parameters_are_refused_before_anything_is_sent() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    let (address, session) = insole();
    succeed(path, "typical --out params.toml");
    let good = std::fs::read_to_string(path.join("params.toml")).expect("parameters");
    for (text, words) in [
        (good.replacen("k_n_m3 = ", "k_n_m3 = 1e13 # ", 1), ["regions.heel", "line 12", "more than 1e9"]),
        (good.replacen("\nm = ", "\nm = 11 # ", 1), ["regions.heel", "line 12", "up to 10"]),
        (good.replacen("subject = ", "subject ", 1), ["bad.toml", "line 9", "subject"]),
        // A control character in a text that the program prints would have an effect on the terminal.
        (good.replacen("subject", "\"\\u001b[2J\" = 1\nsubject", 1), ["bad.toml", "line 9", "unknown field ` [2J`"]),
    ] {
        std::fs::write(path.join("bad.toml"), text).expect("written");
        fail(path, &format!("push bad.toml --tcp {address}"), 1, &words);
        fail(path, "show bad.toml", 1, &words);
    }
    assert_eq!(*session.lock().expect("no panic").tissue(), Tissue::NONE);
}

/// The file may contain personal parameters: one of its values may be damaged, or a newer program may have written it.
#[test]
fn a_file_that_cannot_be_read_as_parameters_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "typical --out params.toml");
    let good = std::fs::read_to_string(path.join("params.toml")).expect("parameters");
    for (text, reason) in [
        (good.replacen("k_n_m3 = ", "k_n_m3 = 1e13 # ", 1), "regions.heel"),
        (good.replacen("version = 1", "version = 2", 1), "version 2"),
    ] {
        std::fs::write(path.join("existing.toml"), &text).expect("written");
        for command in ["typical --out existing.toml", "pull --out existing.toml --tcp 127.0.0.1:1"] {
            fail(path, command, 1, &["existing.toml", reason, "name another file with --out", "remove this one"]);
        }
        assert_eq!(std::fs::read_to_string(path.join("existing.toml")).expect("a file"), text);
    }
    std::fs::write(path.join("empty.toml"), "").expect("written");
    succeed(path, "typical --out empty.toml");
}

#[cfg(unix)]
#[test]
fn output_is_written_to_the_target_of_a_link_and_to_a_pipe() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "typical --size 40 --out target.toml");
    let before = std::fs::read(path.join("target.toml")).expect("a file");
    std::os::unix::fs::symlink("target.toml", path.join("link.toml")).expect("a link");
    succeed(path, "typical --size 41 --out link.toml");
    assert!(path.join("link.toml").is_symlink());
    assert!(std::fs::read(path.join("target.toml")).expect("a file") != before);
    let text = succeed(path, "typical --out /dev/stdout");
    assert!(text.contains("[regions.heel]") && text.contains("wrote /dev/stdout"), "{text}");
}

#[test]
fn without_a_file_or_an_insole_the_remedy_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path();
    succeed(path, "typical --out params.toml");
    for command in ["push params.toml", "pull --out pulled.toml", "show"] {
        fail(path, &format!("{command} --tcp 127.0.0.1:1"), 1, &["127.0.0.1:1", "is the insole"]);
        fail(path, &format!("{command} --serial /dev/nowhere"), 1, &["/dev/nowhere"]);
        fail(path, command, 2, &["--tcp", "--serial"]);
    }
    for command in ["push nowhere.toml --tcp 127.0.0.1:1", "show nowhere.toml"] {
        fail(path, command, 1, &["nowhere.toml"]);
    }
    fail(path, "show params.toml --tcp 127.0.0.1:1", 2, &["cannot be used with"]);
    assert!(!path.join("pulled.toml").exists());
}

#[test]
fn an_insole_is_named_calibrated_and_shown() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (address, session) = insole();
    let run = |arguments: &str| run_insole(folder, address, arguments);
    let (done, text, _) = run("name --side right --serial-number P-0001");
    assert!(done && text.contains("right foot, serial number P-0001"), "{text}");
    let (done, text, _) = run("name --side left");
    assert!(done && text.contains("left foot, serial number P-0001"), "{text}");
    for (arguments, words) in [
        ("name", "nothing to change"),
        ("name --serial-number ABCDEFGHIJKLMNOPQ", "up to 16"),
        ("calibrate absent.csv", "absent.csv"),
    ] {
        let (done, _, text) = run(arguments);
        assert!(!done && text.contains(words), "{arguments}: {text}");
    }

    let write = |lines: &[String]| {
        std::fs::write(folder.join("cells.csv"), format!("cell,offset,gain\n{}", lines.join("\n"))).expect("written");
    };
    let cells = testkit::hello().cells;
    let good: Vec<String> = (0..cells).map(|cell| format!("{cell},{},1.5", 100 + cell)).collect();
    for (index, line, words) in [
        (3, "4,100,1", "cells must be in order"),
        (5, "5,100,11", "gain 11"),
        (6, "6,65000,1", "below half"),
        (7, "7,x,1", "cell 7"),
    ] {
        let mut bad = good.clone();
        bad[index] = line.into();
        write(&bad);
        let (done, _, text) = run("calibrate cells.csv");
        assert!(!done && text.contains(words), "{line}: {text}");
    }
    write(&good[1..]);
    assert!(run("calibrate cells.csv").2.contains("cells must be in order"));
    write(&good[..10]);
    assert!(run("calibrate cells.csv").2.contains("10 cells, but the insole has 200"));
    write(&good);
    let (done, text, stderr) = run("calibrate cells.csv");
    let mut id = CalibrationId::new();
    id.add(&(0..cells).map(|cell| CellCalibration { offset: 100 + cell, gain: 1.5 }).collect::<Vec<_>>());
    assert!(done && text.contains(&format!("calibration {:08x}", id.id())), "{text} {stderr}");
    assert_eq!(session.lock().expect("no panic").identity().calibration_id, id.id());
    let (done, text, _) = run("show");
    assert!(done && text.contains("P-0001") && text.contains("steps, load bouts and alerts so far"), "{text}");
    assert!(text.contains("the insole is not worn") && text.contains("scanning 0.0 %"), "{text}");
    assert!(run("restart").0);
}

#[test]
fn alerts_are_set_shown_snoozed_and_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (address, session) = insole();
    let rules = || *session.lock().expect("no panic").alert_rules();
    let (succeeded, shown, _) = run_insole(folder.path(), address, "alerts");
    assert!(succeeded && shown.contains("alerts: off") && shown.contains("4.7 kPa for 95 % of 15 minutes"), "{shown}");
    let set = "alerts --on --window 20 --pause 30 --dose 800 --region heel --region hallux";
    let (succeeded, shown, _) = run_insole(folder.path(), address, set);
    assert!(succeeded && shown.contains("regions: Heel, Hallux") && shown.contains("800 kPa s"), "{shown}");
    let expected = AlertRules {
        limits: LoadLimits { window_s: 1200, ..LoadLimits::DEFAULT },
        pause_s: 1800,
        dose_kpa_s: 800.0,
        regions: 0b10_0001,
        ..AlertRules::RECOMMENDED
    };
    assert_eq!(rules(), expected);
    for (wrong, reason) in [
        ("alerts --ends 95", "--ends above 0 % and below --begins"),
        ("alerts --sustained-pressure 0.5", "pressures must be 1 to 2000 kPa"),
        ("alerts --region knee", "the regions are heel"),
        ("alerts --window 61", "61 is not in 1..=60"),
        ("alerts --on --off", "cannot be used with"),
    ] {
        let (succeeded, _, stderr) = run_insole(folder.path(), address, wrong);
        assert!(!succeeded && stderr.contains(reason), "{wrong}: {stderr}");
        assert_eq!(rules(), expected, "{wrong}");
    }
    let (succeeded, shown, _) = run_insole(folder.path(), address, "alerts --snooze 25");
    assert!(succeeded && shown.contains("no alerts for another 25 minutes") && shown.contains("4321 steps"), "{shown}");
    assert!(run_insole(folder.path(), address, "alerts --off").0);
    assert_eq!(rules(), AlertRules { per_day: 0, ..expected });
}

#[test]
fn the_result_of_a_measured_baseline_is_shown() {
    let folder = tempfile::tempdir().expect("a folder");
    let (address, _session) = insole();
    let (succeeded, shown, _) = run_insole(folder.path(), address, "zero");
    assert!(succeeded, "{shown}");
    for text in ["baselines of 17 cells", "Heel 3.1 N", "2 cells of P.midfoot read more than 13 kPa"] {
        assert!(shown.contains(text), "{shown}");
    }
}
