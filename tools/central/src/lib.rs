//! This computer as a Bluetooth central: an insole's service (docs/bluetooth.md) as a carrier of messages.
//!
//! The system's own Bluetooth does the radio, the pairing and the bonds.

mod which;

pub use which::Which;

use btleplug::Error as Failure;
use btleplug::api::{
    Central as _, Characteristic, Manager as _, Peripheral as _, ScanFilter, ValueNotification, WriteType,
};
use btleplug::platform::{Adapter, Manager, Peripheral};
use client::Carrier;
use futures_util::{Stream, StreamExt, stream};
use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::{ToDevice, ToHost, decode, encode};
use std::io;
use std::pin::Pin;
use std::time::Duration;
use thiserror::Error;
use tokio::runtime::{Builder, Runtime};
use tokio::time::{sleep, timeout};
use uuid::Uuid;

/// Our service and, with other numbers, its characteristics.
const fn uuid(number: u128) -> Uuid {
    Uuid::from_u128(0xdca8_c300_cb96_463f_8bec_f209_4e1c_cf7b + (number << 96))
}

/// The insole's service.
pub const SERVICE: Uuid = uuid(0);
const CONTROL: Uuid = uuid(1);
const LIVE: Uuid = uuid(2);
const STEPS: Uuid = uuid(3);
const PARAMETERS: Uuid = uuid(4);

/// An advertising insole is heard within this time.
const HEARD: Duration = Duration::from_secs(15);
/// Between looks at what was heard.
const LOOK: Duration = Duration::from_millis(200);
/// An insole in reach connects, pairs and tells its table within this time.
const CONNECTED: Duration = Duration::from_secs(20);
/// Longest silence before control comes back.
const PATIENCE: Duration = Duration::from_millis(50);
/// What every connection carries in one value, bytes.
const PIECE: usize = 20;

/// Why there is no connection.
#[derive(Debug, Error)]
pub enum Error {
    /// The system's Bluetooth does not answer.
    #[error("this computer's Bluetooth does not answer ({0}): is it there, switched on, and may this program use it?")]
    NoBluetooth(Failure),
    /// No adapter.
    #[error("this computer has no Bluetooth adapter: plug one in, or connect the insole by --serial")]
    NoAdapter,
    /// Not heard.
    #[error(
        "{0} was not heard within {HEARD:?}: switch it on, bring it closer, and disconnect it from other phones, it serves one at a time"
    )]
    NotHeard(Which),
    /// Heard, but it does not let us in.
    #[error(
        "{which} was heard but does not connect ({failure}): pair it in this computer's Bluetooth settings, within a minute of switching it on"
    )]
    Refused {
        /// The insole.
        which: Which,
        /// What the system said.
        failure: Failure,
    },
    /// No thread of work.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A connected insole.
pub struct Central {
    /// Its work is done while this waits; nothing runs in between.
    runtime: Runtime,
    peripheral: Peripheral,
    values: Pin<Box<dyn Stream<Item = ValueNotification> + Send>>,
    streams: Vec<(Characteristic, Joiner)>,
    damaged: u32,
}

impl Central {
    /// Finds the insole, connects and subscribes.
    pub fn connect(which: &Which) -> Result<Self, Error> {
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let peripheral = runtime.block_on(find(which))?;
        let opened = runtime.block_on(async { timeout(CONNECTED, open(&peripheral)).await });
        let (values, streams) = match opened.unwrap_or(Err(Failure::TimedOut(CONNECTED))) {
            Ok(opened) => opened,
            Err(failure) => {
                // Otherwise nobody else could connect.
                let _ = runtime.block_on(peripheral.disconnect());
                return Err(Error::Refused { which: which.clone(), failure });
            }
        };
        Ok(Self { runtime, peripheral, values, streams, damaged: 0 })
    }
}

