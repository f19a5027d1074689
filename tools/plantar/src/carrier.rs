//! Options that select the connection to an insole.

use anyhow::{Context, Result, anyhow, bail};
use clap::{ArgGroup, Args};
#[cfg(feature = "ble")]
use client::ble::{BleCarrier, Selector};
use client::{Carrier, Client, Error, Framed, Link, READ_TIMEOUT, ReadAhead, ReconnectPolicy};
use serialport::{ErrorKind, SerialPort};
use std::fmt;
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::Arc;

/// Options that select the connection to one insole.
#[derive(Args, Clone)]
#[group(skip)]
#[command(group(ArgGroup::new("insole").required(true)))]
pub struct Connection {
    /// Network address of an insole, or of a bridge that forwards its bytes, HOST:PORT.
    #[arg(long, value_name = "ADDRESS", group = "insole")]
    tcp: Option<String>,
    /// Serial port of an insole, such as /dev/ttyACM0 or COM3.
    #[arg(long, value_name = "PORT", group = "insole")]
    serial: Option<String>,
    /// Bit rate of the serial port.
    #[arg(long, default_value_t = 460_800, requires = "serial")]
    baud: u32,
    /// Connect over Bluetooth to the insole of this foot, left or right. If several such insoles are in range, give the insole's
    /// Bluetooth address instead or, on macOS, which hides addresses, the identifier that macOS has given to the insole.
    #[cfg(feature = "ble")]
    #[arg(long, value_name = "FOOT", group = "insole")]
    ble: Option<Selector>,
}

/// Options that select serial and network connections to several insoles.
#[derive(Args)]
pub struct Ports {
    /// Serial port of an insole, such as /dev/ttyACM0 or COM3. Give the option once for each foot.
    #[arg(long, value_name = "PORT")]
    pub serial: Vec<String>,
    /// Bit rate of the serial ports.
    #[arg(long, default_value_t = 460_800, requires = "serial")]
    pub baud: u32,
    /// Network address of an insole, or of a bridge that forwards its bytes, HOST:PORT. Give the option once for each foot.
    #[arg(long, value_name = "ADDRESS")]
    pub tcp: Vec<String>,
}

/// The client of a connected insole.
pub type AnyClient = Client<Box<dyn Carrier + Send>>;

/// The connection to an insole, which is opened again after it was lost.
pub type InsoleLink = Link<Box<dyn Carrier + Send>>;

impl Connection {
    /// The connection to the insole on a serial port.
    pub fn serial(port: &str, baud: u32) -> Self {
        Self { serial: Some(port.into()), baud, ..Self::none() }
    }

    /// The connection to the insole at a network address.
    pub fn tcp(address: &str) -> Self {
        Self { tcp: Some(address.into()), ..Self::none() }
    }

    /// The connection to an insole over Bluetooth.
    #[cfg(feature = "ble")]
    pub fn ble(selector: &Selector) -> Self {
        Self { ble: Some(selector.clone()), ..Self::none() }
    }

    fn none() -> Self {
        Self {
            tcp: None,
            serial: None,
            baud: 0,
            #[cfg(feature = "ble")]
            ble: None,
        }
    }

    /// Opens a carrier and a session with the insole.
    pub fn open(&self, policy: ReconnectPolicy) -> Result<InsoleLink> {
        let connection = self.clone();
        let open = move || connection.carrier().map_err(open_error);
        Link::connect(Arc::new(open), policy).map_err(|error| match error {
            // An error of `carrier` already names the connection, unless this computer's Bluetooth cannot be used.
            Error::Open(error) => anyhow!(error),
            error => anyhow::Error::new(error).context(self.to_string()),
        })
    }

    fn carrier(&self) -> Result<Box<dyn Carrier + Send>> {
        Ok(match self {
            Self { tcp: Some(address), .. } => Box::new(open_tcp(address)?),
            Self { serial: Some(port), baud, .. } => Box::new(open_serial(port, *baud)?),
            #[cfg(feature = "ble")]
            Self { ble: Some(selector), .. } => Box::new(BleCarrier::connect(selector)?),
            _ => bail!("give --tcp, --serial or --ble"),
        })
    }
}

/// Shows the connection as the user named it.
impl fmt::Display for Connection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self { tcp: Some(name), .. } | Self { serial: Some(name), .. } => f.write_str(name),
            #[cfg(feature = "ble")]
            Self { ble: Some(selector), .. } => selector.fmt(f),
            _ => f.write_str("the insole"),
        }
    }
}

/// The cause and the remedy of a failure of the link, for the user.
pub fn link_problem(error: &Error) -> String {
    match error {
        Error::Refused(refusal) => refusal.to_string(),
        _ => "connection lost: come closer, or check the cable".into(),
    }
}

/// Wraps the reason why a carrier could not be opened.
pub fn open_error(error: anyhow::Error) -> Error {
    Error::Open(error.into())
}

/// Connects to an insole on the network, or to a bridge that forwards the bytes of an insole.
pub fn open_tcp(address: &str) -> Result<Framed<TcpStream>> {
    let stream = connect_tcp(address).with_context(|| {
        format!(
            "cannot connect to {address}: is the insole or its bridge running there, or is another program connected to it?"
        )
    })?;
    stream.set_read_timeout(Some(READ_TIMEOUT))?;
    stream.set_nodelay(true)?;
    Ok(Framed::new(stream))
}

/// Tries all addresses of a host, each for a limited time: a bridge that serves one client may not answer another one.
fn connect_tcp(address: &str) -> io::Result<TcpStream> {
    let mut failure = io::ErrorKind::AddrNotAvailable.into();
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, ReconnectPolicy::STREAM.answer) {
            Ok(stream) => return Ok(stream),
            Err(error) => failure = error,
        }
    }
    Err(failure)
}

/// Opens the serial port of an insole for exclusive use.
pub fn open_serial(port: &str, baud: u32) -> Result<Framed<ReadAhead<Box<dyn SerialPort>>>> {
    let stream = serialport::new(port, baud).timeout(READ_TIMEOUT).open().map_err(|error| {
        let remedy = match error.kind() {
            // The port exists, so another program uses it exclusively.
            ErrorKind::NoDevice if Path::new(port).exists() => {
                "another program is connected to it: close that program".into()
            }
            ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::NotFound) => match known_ports() {
                Some(known) => format!("plug the insole in, or name another port; this computer has {known}"),
                None => "plug the insole in; this computer has no serial port".into(),
            },
            ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
                "you lack the permission to open it; on Linux, join the group of the port, often dialout, and log in again".into()
            }
            _ => format!("check that it is a serial port and supports {baud} bit/s"),
        };
        anyhow!("cannot open {port}: {error}; {remedy}")
    })?;
    Ok(Framed::new(ReadAhead::new(stream.try_clone()?, stream)))
}

/// The names of this computer's serial ports; `None` if there is none, or if they cannot be listed.
fn known_ports() -> Option<String> {
    let names: Vec<_> = serialport::available_ports().ok()?.into_iter().map(|port| port.port_name).collect();
    (!names.is_empty()).then(|| names.join(", "))
}
