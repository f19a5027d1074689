//! Tests `plantar update` with a simulated insole on the network. It runs the code of the firmware's session and update on a
//! simulated flash chip, and the code of the bootloader, which swaps the images.

use embassy_futures::block_on;
use embassy_sync::mutex::Mutex as AsyncMutex;
use emulation::ACTIVE_IMAGE;
use emulation::FLASH_BYTES;
use firmware_image::{Image, SigningKey};
use plantar::protocol::session::{Command, CommandResult, Session};
use plantar::protocol::update::{CHUNK, Header, Progress};
use plantar::protocol::{self, Decoder, Hello, MAX_FRAME, MAX_MESSAGE, Refusal, Status, ToDevice};
use plantar::storage::boot::{Blocking, swap_if_due};
use plantar::storage::flash_map::HEADER;
use plantar::storage::partition::Partition;
use plantar::storage::update::{DEVELOPMENT_KEY_ID, Update, confirm};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::{self, Output};
use std::sync::{Arc, Mutex};
use testkit::nor_flash::NorFlashChip;

const OLD: &str = "1.2.3";
const NEW: &str = "1.3.0";

/// The key whose signature the insole accepts.
fn secret() -> SigningKey {
    SigningKey::from_bytes(&[9; 32])
}

/// A signed image for a board, with arbitrary contents.
fn image(board: &str, version: &str, secret: &SigningKey) -> Image {
    let mut bytes: Vec<u8> = (0..40 * CHUNK).map(|i| (i * i / 16) as u8).collect();
    let header = Header::new(board, version).bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, secret).expect("it has a header")
}

/// The behaviour of the new image during its trial.
#[derive(Clone, Copy, PartialEq)]
enum Trial {
    Passes,
    Crashes,
}

/// An insole that serves one host after the other. An accepted update ends the session, and the image that runs after the
/// restart serves the next host.
struct Insole {
    chip: NorFlashChip,
    trial: Trial,
    /// If true, the insole restarts before it has sent that it accepted the image.
    is_answer_lost: bool,
}

impl Insole {
    /// Starts an insole that runs the old image. Returns its address and its state.
    fn start(trial: Trial) -> (SocketAddr, Arc<Mutex<Self>>) {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let mut chip = NorFlashChip::new(FLASH_BYTES);
        let old = image("test", OLD, &secret());
        chip.bytes[ACTIVE_IMAGE.start as usize..][..old.bytes().len()].copy_from_slice(old.bytes());
        let insole = Arc::new(Mutex::new(Self { chip, trial, is_answer_lost: false }));
        let shared = insole.clone();
        std::thread::spawn(move || {
            for mut host in listener.incoming().map(|host| host.expect("a host")) {
                shared.lock().expect("no panic").serve(&mut host);
            }
        });
        (address, insole)
    }

    /// The header of the image that runs.
    fn running(&self) -> Header {
        let offset = (ACTIVE_IMAGE.start + HEADER) as usize;
        Header::read(self.chip.bytes[offset..].first_chunk().expect("the chip is larger")).expect("a valid header")
    }

    /// Runs the bootloader, which swaps the images if necessary.
    fn boot(&mut self) {
        let chip = AsyncMutex::new(&mut self.chip);
        let active = Blocking(Partition::<_, CHUNK>::new(&chip, ACTIVE_IMAGE));
        swap_if_due(&chip, active).expect("the chip works");
    }

    /// Serves a host until it disconnects or the insole restarts.
    fn serve(&mut self, host: &mut (impl Read + Write)) {
        let (mut session, mut update, mut decoder) = (Session::new(), Update::new(), Decoder::new());
        let mut received = [0; 64];
        let (running, key) = (self.running(), secret().verifying_key().to_bytes());
        let hello = Hello { firmware: running.version().try_into().expect("it is short"), ..testkit::hello() };
        // Until the update, the status reports the development key, about which `plantar update` warns.
        let update_key = if running.version() == OLD { DEVELOPMENT_KEY_ID } else { 0 };
        let status = Status { update_key, ..Status::default() };
        let mut accepted = false;
        while !accepted && let Ok(count @ 1..) = host.read(&mut received) {
            for &byte in &received[..count] {
                if let Some(message) = decoder.push(byte).and_then(protocol::decode::<ToDevice>) {
                    session.receive(message, 0);
                }
            }
            if let Some(Command::Update(request)) = session.command() {
                let progress = block_on(update.handle(&mut self.chip, &running, &key, &request));
                accepted = progress == Ok(Progress::Accepted);
                session.complete(progress.map(CommandResult::Update).map_err(Refusal::Update));
                if accepted && self.is_answer_lost {
                    break;
                }
            }
            let (mut buffer, mut framed) = ([0; MAX_MESSAGE], [0; MAX_FRAME]);
            while let Some(message) = session.next(&hello, || status, &mut buffer) {
                let len = protocol::frame(message, &mut framed);
                host.write_all(&framed[..len]).expect("the host is connected");
            }
        }
        if accepted {
            self.boot();
            match self.trial {
                Trial::Passes => {
                    let running = self.running();
                    block_on(confirm(&mut self.chip, &running)).expect("the chip works");
                }
                Trial::Crashes => self.boot(),
            }
        }
    }
}

