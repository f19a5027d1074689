//! Updates with management tools (MCUmgr): with single messages to the firmware's loops in virtual time, and with the Python
//! package `smpclient` and the real firmware in QEMU. The environment variable `PLANTAR_FIRMWARE` contains the path of the
//! firmware, `PLANTAR_SMP` that of a Python interpreter with `smpclient`, and `PLANTAR_PYTHON` that of the interpreter that
//! runs the simulated radio.

// Python opens the link of a board as two FIFOs, which only Unix has.
#![cfg(unix)]

use crate::common::{TIMEOUT, connect, smp};
use crate::phones::RadioSimulation;
use crate::updates;
use crate::updates::{Insole, development, firmware_with};
use ciborium::{Value, cbor};
use client::Client;
use emulator::Board;
use firmware_image::{Image, SigningKey};
use mcumgr::{HEAD, line, message_bytes};
use plantar::checksum::crc32;
use plantar::protocol::gatt::GattChannel;
use plantar::protocol::mcuboot::{FRONT, TRAILER, read_trailer};
use plantar::protocol::update::{CHUNK, Header};
use serde_json::{Value as Json, json};
use std::cell::RefCell;
use std::path::Path;
use std::process::Command;
use std::rc::Rc;
use testkit::host::{Link, LinkKind};
use testkit::insole::{BOARD, Defect, INITIAL_VERSION, image};
use testkit::virtual_time::{now_us, with_origin};
use testkit::world::{SharedWorld, World};

/// Version of the image that a simulated insole runs at first.
const OLD: &str = INITIAL_VERSION;
/// Version of the image that a tool sends to a simulated insole.
const NEW: &str = "99.0.1";
/// Longest time until an answer, us.
const ANSWER_US: u64 = 60_000_000;
/// The group of the commands for the operating system.
const OS: u8 = 0;
/// The group of the commands for images.
const IMAGES: u8 = 1;

/// A management tool that is connected to a simulated insole.
struct Tool {
    world: SharedWorld,
    over: LinkKind,
    sequence: u8,
}

impl Tool {
    fn new(over: LinkKind) -> Self {
        let world = Rc::new(RefCell::new(World::new(1, 100.0)));
        let mut tool = Self { world, over, sequence: 0 };
        tool.connect();
        tool
    }

    /// Waits until the insole runs, and connects to it.
    fn connect(&mut self) {
        let mut world = self.world.borrow_mut();
        world.run_for(2_000_000);
        if self.over == LinkKind::Bluetooth {
            world.insoles[0].radio.borrow_mut().set_connected(true);
            world.run_for(10_000);
        }
    }

    /// Number of boots of the insole so far.
    fn boots(&self) -> usize {
        self.world.borrow().insoles[0].boots.len()
    }

    /// Sends a request to write or to read, and returns the fields of its answer.
    fn request(&mut self, is_write: bool, group: u8, command: u8, fields: Value) -> Value {
        self.sequence = self.sequence.wrapping_add(1);
        let mut body = Vec::new();
        ciborium::into_writer(&fields, &mut body).expect("writing to a vector does not fail");
        let [high, low] = (body.len() as u16).to_be_bytes();
        let kind = 1 << 3 | if is_write { 2 } else { 0 };
        let message = [&[kind, 0, high, low, 0, group, self.sequence, command], &body[..]].concat();
        let answer = match self.over {
            LinkKind::Serial => self.over_serial(&message),
            LinkKind::Bluetooth => self.over_bluetooth(&message),
        };
        let (head, body) = answer.split_at(HEAD);
        assert_eq!(head, [kind + 1, 0, head[2], head[3], 0, group, self.sequence, command]);
        ciborium::from_reader(body).expect("the answer is valid CBOR")
    }

    fn over_serial(&self, message: &[u8]) -> Vec<u8> {
        let mut lines = [0; line::MAX_LINES];
        let len = line::wrap(message, &mut lines);
        let mut world = self.world.borrow_mut();
        let cable = world.insoles[0].cable.clone();
        cable.borrow_mut().to_host.clear();
        cable.borrow_mut().write(&lines[..len]);
        let mut answer = Vec::new();
        let is_answered = world.run(now_us() + ANSWER_US, |_| {
            let mut received: Vec<u8> = cable.borrow().to_host.iter().copied().collect();
            if let line::Lines::Message(message) = line::unwrap(&mut received) {
                answer = message.to_vec();
            }
            !answer.is_empty()
        });
        assert!(is_answered, "no answer to {message:02x?}");
        answer
    }