/// Listens until the insole advertises.
async fn find(which: &Which) -> Result<Peripheral, Error> {
    let manager = Manager::new().await.map_err(Error::NoBluetooth)?;
    let adapters = manager.adapters().await.map_err(Error::NoBluetooth)?;
    let adapter = adapters.into_iter().next().ok_or(Error::NoAdapter)?;
    adapter.start_scan(ScanFilter { services: vec![SERVICE] }).await.map_err(Error::NoBluetooth)?;
    let found = timeout(HEARD, listen(&adapter, which)).await;
    // A scan that goes on costs the link its time; one that cannot be stopped ends with this program.
    let _ = adapter.stop_scan().await;
    match found {
        Ok(found) => found.map_err(Error::NoBluetooth),
        Err(_) => Err(Error::NotHeard(which.clone())),
    }
}

async fn listen(adapter: &Adapter, which: &Which) -> Result<Peripheral, Failure> {
    loop {
        for peripheral in adapter.peripherals().await? {
            // One that is gone again has none.
            if let Ok(Some(properties)) = peripheral.properties().await
                && which.is(&peripheral.id().to_string(), &properties)
                // Those that are paired are listed, there or not.
                && (properties.rssi.is_some() || peripheral.is_connected().await.is_ok_and(|c| c))
            {
                return Ok(peripheral);
            }
        }
        sleep(LOOK).await;
    }
}

type Opened = (Pin<Box<dyn Stream<Item = ValueNotification> + Send>>, Vec<(Characteristic, Joiner)>);

/// Connects and subscribes to all that the insole sends.
async fn open(peripheral: &Peripheral) -> Result<Opened, Failure> {
    peripheral.connect().await?;
    peripheral.discover_services().await?;
    let values = peripheral.notifications().await?;
    let all = peripheral.characteristics();
    let mut streams = Vec::new();
    for uuid in [CONTROL, LIVE, STEPS, PARAMETERS] {
        let found = all.iter().find(|c| c.service_uuid == SERVICE && c.uuid == uuid);
        let characteristic = found.ok_or(Failure::NoSuchCharacteristic)?;
        peripheral.subscribe(characteristic).await?;
        streams.push((characteristic.clone(), Joiner::new()));
    }
    Ok((values, streams))
}

impl Carrier for Central {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        let way = if matches!(message, ToDevice::SetTissue(_) | ToDevice::GetTissue) { PARAMETERS } else { CONTROL };
        // All four were found when this was opened.
        let Some((characteristic, _)) = self.streams.iter().find(|(c, _)| c.uuid == way) else { return Ok(()) };
        let mut splitter = Splitter::new();
        let len = encode(&message, splitter.buffer()).map_err(io::Error::other)?.len();
        splitter.start(len);
        let mut piece = [0; PIECE];
        while let Some(len) = splitter.next(&mut piece) {
            let written = self.peripheral.write(characteristic, &piece[..len], WriteType::WithResponse);
            self.runtime.block_on(written).map_err(io::Error::other)?;
        }
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        let Ok(value) = self.runtime.block_on(async { timeout(PATIENCE, self.values.next()).await }) else {
            let is_connected = self.runtime.block_on(self.peripheral.is_connected());
            return if is_connected.is_ok_and(|c| c) { Ok(None) } else { Err(io::ErrorKind::NotConnected.into()) };
        };
        let Some(value) = value else { return Err(io::ErrorKind::UnexpectedEof.into()) };
        let Some((_, joiner)) = self.streams.iter_mut().find(|(c, _)| c.uuid == value.uuid) else { return Ok(None) };
        let message = match joiner.push(&value.value) {
            Ok(None) => return Ok(None),
            Ok(Some(message)) => decode(message),
            Err(_) => None,
        };
        self.damaged += u32::from(message.is_none());
        Ok(message)
    }

    fn damaged(&self) -> u32 {
        self.damaged
    }
}

impl Drop for Central {
    fn drop(&mut self) {
        // An insole whose phone is gone notices by itself, later.
        let _ = self.runtime.block_on(self.peripheral.disconnect());
        // On Linux its end is work too, which needs the runtime.
        let _runtime = self.runtime.enter();
        self.values = Box::pin(stream::empty());
    }
}
