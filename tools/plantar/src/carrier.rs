//! Options that say where an insole is, and the session with it.

use anyhow::{Context, Result, bail};
use central::{Central, Which};
use clap::{ArgGroup, Args};
use client::{Carrier as Messages, Client, Framed};
use std::net::TcpStream;
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
        let carrier: Box<dyn Messages> = match self {
            Self { tcp: Some(address), .. } => Box::new(Framed::new(open_tcp(address)?)),
            Self { serial: Some(port), baud, .. } => Box::new(Framed::new(open_serial(port, *baud)?)),
            Self { ble: Some(which), .. } => Box::new(Central::connect(which)?),
            _ => bail!("give --tcp, --serial or --ble"),
        };
        Ok(Client::connect(carrier, ANSWER)?)
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

/// An insole on a serial port.
pub fn open_serial(port: &str, baud: u32) -> Result<Box<dyn serialport::SerialPort>> {
    serialport::new(port, baud).timeout(PATIENCE).open().with_context(|| {
        let known = serialport::available_ports().unwrap_or_default();
        let names: Vec<_> = known.iter().map(|p| p.port_name.as_str()).collect();
        let there =
            if names.is_empty() { "no serial port is here".into() } else { format!("here are {}", names.join(", ")) };
        format!("cannot open {port}; {there}; another program may hold it, or your user may lack the right to it")
    })
}