    fn over_bluetooth(&self, message: &[u8]) -> Vec<u8> {
        self.write(message);
        let mut world = self.world.borrow_mut();
        let radio = world.insoles[0].radio.clone();
        let mut answer = Vec::new();
        let is_answered = world.run(now_us() + ANSWER_US, |_| {
            for (channel, value) in radio.borrow_mut().to_central.drain(..) {
                assert_eq!(channel, GattChannel::Management);
                answer.extend(value);
            }
            message_bytes(&answer) == Some(answer.len())
        });
        assert!(is_answered, "no answer to {message:02x?}");
        answer
    }

    /// Writes a message to the characteristic of management tools.
    fn write(&self, message: &[u8]) {
        let (server, origin_us) = {
            let world = self.world.borrow();
            let radio = world.insoles[0].radio.borrow();
            (radio.server.clone().expect("the insole is on"), radio.origin_us)
        };
        // The longest value with an ATT MTU of 247.
        for value in message.chunks(244) {
            with_origin(origin_us, || server.write(GattChannel::Management, value)).expect("the value is accepted");
        }
    }

    /// Sends a part of a file; returns the next offset, or the code of the refusal. `upgrade` requires the image to be newer
    /// than the running one.
    fn part(&mut self, file: &[u8], offset: usize, len: usize, upgrade: bool) -> Result<usize, u64> {
        let data = Value::Bytes(file[offset..file.len().min(offset + len)].to_vec());
        let fields = match offset {
            // The insole uses `sha` only to recognise the file of the previous transfer, whether that was interrupted or
            // complete. So any checksum suffices, here a repeated CRC-32.
            0 => cbor!({
                "image" => 0, "len" => file.len(), "off" => 0, "sha" => Value::Bytes(crc32(file).to_le_bytes().repeat(8)),
                "data" => data, "upgrade" => upgrade,
            }),
            _ => cbor!({ "off" => offset, "data" => data }),
        };
        let answer = self.request(true, IMAGES, 1, fields.expect("the fields can be encoded"));
        refusal(&answer).map_or_else(|| Ok(number(&answer, "off") as usize), Err)
    }

    /// Sends a whole file, until a part is refused; returns the code of the refusal.
    fn upload(&mut self, file: &[u8]) -> Result<(), u64> {
        let mut offset = self.part(file, 0, 180, false)?;
        while offset < file.len() {
            let next = self.part(file, offset, 256, false)?;
            assert!(next > offset, "no progress at {offset}");
            offset = next;
        }
        Ok(())
    }

    /// Marks the image with the SHA-256 `name` for the next start, or confirms it if `confirm` is true; `None` stands for the
    /// running image. Returns the states of all images, or the code of the refusal.
    fn set(&mut self, name: Option<[u8; 32]>, confirm: bool) -> Result<Vec<State>, u64> {
        let fields = match name {
            Some(name) => cbor!({ "hash" => Value::Bytes(name.to_vec()), "confirm" => confirm }),
            None => cbor!({ "confirm" => confirm }),
        };
        let answer = self.request(true, IMAGES, 0, fields.expect("the fields can be encoded"));
        refusal(&answer).map_or_else(|| Ok(states(&answer)), Err)
    }

    /// The states of all images.
    fn states(&mut self) -> Vec<State> {
        states(&self.request(false, IMAGES, 0, Value::Map(Vec::new())))
    }

    /// Restarts the insole by a request, and connects again.
    fn reset(&mut self) {
        let boots = self.boots();
        assert_eq!(self.request(true, OS, 5, Value::Map(Vec::new())), Value::Map(Vec::new()));
        self.connect();
        assert_eq!(self.boots(), boots + 1);
    }
}

/// The state of an image: slot, version, SHA-256, and whether it is pending, confirmed and active.
type State = (u64, String, Vec<u8>, bool, bool, bool);

fn field<'v>(map: &'v Value, name: &str) -> Option<&'v Value> {
    map.as_map().expect("a map").iter().find(|(key, _)| key.as_text() == Some(name)).map(|(_, value)| value)
}

