//! Options that say where an insole is, and the session with it.

use anyhow::{Context, Result, anyhow, bail};
use central::{Central, Which};
use clap::{ArgGroup, Args};
use client::{Carrier as Messages, Client, Framed};
use serialport::{ErrorKind, SerialPort};
use std::fmt;
use std::io;
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

/// Longest silence of a carrier before control comes back to look at the keyboard.
pub const PATIENCE: Duration = Duration::from_millis(50);
/// An insole answers a hello within this time.
pub const ANSWER: Duration = Duration::from_secs(5);

#[derive(Args)]
#[group(skip)]
#[command(group(ArgGroup::new("insole").required(true).args(["tcp", "serial", "ble"])))]
pub struct Carrier {
    /// Network address of an insole, HOST:PORT.
    #[arg(long, value_name = "ADDRESS")]
    tcp: Option<String>,
    /// Serial port of an insole, such as /dev/ttyACM0 or COM3.
    #[arg(long, value_name = "PORT")]
    serial: Option<String>,
    /// Bit rate of the serial port.
    #[arg(long, default_value_t = 460_800, requires = "serial")]
    baud: u32,
    /// Bluetooth, for the insole of this foot: left, right, or an address where several people are near.
    #[arg(long, value_name = "FOOT")]
    ble: Option<Which>,
}

/// A session with an insole.
pub type Session = Client<Box<dyn Messages>>;

impl Carrier {
    /// Opens a session with the insole there.
    pub fn connect(&self) -> Result<Session> {
        Client::connect(self.open()?, ANSWER).with_context(|| self.to_string())
    }

    /// Opens it anew after the carrier broke; what was received before is still known.
    pub fn reconnect(&self, session: &mut Session) -> Result<()> {
        session.reconnect_over(|| self.open(), ANSWER).with_context(|| self.to_string())?;
        Ok(())
    }

    fn open(&self) -> Result<Box<dyn Messages>> {
        Ok(match self {
            Self { tcp: Some(address), .. } => Box::new(Framed::new(open_tcp(address)?)),
            Self { serial: Some(port), baud, .. } => Box::new(Framed::new(open_serial(port, *baud)?)),
            Self { ble: Some(which), .. } => Box::new(Central::connect(which)?),
            _ => bail!("give --tcp, --serial or --ble"),
        })
    }
}

/// As the user named it.
impl fmt::Display for Carrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.tcp, &self.serial, &self.ble) {
            (Some(place), ..) | (None, Some(place), _) => f.write_str(place),
            (.., Some(which)) => which.fmt(f),
            _ => f.write_str("the insole"),
        }
    }
}

/// An insole, or its bridge, on the network.
pub fn open_tcp(address: &str) -> Result<TcpStream> {
    let stream = TcpStream::connect(address)
        .with_context(|| format!("cannot reach {address}: is the insole or its bridge running there?"))?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

/// An insole on a serial port, for this program alone.
pub fn open_serial(port: &str, baud: u32) -> Result<Box<dyn SerialPort>> {
    serialport::new(port, baud).timeout(PATIENCE).open().map_err(|error| {
        let remedy = match error.kind() {
            // What is there and not available is taken.
            ErrorKind::NoDevice if Path::new(port).exists() => "another program holds it: end that one".into(),
            ErrorKind::NoDevice | ErrorKind::Io(io::ErrorKind::NotFound) => match known_ports() {
                Some(known) => format!("plug the insole in, or name another; here are {known}"),
                None => "plug the insole in; no serial port is here".into(),
            },
            ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
                "your user lacks the right to it; on Linux its group has that, often dialout".into()
            }
            _ => format!("is it a serial port, and does it have {baud} bit/s?"),
        };
        anyhow!("cannot open {port}: {error}; {remedy}")
    })
}

fn known_ports() -> Option<String> {
    let names: Vec<_> = serialport::available_ports().ok()?.into_iter().map(|port| port.port_name).collect();
    (!names.is_empty()).then(|| names.join(", "))
}
