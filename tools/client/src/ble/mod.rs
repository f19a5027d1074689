//! A carrier over Bluetooth LE: this computer is the central, and uses the service of an insole (docs/bluetooth.md).
//!
//! The operating system controls the radio, pairs, and stores the bonds.

mod exclusive;
mod selector;

pub use selector::Selector;

use crate::{Carrier, READ_TIMEOUT};
use btleplug::Error as BleError;
use btleplug::api::{
    Central as _, Characteristic, Manager as _, Peripheral as _, ScanFilter, ValueNotification, WriteType,
};
use btleplug::platform::{Adapter, Manager, Peripheral};
use futures_util::{Stream, StreamExt};
use plantar::protocol::fragment::{Joiner, Splitter};
use plantar::protocol::gatt::{self, GattChannel};
use plantar::protocol::{ToDevice, ToHost, decode, encode};
use std::fs::File;
use std::io;
use std::pin::Pin;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, TrySendError};
use std::time::Duration;
use thiserror::Error;
use tokio::runtime::{Builder, Runtime};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use uuid::Uuid;

/// The insole service.
pub const SERVICE: Uuid = Uuid::from_u128(gatt::SERVICE);
/// The characteristics that carry messages.
const CHANNELS: [(GattChannel, Uuid); 4] = [
    (GattChannel::Control, Uuid::from_u128(gatt::CONTROL)),
    (GattChannel::Live, Uuid::from_u128(gatt::LIVE)),
    (GattChannel::Steps, Uuid::from_u128(gatt::STEPS)),
    (GattChannel::Parameters, Uuid::from_u128(gatt::PARAMETERS)),
];

/// Timeout of a scan. An advertising insole is found earlier.
const SCAN_TIMEOUT: Duration = Duration::from_secs(15);
/// Time between two checks of the peripherals that a scan found.
const SCAN_INTERVAL: Duration = Duration::from_millis(200);
/// Timeout of a connection. An insole in range connects, pairs and lists its characteristics earlier.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(20);
/// Largest number of values that wait for the program: those of more than a minute. Further ones are discarded.
const MOST_VALUES: usize = 32_768;
/// Length of the opcode and the handle that precede a written value, bytes.
const ATT_HEADER: usize = 3;
/// Length of the longest value that every connection can write in one packet, bytes: that of the smallest ATT MTU, 23.
const MIN_VALUE: usize = 20;

/// The reason why no connection could be established.
#[derive(Debug, Error)]
pub enum Error {
    /// The system's Bluetooth service does not answer.
    #[error("this computer's Bluetooth does not answer ({0}): switch it on, and allow this program to use it")]
    NoBluetooth(BleError),
    /// This computer has no adapter.
    #[error("this computer has no Bluetooth adapter: plug one in, or connect the insole by --serial")]
    NoAdapter,
    /// The insole was not found.
    #[error(
        "{0} was not found within {SCAN_TIMEOUT:?}: switch it on and bring it closer; another phone or computer may be \
         connected to it, which must be disconnected first"
    )]
    NotFound(Selector),
    /// Another program of this user uses the insole.
    #[error("{0} is in use: close the other program on this computer that is connected to it")]
    InUse(Selector),
    /// The insole was found, but the connection or the pairing failed.
    #[error(
        "{selector} was found but does not connect ({error}): pair it in this computer's Bluetooth settings, within a minute \
         after it was switched on"
    )]
    NotConnected {
        /// The insole.
        selector: Selector,
        /// The system's reason.
        error: BleError,
    },
    /// The runtime could not be started.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A connected insole.
pub struct BleCarrier {
    /// Drives the Bluetooth tasks on a thread of its own.
    runtime: Runtime,
    peripheral: Peripheral,
    /// The notifications in the order of their arrival.
    values: Receiver<ValueNotification>,
    /// Fetches the notifications while the caller is busy: on macOS and Windows `btleplug` holds at most 16 of them, and discards
    /// the oldest ones.
    fetching: JoinHandle<()>,
    channels: Vec<Channel>,
    damaged: u32,
    /// Excludes other programs of this user. The last field, so that it is dropped after the connection.
    _reserved: Option<File>,
}

type Notifications = Pin<Box<dyn Stream<Item = ValueNotification> + Send>>;

/// A characteristic that carries messages. Its values are fragments, which the joiner joins into messages.
struct Channel {
    channel: GattChannel,
    characteristic: Characteristic,
    joiner: Joiner,
}

impl BleCarrier {
    /// Finds the insole, connects and subscribes to its characteristics.
    ///
    /// # Errors
    /// See [`enum@Error`].
    pub fn connect(selector: &Selector) -> Result<Self, Error> {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let peripheral = runtime.block_on(find(selector))?;
        let id = peripheral.id().to_string();
        let reserved = exclusive::reserve(&id).map_err(|exclusive::InUse| Error::InUse(selector.clone()))?;
        let subscribed = runtime.block_on(async { timeout(CONNECT_TIMEOUT, subscribe(&peripheral)).await });
        let (mut notifications, channels) = match subscribed.unwrap_or(Err(BleError::TimedOut(CONNECT_TIMEOUT))) {
            Ok(subscribed) => subscribed,
            Err(error) => {
                // While the peripheral is connected, no other central can connect.
                let _ = runtime.block_on(peripheral.disconnect());
                return Err(Error::NotConnected { selector: selector.clone(), error });
            }
        };
        let (sender, values) = mpsc::sync_channel(MOST_VALUES);
        let fetching = runtime.spawn(async move {
            while let Some(value) = notifications.next().await {
                match sender.try_send(value) {
                    // Without a fragment, its message is counted as damaged.
                    Ok(()) | Err(TrySendError::Full(_)) => (),
                    // The carrier was dropped.
                    Err(TrySendError::Disconnected(_)) => return,
                }
            }
        });
        Ok(Self { runtime, peripheral, values, fetching, channels, damaged: 0, _reserved: reserved })
    }
}