fn number(map: &Value, name: &str) -> u64 {
    let number = field(map, name).and_then(Value::as_integer).unwrap_or_else(|| panic!("no {name} in {map:?}"));
    number.try_into().expect("the number is not negative")
}

/// The code of a refusal within the group of images; `None` for any other answer.
///
/// 3: no transfer was begun; 4: no valid trailer; 5: damaged, or wrong signature; 8: no image with this SHA-256; 22: no valid
/// header; 25: for another board; 27: older, or not newer although `upgrade` requires it; 28: an image is on trial, or marked
/// for the next start; 30: wrong length; 32: the image cannot be confirmed, because the checks of its trial are not complete,
/// it does not run, or the chip refused the confirmation; 33: the image already runs.
fn refusal(answer: &Value) -> Option<u64> {
    let error = field(answer, "err")?;
    assert_eq!(number(error, "group"), u64::from(IMAGES));
    Some(number(error, "rc"))
}

/// The states of the images in an answer.
fn states(answer: &Value) -> Vec<State> {
    let images = field(answer, "images").and_then(Value::as_array).expect("a list of images");
    let state = |image: &Value| {
        let flag = |name| field(image, name).and_then(Value::as_bool).expect("a flag");
        let version = field(image, "version").and_then(Value::as_text).expect("a text");
        let name = field(image, "hash").and_then(Value::as_bytes).expect("bytes");
        let flags = (flag("pending"), flag("confirmed"), flag("active"));
        (number(image, "slot"), version.into(), name.clone(), flags.0, flags.1, flags.2)
    };
    images.iter().map(state).collect()
}

/// The SHA-256 that names the image in a file.
fn name(file: &[u8]) -> [u8; 32] {
    *read_trailer(&file[file.len() - TRAILER..]).expect("the file has a trailer").0
}

/// The expected state of the running image if it has this version and no defect.
fn running(version: &str, confirmed: bool) -> State {
    (0, version.into(), name(&image(version, Defect::None).file()).to_vec(), false, confirmed, true)
}

#[test]
fn an_image_is_uploaded_tested_and_confirmed_over_both_links() {
    let file = image(NEW, Defect::None).file();
    for over in [LinkKind::Serial, LinkKind::Bluetooth] {
        let mut tool = Tool::new(over);
        assert_eq!(tool.states(), [running(OLD, true)]);
        assert_eq!(tool.upload(&file), Ok(()));
        let mut received = (1, NEW.to_string(), name(&file).to_vec(), false, false, false);
        assert_eq!(tool.states(), [running(OLD, true), received.clone()]);
        received.3 = true;
        assert_eq!(tool.set(Some(name(&file)), false), Ok(vec![running(OLD, true), received.clone()]));
        // The same request again changes nothing; another transfer is refused now.
        assert_eq!(tool.set(Some(name(&file)), false), Ok(vec![running(OLD, true), received]));
        assert_eq!(tool.part(&file, 0, 180, false), Err(28));
        tool.reset();
        assert_eq!(tool.states(), [running(NEW, false)]);
        // The answer waits for the checks of the trial.
        assert_eq!(tool.set(Some(name(&file)), true), Ok(vec![running(NEW, true)]));
        let trial_us = now_us() - tool.world.borrow().insoles[0].boots[1].from_us;
        assert!((9_000_000..20_000_000).contains(&trial_us), "{trial_us}");
        assert_eq!(tool.set(None, true), Ok(vec![running(NEW, true)]));
        tool.world.borrow_mut().insoles[0].cut_power(500_000);
        tool.connect();
        assert_eq!(tool.states(), [running(NEW, true)]);
    }
}

#[test]
fn an_unmarked_image_does_not_run_and_an_unconfirmed_one_is_replaced_by_the_previous_one() {
    let file = image(NEW, Defect::None).file();
    let mut tool = Tool::new(LinkKind::Serial);
    assert_eq!(tool.upload(&file), Ok(()));
    tool.reset();
    assert_eq!(tool.states(), [running(OLD, true)], "an image that is not marked does not run");
    assert_eq!(tool.upload(&file), Ok(()));
    tool.set(Some(name(&file)), false).expect("the image is accepted");
    tool.reset();
    assert_eq!(tool.states(), [running(NEW, false)]);
    tool.reset();
    assert_eq!(tool.states(), [running(OLD, true)]);
    // An image that cannot store data is never confirmed, and the request of the tool is refused.
    let failing = image(NEW, Defect::Storage).file();
    assert_eq!(tool.upload(&failing), Ok(()));
    tool.set(Some(name(&failing)), false).expect("the image is accepted");
    tool.reset();
    assert_eq!(tool.set(None, true), Err(32));
}

