//! Serves the page for a phone and bridges one or two insoles to it.
//!
//! To a page the bridge is an insole: it answers hello, streams, keeps steps until they are acknowledged; per page and
//! insole there is one [`plantar::protocol::session::Session`], the firmware's own. A page that is slow loses live frames, which its
//! status counts, and nobody else does. A step is acknowledged to the insole once one page has taken it, or once it is
//! written where there is a recording.
//!
//! A binary WebSocket message is one unframed message after one byte, the insole's index.

mod bridge;
mod hub;
mod origin;
mod stream_file;
mod web;

pub use bridge::Source;
pub use stream_file::{StreamFile, append};

use client::Error as LinkError;
use hub::Hub;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;

/// Feet.
pub const MAX_INSOLES: usize = 2;

/// What is served where.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where to listen; port 0 takes a free one.
    pub listen: SocketAddr,
    /// The built page.
    pub page: PathBuf,
    /// Pages from these origins may connect, beside the one that is served.
    pub origins: Vec<String>,
    /// Everything that the insoles say goes to this file too, which must be new or empty.
    pub record: Option<PathBuf>,
}

/// Why nothing is served.
#[derive(Debug, Error)]
pub enum Error {
    /// The page was not built.
    #[error("no page in {0}: build it with `cargo xtask page`, or name its folder with --page")]
    NoPage(PathBuf),
    /// An insole does not answer.
    #[error("{0}")]
    Insole(String, #[source] LinkError),
    /// Two insoles of one foot.
    #[error("both insoles are for the {0} foot")]
    SameFoot(&'static str),
    /// The port.
    #[error("cannot listen on {0}: {1}")]
    Listen(SocketAddr, io::Error),
    /// The recording.
    #[error("cannot write {0}: {1}")]
    Record(PathBuf, io::Error),
    /// The server itself.
    #[error("the server ended: {0}")]
    Io(#[from] io::Error),
}

/// Connects to the insoles and serves until the program is told to end; `ready` hears the address.
pub fn serve(sources: Vec<Source>, options: &Options, ready: impl FnOnce(SocketAddr)) -> Result<(), Error> {
    if !options.page.join("index.html").is_file() {
        return Err(Error::NoPage(options.page.clone()));
    }
    let recorder = match &options.record {
        Some(path) => Some(StreamFile::create(path).map_err(|e| Error::Record(path.clone(), e))?),
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
    let hub = Arc::new(Hub::new(sessions.len(), recorder));
    for (index, (name, insole)) in sessions.into_iter().enumerate() {
        let hub = hub.clone();
        // The thread ends with the program.
        std::thread::spawn(move || bridge::run(&hub, index, &name, insole));
    }
    let served = web::run(hub.clone(), options, ready);
    hub.end();
    served
}
