//! `plantar serve`: serves the page for a phone, with insoles that are connected to this computer.

use crate::carrier::{Ports, open_error, open_serial, open_tcp};
use crate::emulate::{EmulatedInsole, firmware, in_repository};
use crate::setup::{InsoleArgs, StanceArgs};
use anyhow::{Context, Result, bail};
use clap::Args;
use client::{Carrier, Framed, READ_TIMEOUT};
use emulation::EmulatorConfig;
use emulator::{Board, Joined, Recorded, Time};
use serve::{MAX_INSOLES, Options, Source};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Shows the live loads, steps and trends of one or two insoles in a browser, which also exports loads and steps.
///
/// Give one --serial, --tcp or --emulate per foot. Several pages can be open at the same time. Without --bind, only browsers on
/// this computer can connect. Every page that can connect receives all data.
#[derive(Args)]
pub struct Serve {
    #[command(flatten)]
    ports: Ports,
    /// Play this recording into an emulated insole, repeatedly and without end. The recordings of two feet are played together:
    /// the shorter one stays at its last frame until the longer one ends.
    #[arg(long, value_name = "RECORDING")]
    emulate: Vec<PathBuf>,
    #[command(flatten)]
    insole: InsoleArgs,
    /// The firmware file of the emulated board, from `cargo xtask build`. QEMU lets the firmware read and write your files and
    /// run programs: name only a file that you have built [default: the one in the repository of this program].
    #[arg(long, value_name = "FILE")]
    firmware: Option<PathBuf>,
    /// Write the hello messages (foot, board, firmware), live frames, steps, load bouts, alerts, counters and clock times of the
    /// insoles to this file, which must be new or empty. Other messages, such as contact ellipses, are not written; docs/live.md
    /// lists both. An insole deletes a step once the step is written to this file or, without this option, once a page has
    /// stored it. To play the file later, open the page with ?replay=URL, where URL is the address at which a web server offers
    /// the file.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Publish frames, steps, load bouts, alerts and events of each foot over the Lab Streaming Layer, to all computers in the
    /// network. This needs the library liblsl: the file LIBRARY, or one that the system finds. It also needs --record, because an
    /// insole sends further steps only once those before are stored. docs/live.md describes the streams.
    #[arg(long, value_name = "LIBRARY", num_args = 0..=1, require_equals = true, requires = "record")]
    lsl: Option<Option<PathBuf>>,
    /// TCP port of the page; with 0, a free port is chosen.
    #[arg(long, default_value_t = 7340)]
    port: u16,
    /// Accept connections on this address. With 0.0.0.0, the whole network can connect, to any address of this computer.
    #[arg(long, value_name = "ADDRESS", default_value_t = Ipv4Addr::LOCALHOST.into())]
    bind: IpAddr,
    /// Also accept connections of pages that were loaded from this web server, such as https://insoles.example. Repeat the option
    /// for several servers.
    #[arg(long, value_name = "ORIGIN")]
    origin: Vec<String>,
    /// Let pages replace the tissue parameters on the insoles, for the identification on the page, and the rules of alerts. Every
    /// page that can connect is then able to do so.
    #[arg(long)]
    accept_parameters: bool,
    /// Folder of the built page [default: tools/phone/dist in the repository of this program].
    #[arg(long, value_name = "DIR")]
    page: Option<PathBuf>,
}

/// The folder to which `cargo xtask page` builds the page.
const PAGE: &str = "tools/phone/dist";

impl Serve {
    pub fn run(&self) -> Result<()> {
        let insoles = self.ports.serial.len() + self.ports.tcp.len() + self.emulate.len();
        if !(1..=MAX_INSOLES).contains(&insoles) {
            bail!("give one --serial, --tcp or --emulate per foot: 1 or 2 in total, not {insoles}");
        }
        if self.emulate.is_empty() && self.insole.is_given() {
            bail!(
                "--params, --size, --contact-on, --contact-off, --contact-full, {} and --zero are for --emulate: set up a \
                 connected insole with `plantar params` and `plantar insole` instead",
                StanceArgs::NAMES
            );
        }
        let mut sources = Vec::new();
        for port in self.ports.serial.clone() {
            let baud = self.ports.baud;
            sources.push(source(port.clone(), move || Ok(Box::new(open_serial(&port, baud)?))));
        }
        for address in self.ports.tcp.clone() {
            sources.push(source(address.clone(), move || Ok(Box::new(open_tcp(&address)?))));
        }
        // An emulated board runs until it is dropped, so the boards are held until the program ends.
        let mut boards = Vec::new();
        let mut emulated = Vec::new();
        for path in &self.emulate {
            let parameters = self.insole.wearer.parameters()?;
            emulated.push((path, EmulatedInsole::new(path, &parameters, &self.insole)?, parameters));
        }
        // Each repetition of the recordings of both feet has a common start, because they are of one walk.
        let start = Arc::new(OnceLock::new());
        let repeated_after = emulated.iter().map(|(_, insole, _)| duration(insole)).max().unwrap_or_default();
        for (path, EmulatedInsole { recording, insole }, parameters) in emulated {
            let config = EmulatorConfig::new(insole.setup);
            let cells = insole.cells.clone();
            let period = Duration::from_micros(insole.setup.period_us.into());
            let walk = Joined::new(Recorded::new(recording, insole), period, repeated_after, start.clone());
            let board = Board::start(&firmware(self.firmware.as_deref())?, &config, &cells, Time::Real, walk)?;
            let link = board.link()?;
            let mut source = source(path.display().to_string(), move || {
                let mut link = link.try_clone()?;
                link.set_read_timeout(Some(READ_TIMEOUT))?;
                Ok(Box::new(Framed::new(link)))
            });
            source.tissue = Some(parameters.tissue());
            sources.push(source);
            boards.push(board);
        }
        let page = match &self.page {
            Some(page) => page.clone(),
            None => in_repository(&std::env::current_exe()?, PAGE, "--page")?,
        };
        let options = Options {
            listen: SocketAddr::new(self.bind, self.port),
            page,
            origins: self.origin.clone(),
            accepts_parameters: self.accept_parameters,
            record: self.record.clone(),
            lsl: self.lsl.clone(),
        };
        serve::serve(sources, &options, |address| println!("{} (Ctrl-C ends)", place_of_page(address)))
            .context("cannot serve the page")
    }
}

/// The duration of all frames that the insole plays.
fn duration(EmulatedInsole { recording, insole }: &EmulatedInsole) -> Duration {
    Duration::from_micros(insole.frames(recording) as u64 * u64::from(insole.setup.period_us))
}

/// Where a browser finds the page.
fn place_of_page(address: SocketAddr) -> String {
    let port = address.port();
    match serve::canonical_address(address).filter(|canonical| *canonical != address) {
        Some(here) => format!(
            "The page is at http://{here}/ and, for everyone in the network, at port {port} of this computer's address"
        ),
        None => format!("The page is at http://{address}/"),
    }
}

/// An insole for the page. `open` opens a carrier to it.
fn source(name: String, open: impl Fn() -> Result<Box<dyn Carrier + Send>> + Send + Sync + 'static) -> Source {
    Source { name, open: Arc::new(move || open().map_err(open_error)), tissue: None }
}