/// The image passes the checks of its trial, but the chip cannot store its confirmation.
#[test]
fn a_confirmation_that_the_chip_refuses_is_refused_and_can_be_repeated() {
    let file = image(NEW, Defect::None).file();
    let mut tool = Tool::new(LinkKind::Serial);
    assert_eq!(tool.upload(&file), Ok(()));
    tool.set(Some(name(&file)), false).expect("the image is accepted");
    tool.reset();
    let refuse_changes = |tool: &Tool, refuses: bool| {
        tool.world.borrow().insoles[0].chip.0.borrow_mut().refuses_changes = refuses;
    };
    refuse_changes(&tool, true);
    assert_eq!(tool.set(None, true), Err(32));
    assert_eq!(tool.states(), [running(NEW, false)]);
    refuse_changes(&tool, false);
    assert_eq!(tool.set(None, true), Ok(vec![running(NEW, true)]));
}

/// The file of an image without a defect, with this header and signed with this key.
fn signed(header: &Header, key: &SigningKey) -> Vec<u8> {
    updates::signed(image(NEW, Defect::None).bytes().to_vec(), header, key).file()
}

#[test]
fn images_that_must_not_run_are_refused_and_a_client_connects_afterwards() {
    let key = development();
    let file = image(NEW, Defect::None).file();
    let mut tool = Tool::new(LinkKind::Serial);
    // Signed with another key; everything else is valid. The insole discards the image.
    let other_key = signed(&Header::new(BOARD, NEW), &SigningKey::from_bytes(&[1; 32]));
    assert_eq!(tool.upload(&other_key), Ok(()));
    assert_eq!(tool.set(Some(name(&other_key)), false), Err(5));
    assert_eq!(tool.states(), [running(OLD, true)]);
    // Older, of the same version although a newer one is required, and for another board.
    assert_eq!(tool.upload(&signed(&Header::new(BOARD, "0.1.9"), &key)), Err(27));
    assert_eq!(tool.part(&image(OLD, Defect::None).file(), 0, 180, true), Err(27));
    assert_eq!(tool.upload(&signed(&Header::new("other", NEW), &key)), Err(25));
    // The file has the header of a newer image than the one that follows: its SHA-256 does not match.
    let mut pretended = signed(&Header::new(BOARD, "0.1.9"), &key);
    pretended[..FRONT].copy_from_slice(&file[..FRONT]);
    assert_eq!(tool.upload(&pretended), Err(5));
    // Damaged in the image, in the signature, in the structure of the trailer, and in the magic number and the length of the
    // image in the header.
    for (at, code) in [(2000, 5), (file.len() - 50, 5), (file.len() - 140, 4), (3, 22), (13, 30)] {
        let mut damaged = file.clone();
        damaged[at] ^= 1;
        let refused = tool.upload(&damaged).and_then(|()| tool.set(Some(name(&file)), false).map(drop));
        assert_eq!(refused, Err(code), "byte {at}");
    }
    // A file without its last byte, and a first part that is shorter than the headers.
    assert_eq!(tool.upload(&file[..file.len() - 1]), Err(30));
    assert_eq!(tool.part(&file, 0, FRONT - 1, false), Err(22));
    // An unknown SHA-256, that of the running image, and that of an image that does not run yet.
    assert_eq!(tool.set(Some([7; 32]), false), Err(8));
    assert_eq!(tool.set(Some([7; 32]), true), Err(8));
    assert_eq!(tool.set(Some(name(&image(OLD, Defect::None).file())), false), Err(33));
    assert_eq!(tool.upload(&file), Ok(()));
    assert_eq!(tool.set(Some(name(&file)), true), Err(32), "an image that does not run yet must not be confirmed");
    // Noise, then the session of a client.
    tool.world.borrow_mut().insoles[0].cable.borrow_mut().write(&[0x55; 2000]);
    let link = Link::open(&tool.world, 0, LinkKind::Serial).expect("the cable is there");
    let mut client = Client::connect(link, TIMEOUT).expect("the insole answers");
    assert_eq!(client.hello().firmware, OLD);
    assert!(client.status().expect("the insole answers").bad_frames > 0);
    assert_eq!(tool.boots(), 1);
}