/// Runs `plantar update`.
fn update(file: &Path, address: SocketAddr) -> Output {
    process::Command::new(env!("CARGO_BIN_EXE_plantar"))
        .arg("update")
        .arg(file)
        .args(["--tcp", &address.to_string()])
        .output()
        .expect("the program starts")
}

/// Asserts that an update fails with a message that contains all of `words`.
fn fail(file: &Path, address: SocketAddr, words: &[&str]) {
    let output = update(file, address);
    let text = String::from_utf8(output.stderr).expect("text");
    assert_eq!(output.status.code(), Some(1), "{text}");
    for word in words {
        assert!(text.contains(word), "no \"{word}\" in: {text}");
    }
}

#[test]
fn a_signed_image_is_sent_and_the_new_version_is_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("new.bin");
    let (address, insole) = Insole::start(Trial::Passes);
    let new = image("test", NEW, &secret());
    std::fs::write(&file, new.file()).expect("written");
    let output = update(&file, address);
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{text} {}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains(&format!("runs {OLD}")) && text.contains(&format!("runs {NEW} (before: {OLD})")), "{text}");
    assert!(insole.lock().expect("no panic").chip.bytes[ACTIVE_IMAGE.start as usize..].starts_with(new.bytes()));
    let warnings = String::from_utf8(output.stderr).expect("text");
    assert!(warnings.contains("anyone can sign an update"), "{warnings}");
    let output = update(&file, address);
    assert!(output.status.success() && !String::from_utf8_lossy(&output.stderr).contains("anyone can sign"));
}

#[test]
fn an_update_is_complete_although_its_last_answer_was_lost() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("new.bin");
    let (address, insole) = Insole::start(Trial::Passes);
    insole.lock().expect("no panic").is_answer_lost = true;
    std::fs::write(&file, image("test", NEW, &secret()).file()).expect("written");
    let output = update(&file, address);
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success(), "{text} {}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("did not answer") && !text.contains("signature is valid"), "{text}");
    assert!(text.contains(&format!("runs {NEW} (before: {OLD})")), "{text}");
}

#[test]
fn an_image_that_is_swapped_back_is_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("new.bin");
    let (address, insole) = Insole::start(Trial::Crashes);
    std::fs::write(&file, image("test", NEW, &secret()).file()).expect("written");
    fail(&file, address, &["swapped back", OLD, "new.bin"]);
    assert_eq!(insole.lock().expect("no panic").running().version(), OLD);
}

#[test]
fn an_invalid_image_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("image.bin");
    let (address, insole) = Insole::start(Trial::Passes);
    let good = image("test", NEW, &secret()).file();
    let other_key = image("test", NEW, &SigningKey::from_bytes(&[1; 32])).file();
    let mut flipped = good.clone();
    flipped[777] ^= 4;
    for (contents, words) in [
        (image("other", NEW, &secret()).file(), &["other", "test", "choose"][..]),
        (image("test", "1.2.2", &secret()).file(), &["1.2.2", OLD, "newer"]),
        (other_key, &["signed", "manufacturer"]),
        (flipped, &["damaged", "image.bin"]),
        (good[..good.len() - 300].to_vec(), &["cut short", "image.bin"]),
        (b"not an image".to_vec(), &["image.bin", "cargo xtask image"]),
    ] {
        std::fs::write(&file, contents).expect("written");
        fail(&file, address, words);
    }
    assert_eq!(insole.lock().expect("no panic").running().version(), OLD);
    fail(&folder.path().join("nowhere.bin"), address, &["nowhere.bin"]);
    std::fs::write(&file, good).expect("written");
    fail(&file, "127.0.0.1:1".parse().expect("an address"), &["127.0.0.1:1", "is the insole"]);
}