/// Scans until the selected insole is found.
async fn find(selector: &Selector) -> Result<Peripheral, Error> {
    let manager = Manager::new().await.map_err(Error::NoBluetooth)?;
    let adapters = manager.adapters().await.map_err(Error::NoBluetooth)?;
    let adapter = adapters.into_iter().next().ok_or(Error::NoAdapter)?;
    adapter.start_scan(ScanFilter { services: vec![SERVICE] }).await.map_err(Error::NoBluetooth)?;
    let found = timeout(SCAN_TIMEOUT, scan(&adapter, selector)).await;
    // A running scan takes radio time from the connection. If it cannot be stopped, it ends with this program.
    let _ = adapter.stop_scan().await;
    match found {
        Ok(found) => found.map_err(Error::NoBluetooth),
        Err(_) => Err(Error::NotFound(selector.clone())),
    }
}

async fn scan(adapter: &Adapter, selector: &Selector) -> Result<Peripheral, BleError> {
    loop {
        for peripheral in adapter.peripherals().await? {
            // A peripheral that the system has removed from its list in the meantime has no properties.
            if let Ok(Some(properties)) = peripheral.properties().await
                && selector.matches(&peripheral.id().to_string(), &properties)
                // The system also lists paired peripherals that are out of range.
                && (properties.rssi.is_some() || peripheral.is_connected().await.is_ok_and(|c| c))
            {
                return Ok(peripheral);
            }
        }
        sleep(SCAN_INTERVAL).await;
    }
}

/// Length of the longest value that a connection with this ATT MTU can write in one packet, bytes. The system would write a
/// longer one in parts (a *prepared write*), which an insole refuses.
fn longest_value(mtu: u16) -> usize {
    usize::from(mtu).saturating_sub(ATT_HEADER).clamp(MIN_VALUE, gatt::MAX_VALUE)
}

/// Connects and subscribes to all characteristics that carry messages.
async fn subscribe(peripheral: &Peripheral) -> Result<(Notifications, Vec<Channel>), BleError> {
    peripheral.connect().await?;
    peripheral.discover_services().await?;
    let notifications = peripheral.notifications().await?;
    let all = peripheral.characteristics();
    let mut channels = Vec::new();
    for (channel, uuid) in CHANNELS {
        let found = all.iter().find(|c| c.service_uuid == SERVICE && c.uuid == uuid);
        let characteristic = found.ok_or(BleError::NoSuchCharacteristic)?.clone();
        peripheral.subscribe(&characteristic).await?;
        channels.push(Channel { channel, characteristic, joiner: Joiner::new() });
    }
    Ok((notifications, channels))
}

impl Carrier for BleCarrier {
    fn send(&mut self, message: ToDevice) -> io::Result<()> {
        let wanted = GattChannel::of_request(&message);
        // All channels were found when the insole was connected.
        let Some(channel) = self.channels.iter().find(|c| c.channel == wanted) else { return Ok(()) };
        let mut splitter = Splitter::new();
        let len = encode(&message, splitter.buffer()).map_err(io::Error::other)?.len();
        splitter.start(len);
        let mut fragment = [0; gatt::MAX_VALUE];
        let fragment = &mut fragment[..longest_value(self.peripheral.mtu())];
        while let Some(len) = splitter.next(fragment) {
            let written = self.peripheral.write(&channel.characteristic, &fragment[..len], WriteType::WithResponse);
            self.runtime.block_on(written).map_err(io::Error::other)?;
        }
        Ok(())
    }

    fn receive(&mut self) -> io::Result<Option<ToHost>> {
        let value = match self.values.recv_timeout(READ_TIMEOUT) {
            Ok(value) => value,
            Err(RecvTimeoutError::Timeout) => {
                let is_connected = self.runtime.block_on(self.peripheral.is_connected());
                return if is_connected.is_ok_and(|c| c) { Ok(None) } else { Err(io::ErrorKind::NotConnected.into()) };
            }
            Err(RecvTimeoutError::Disconnected) => return Err(io::ErrorKind::UnexpectedEof.into()),
        };
        let Some(channel) = self.channels.iter_mut().find(|c| c.characteristic.uuid == value.uuid) else {
            return Ok(None);
        };
        let message = match channel.joiner.push(&value.value) {
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

impl Drop for BleCarrier {
    fn drop(&mut self) {
        // Without this, the insole would detect the loss of its central only after a timeout.
        let _ = self.runtime.block_on(self.peripheral.disconnect());
        // On Linux, dropping the stream of notifications starts asynchronous work, which needs the runtime.
        self.fetching.abort();
        let _ = self.runtime.block_on(&mut self.fetching);
    }
}

#[cfg(test)]
mod tests {
    use super::longest_value;

    /// A Write Request has an opcode of one byte and a handle of two. The insole has an MTU of 247.
    #[test]
    fn a_written_value_fits_in_the_mtu_of_the_connection_and_of_the_insole() {
        assert_eq!([23, 24, 185, 247, 517].map(longest_value), [20, 21, 182, 244, 244]);
        assert_eq!(longest_value(0), 20, "a system that does not report the MTU");
    }
}