#[test]
fn repeated_and_lost_parts_do_no_harm_and_a_transfer_continues() {
    let file = image(NEW, Defect::None).file();
    let mut tool = Tool::new(LinkKind::Serial);
    assert_eq!(tool.part(&file, 500, 100, false), Err(3), "a transfer must begin with the part at offset 0");
    let first = tool.part(&file, 0, 180, false).expect("the part is accepted");
    let second = tool.part(&file, first, 200, false).expect("the part is accepted");
    for (offset, len) in [(first, second - first), (first, 10), (second + 64, 100), (file.len() - 10, 10)] {
        assert_eq!(tool.part(&file, offset, len, false), Ok(second), "part at {offset}");
    }
    // A part that overlaps the stored bytes.
    let third = tool.part(&file, second - 20, 100, false).expect("the part is accepted");
    assert_eq!(third, second + 80);
    // The first part of the same file continues its transfer. That of another file, also of the same length, begins a new one.
    let other = image(NEW, Defect::Process).file();
    assert_eq!(other.len(), file.len());
    for (begun, next) in [(&file, third), (&other, first), (&file, first)] {
        assert_eq!(tool.part(begun, 0, 180, false), Ok(next));
    }
    assert_eq!(tool.upload(&file), Ok(()));
    // The first part is repeated although the whole file was received.
    assert_eq!(tool.part(&file, 0, 180, false), Ok(file.len()));
    assert_eq!(tool.set(Some(name(&file)), false).map(|states| states.len()), Ok(2));
    // An image that is marked cannot be discarded. A discarded image cannot be marked.
    assert_eq!(refusal(&tool.request(true, IMAGES, 5, Value::Map(Vec::new()))), Some(28));
    let mut tool = Tool::new(LinkKind::Serial);
    assert_eq!(tool.upload(&file), Ok(()));
    assert_eq!(tool.request(true, IMAGES, 5, Value::Map(Vec::new())), Value::Map(Vec::new()));
    assert_eq!(tool.set(Some(name(&file)), false), Err(8));
}

#[test]
fn tools_set_the_clock_and_do_not_disturb_a_session_over_the_other_link() {
    let mut tool = Tool::new(LinkKind::Serial);
    let link = Link::open(&tool.world, 0, LinkKind::Bluetooth).expect("the insole is on");
    let mut client = Client::connect(link, TIMEOUT).expect("the insole answers");
    let clock = |text: &str| cbor!({ "datetime" => text }).expect("the fields can be encoded");
    for (set, read) in [
        ("2026-03-31T12:34:56", "2026-03-31T12:34:56"),
        ("2026-03-31T00:34:56.25+01:00", "2026-03-30T23:34:56"),
        ("2026-03-31T00:00:00-23:59", "2026-03-31T23:59:00"),
    ] {
        assert_eq!(tool.request(true, OS, 4, clock(set)), Value::Map(Vec::new()));
        assert_eq!(tool.request(false, OS, 4, Value::Map(Vec::new())), clock(read));
    }
    for wrong in [
        "2026-02-30T00:00:00",
        "1969-01-01T00:00:00",
        "2026-03-31T12:34:56+24:00",
        "2026-03-31T12:34:56-01:60",
        "2026-03-31T12:34:56+99:99",
    ] {
        let answer = tool.request(true, OS, 4, clock(wrong));
        assert_eq!(field(&answer, "err").map(|error| number(error, "rc")), Some(5), "{wrong}");
    }
    assert!(client.status().expect("the session continues").is_clock_set);
    // On the same link, the tool ends the session, and a client connects again.
    let link = Link::open(&tool.world, 0, LinkKind::Serial).expect("the cable is there");
    let mut client = Client::connect(link, TIMEOUT).expect("the insole answers");
    let echo = cbor!({ "d" => "x".repeat(mcumgr::CHUNK) }).expect("the fields can be encoded");
    assert_eq!(Some(tool.request(true, OS, 0, echo)), cbor!({ "r" => "x".repeat(mcumgr::CHUNK) }).ok());
    assert_eq!(client.reconnect(TIMEOUT).expect("the insole answers").firmware, OLD);
}

