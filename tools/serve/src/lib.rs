//! Serves the page for a phone and bridges one or two insoles to it.
//!
//! To a page, the bridge behaves like an insole: it answers a connect request with the insole's hello, streams live frames, and
//! queues records (steps, load bouts and alerts) until they are acknowledged. Each page has a session of its own with each
//! insole, which uses the firmware's [`plantar::protocol::session::Session`]. A slow page loses live frames without an effect
//! on other pages; the status that it receives counts them. The bridge acknowledges a record to the insole once a page has
//! acknowledged the record or, if the messages are recorded, once the record is in the recording. It holds the last records of
//! each insole for pages that are slower, and for those that open later: these receive the records that no page has acknowledged.
//! A page that is further behind loses records, which its status counts. Publishing a record over the Lab Streaming Layer does
//! not acknowledge it.
//!
//! A binary WebSocket message is the index of the insole, one byte, followed by one unframed message.

mod bridge;
mod hub;
mod liblsl;
mod lsl;
mod origin;
mod web;

pub use bridge::Source;
pub use liblsl::MissingLiblsl;
pub use origin::canonical_address;

use bridge::Session;
use client::{Error as LinkError, StreamFile};
use hub::Hub;
use liblsl::Liblsl;
use lsl::Outlets;
use std::fmt;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;
use tokio::sync::mpsc::channel;
use web::Listening;

/// Largest number of insoles: one per foot.
pub const MAX_INSOLES: usize = 2;

/// The options of the server.
#[derive(Clone, Debug)]
pub struct Options {
    /// The address to listen on; port 0 chooses a free port.
    pub listen: SocketAddr,
    /// The folder of the built page, which contains `index.html`.
    pub page: PathBuf,
    /// Origins of other pages that may connect, in addition to the served page.
    pub origins: Vec<String>,
    /// True if pages may replace the wearer's parameters and the rules of alerts on the insoles.
    pub accepts_parameters: bool,
    /// The file to which hellos, live frames, steps, load bouts, alerts, counters and clock times of the insoles are written. It
    /// must be new or empty. `None` for no recording.
    pub record: Option<PathBuf>,
    /// The file of liblsl, which publishes the messages of the insoles over the Lab Streaming Layer; `Some(None)` for the file
    /// that the system finds, and `None` to publish nothing.
    pub lsl: Option<Option<PathBuf>>,
}

/// The reason why the server did not start, or ended.
#[derive(Debug, Error)]
pub enum Error {
    /// The folder has no page.
    #[error("no page in {0}: build it with `cargo xtask page`, or name its folder with --page")]
    NoPage(PathBuf),
    /// The session with an insole could not be opened.
    #[error("{0}")]
    Insole(String, #[source] LinkError),
    /// Both insoles are for this foot.
    #[error("both insoles are for the {0} foot: connect one insole for each foot")]
    SameFoot(&'static str),
    /// The address cannot be listened on.
    #[error("cannot listen on {0}: {1}; choose another address or port with --bind and --port")]
    Listen(SocketAddr, io::Error),
    /// The recording cannot be written.
    #[error("cannot write {0}: {1}")]
    Record(PathBuf, io::Error),
    /// liblsl cannot be loaded.
    #[error(transparent)]
    Lsl(#[from] MissingLiblsl),
    /// liblsl does not publish the stream with this name.
    #[error("liblsl cannot publish the stream {0}: check the network, and liblsl's configuration file lsl_api.cfg")]
    Stream(String),
    /// The program failed while it served this insole.
    #[error(
        "{0}: an error of this program has ended the session with this insole: start the server again, and report the error"
    )]
    Bridge(String),
    /// The server failed.
    #[error("the server ended: {0}")]
    Io(#[from] io::Error),
}

/// Connects to the insoles and serves until a signal ends the program. The server listens from the beginning on; `ready` is
/// called with its address once all insoles are connected, directly before the server begins to answer.
///
/// # Errors
/// See [`enum@Error`].
pub fn serve(sources: Vec<Source>, options: &Options, ready: impl FnOnce(SocketAddr)) -> Result<(), Error> {
    if !options.page.join("index.html").is_file() {
        return Err(Error::NoPage(options.page.clone()));
    }
    // The server listens before the recording is created, so that a port in use leaves no file.
    let server = Listening::at(options.listen)?;
    let recorder = match &options.record {
        Some(path) => Some(StreamFile::create(path).map_err(|e| Error::Record(path.clone(), e))?),
        None => None,
    };
    let lsl = match &options.lsl {
        Some(file) => Some(Liblsl::load(file.as_deref())?),
        None => None,
    };
    let mut sessions = Vec::new();
    for source in sources {
        let name = source.name.clone();
        let insole = source.connect().map_err(|error| Error::Insole(name.clone(), error))?;
        sessions.push((name, insole));
    }
    if let [(_, one), (_, other)] = &mut sessions[..] {
        let side = one.client().hello().side;
        if side == other.client().hello().side {
            return Err(Error::SameFoot(side.name()));
        }
    }
    let outlets = sessions.iter_mut().map(|(_, insole)| lsl.map(|lsl| publish(lsl, insole)).transpose());
    let outlets: Vec<Option<Outlets>> = outlets.collect::<Result<_, _>>()?;
    for outlets in outlets.iter().flatten() {
        report(format_args!("LSL streams: {}", outlets.names()));
    }
    let hub = Arc::new(Hub::new(outlets, options.accepts_parameters, recorder));
    let (panicked, panics) = channel(MAX_INSOLES);
    for (index, (name, insole)) in sessions.into_iter().enumerate() {
        let (hub, panicked) = (hub.clone(), panicked.clone());
        // This thread runs until the program ends. After a panic it uses nothing of the insole any more.
        std::thread::spawn(move || {
            if catch_unwind(AssertUnwindSafe(|| bridge::run(&hub, index, &name, insole))).is_err() {
                // If nothing receives the name, the server has already ended.
                let _ = panicked.try_send(name);
            }
        });
    }
    let served = server.run(hub.clone(), options, panics, ready);
    let finished = hub.end();
    served.and(finished.map_err(Error::Io))
}

/// Prints a line on stderr. If it cannot be written, as to a file on a full disk, the server continues without it.
fn report(line: fmt::Arguments) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Publishes the streams of an insole over the Lab Streaming Layer.
fn publish(lsl: Liblsl, insole: &mut Session) -> Result<Outlets, Error> {
    // If the insole does not answer, its streams have no serial number.
    let serial = insole.client().identity().map(|identity| identity.serial).unwrap_or_default();
    Outlets::new(lsl, insole.client().hello(), serial.as_str())
}