/// A tool disconnects before it receives its answer: first to an echo, which waits for the radio, then to a request for the
/// states of the images, which waits for the storage.
#[test]
fn an_answer_is_not_sent_to_another_central() {
    let mut tool = Tool::new(LinkKind::Bluetooth);
    for message in ["0a00000a00000100a1616466496e736f6c65", "0800000100010600a0"] {
        let bytes = message.as_bytes().chunks(2).map(|hex| std::str::from_utf8(hex).expect("the text is ASCII"));
        let bytes: Vec<_> = bytes.map(|hex| u8::from_str_radix(hex, 16).expect("the text is hex")).collect();
        tool.write(&bytes);
        tool.world.borrow().insoles[0].radio.borrow_mut().set_connected(false);
        tool.connect();
        tool.world.borrow_mut().run_for(1_000_000);
        assert!(tool.world.borrow().insoles[0].radio.borrow().to_central.is_empty(), "{message}");
    }
    // A request, here for a reset, is executed although its tool has disconnected.
    let boots = tool.boots();
    tool.write(&[0x0a, 0, 0, 1, 0, 0, 5, 5, 0xa0]);
    tool.world.borrow().insoles[0].radio.borrow_mut().set_connected(false);
    tool.connect();
    assert_eq!((tool.boots(), tool.states()), (boots + 1, vec![running(OLD, true)]));
}

/// Runs `smpclient` with these commands on the serial link of a board. Returns the result of each command.
fn smpclient(board: &Board, commands: &[&str]) -> Vec<Json> {
    let [to_board, from_board] = board.link_fifos();
    smpclient_over(&format!("serial:{}:{}", to_board.display(), from_board.display()), commands)
}

/// Runs `smpclient` with these commands over a link, which is the first argument of the script.
fn smpclient_over(link: &str, commands: &[&str]) -> Vec<Json> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/management.py");
    let output = Command::new(smp()).args([script, link]).args(commands).output().expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).expect("the output is text");
    lines.lines().map(|line| serde_json::from_str(line).expect("a line is JSON")).collect()
}

/// Writes the file of an image into a folder. Returns its path.
fn write(folder: &Path, name: &str, image: &Image) -> String {
    let path = folder.join(name);
    std::fs::write(&path, image.file()).expect("the file is written");
    path.to_string_lossy().into()
}

/// Writes the file of a short image that is not firmware. Returns its path.
fn write_short(folder: &Path, board: &str, version: &str, key: &SigningKey) -> String {
    let image = updates::signed(vec![0xff; 8 * CHUNK], &Header::new(board, version), key);
    write(folder, &format!("short-{board}-{version}-{}.bin", key.to_bytes()[0]), &image)
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with smpclient: cargo xtask test"]
fn smpclient_updates_the_real_firmware_over_serial() {
    let folder = tempfile::tempdir().expect("a folder");
    let key = development();
    let file = write(folder.path(), "99.0.1.bin", &firmware_with("99.0.1", &key));
    let mut insole = Insole::new();
    let board = insole.start(None, false, None);
    let results = smpclient(&board, &["parameters", "echo:Insole", "set-time:2026-03-31T12:34:56", "state"]);
    assert_eq!(results[0], json!({"buf_size": 204, "buf_count": 1}));
    assert_eq!(results[1], json!("Insole"));
    assert_eq!(results[2], json!({}));
    let version = env!("PLANTAR_VERSION");
    let running = |version: &str, hash: &Json, confirmed: bool| json!([[0, version, hash, false, confirmed, true]]);
    let before = results[3][0][2].clone();
    assert_eq!(results[3], running(version, &before, true));
    // The refused images come first: each leaves the insole as it was.
    let refused = [
        write_short(folder.path(), "emulated", "99.0.1", &SigningKey::from_bytes(&[1; 32])),
        write_short(folder.path(), "emulated", "0.0.9", &key),
        write_short(folder.path(), "wb55", "99.0.1", &key),
    ];
    let commands = ["upload", "test", "upload", "upload"];
    let commands: Vec<_> =
        commands.iter().zip([0, 0, 1, 2]).map(|(command, file)| format!("{command}:{}", refused[file])).collect();
    let results = smpclient(&board, &commands.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(results[1..], [json!({"error": 5}), json!({"error": 27}), json!({"error": 25})]);
    assert_eq!(connect(&board).hello().firmware, version);

    let (upload, test) = (format!("upload:{file}"), format!("test:{file}"));
    let results = smpclient(
        &board,
        &["name:".to_string() + &file, upload, test, "reset".into()]
            .iter()
            .map(|command| &**command)
            .collect::<Vec<_>>(),
    );
    let name = &results[0];
    assert_eq!(results[2][0], json!([0, version, before, false, true, true]));
    assert_eq!(results[2][1], json!([1, "99.0.1", name, true, false, false]));
    assert!(insole.wait(board), "the bootloader must swap the images after the restart");

    let board = insole.start(None, true, None);
    board.play();
    let results = smpclient(&board, &["state", &format!("confirm:{file}"), "state"]);
    assert_eq!(results[0], running("99.0.1", name, false));
    assert_eq!(results[1..], [running("99.0.1", name, true), running("99.0.1", name, true)]);
    insole.flash = Some(board.flash().expect("the chip can be read"));
    drop(board);
    let board = insole.start(None, false, None);
    assert_eq!(connect(&board).hello().firmware, "99.0.1");
}

#[test]
#[ignore = "needs the emulated board's firmware and Python with bumble and smpclient: cargo xtask test"]
fn smpclient_manages_the_real_firmware_over_bluetooth() {
    let folder = tempfile::tempdir().expect("a folder");
    let key = development();
    let mut radio = RadioSimulation::start();
    let port = |answer: Json| answer["port"].as_u64().expect("the simulation returns a port");
    let computer = port(radio.request(json!({"do": "computer"})));
    radio.request(json!({"do": "phone", "name": "finder", "address": "D0:00:00:00:00:01"}));
    let mut boot = |insole: &Insole, swapped: bool| {
        let hci = port(radio.request(json!({"do": "radio", "name": "left"})));
        let board = insole.start(None, swapped, Some(hci));
        let found = radio.request(json!({"do": "scan", "phone": "finder", "name": "Plantar L"}));
        (board, format!("bluetooth:{computer}:{}", found["address"].as_str().expect("an address")))
    };
    let mut insole = Insole::new();
    let (board, link) = boot(&insole, false);
    let [refused, older, accepted] = [("99.0.1", &SigningKey::from_bytes(&[1; 32])), ("0.0.9", &key), ("99.0.1", &key)]
        .map(|(version, key)| write_short(folder.path(), "emulated", version, key));
    let commands = ["upload:", "test:", "upload:", "echo:", "upload:", "test:", "erase", "reset"];
    let files = [&*refused, &refused, &older, "Insole", &accepted, &accepted, "", ""];
    let commands: Vec<_> = commands.iter().zip(files).map(|(command, file)| format!("{command}{file}")).collect();
    let commands: Vec<_> = commands.iter().map(String::as_str).collect();
    let results = smpclient_over(&link, &commands);
    assert_eq!(results[1..4], [json!({"error": 5}), json!({"error": 27}), json!("Insole")]);
    assert_eq!((&results[5][1][1], &results[5][1][3]), (&json!("99.0.1"), &json!(true)));
    assert_eq!(results[6..], [json!({"error": 28}), json!({})]);
    assert!(insole.wait(board), "the bootloader must swap the images after the restart");

    // The short image contains no program. The next one does; it runs and is confirmed.
    let image = firmware_with("99.0.2", &key);
    let file = write(folder.path(), "99.0.2.bin", &image);
    insole.flash = None;
    insole.accept(&image);
    let board = insole.start(None, false, None);
    assert!(insole.wait(board));
    let (board, link) = boot(&insole, true);
    board.play();
    let results = smpclient_over(&link, &["state", &format!("confirm:{file}")]);
    let state = |confirmed: bool| (json!("99.0.2"), json!(confirmed), json!(true));
    let seen = |states: &Json| (states[0][1].clone(), states[0][4].clone(), states[0][5].clone());
    assert_eq!((seen(&results[0]), seen(&results[1])), (state(false), state(true)));
}
