//! The insole as a Bluetooth LE peripheral: advertising, bonds, and the GATT table of `docs/bluetooth.md`. What the values
//! mean is the application's, behind [`Insole`].
//!
//! A package of its own because it is compiled for size, while the data path is compiled for speed: hence no generics.
#![no_std]
#![warn(missing_docs)]
#![forbid(unsafe_code)]

mod bonds;
mod gate;
mod table;

use bt_hci_serial::SerialTransport;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::{CriticalSectionRawMutex, NoopRawMutex};
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Timer};
use gate::Gate;
use static_cell::StaticCell;
use table::{Server, Table};
use trouble_host::att::{AttClient, AttErrorCode, AttReq};
use trouble_host::prelude::*;

/// A phone can bond for this long after power-on.
pub const BONDING_WINDOW: Duration = Duration::from_secs(60);
/// Phones that are remembered; one more forgets the one that has not been here for longest.
pub const MAX_BONDS: usize = 4;
/// Room for the bonds as [`Insole::save_bonds`] keeps them.
pub const BONDS_BYTES: usize = 192;
/// Longest value of a characteristic: the packets' 251 bytes without L2CAP and ATT headers.
pub const MAX_VALUE: usize = 244;

/// A radio that failed, or a full packet pool, is tried again after this time.
const RADIO_PAUSE: Duration = Duration::from_secs(1);
const POOL_PAUSE: Duration = Duration::from_millis(10);
/// Time between two looks whether the phone is still there.
const LOOK: Duration = Duration::from_millis(200);

/// HCI as bytes (H4) in one direction between board and host.
pub type HciPipe = Pipe<CriticalSectionRawMutex, 128>;

/// A characteristic whose values are the application's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Current Time.
    Time,
    /// RSC Measurement.
    Cadence,
    /// Our control point.
    Control,
    /// Our live frames.
    Live,
    /// Our steps.
    Steps,
    /// The wearer's parameters.
    Parameters,
}

/// Why a value was not taken, as a phone gets to hear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Too long, or empty.
    Length,
    /// A piece of a message out of order.
    OutOfOrder,
    /// Not a message, or not one that this characteristic takes.
    NotUnderstood,
    /// Not a time.
    Value,
}

/// The application, and what it stands for of the board.
pub trait Insole {
    /// The name that is advertised, at most 22 bytes.
    fn name(&self) -> &str;
    /// The model.
    fn model(&self) -> &str;
    /// The firmware's version.
    fn firmware(&self) -> &str;
    /// The random static address, or `None` where the controller has a public one.
    fn address(&self) -> Option<[u8; 6]>;
    /// Charge of the battery, percent.
    fn battery_percent(&self) -> u8;
    /// The owner allows a phone to bond now.
    fn allows_bonding(&self) -> bool;
    /// Reads the bonds that were kept last into `bytes`; their length, 0 where none are.
    fn load_bonds(&self, bytes: &mut [u8; BONDS_BYTES]) -> usize;
    /// Keeps `bytes` instead of what was kept before, whole or not at all.
    fn save_bonds(&self, bytes: &[u8]);
    /// The wall clock as Current Time.
    fn current_time(&self) -> [u8; 10];
    /// Takes a value that a bonded phone wrote.
    fn write(&self, way: Way, value: &[u8]) -> Result<(), Refused>;
    /// Signals that there may be something to send.
    fn changed(&self) -> &Signal<NoopRawMutex, ()>;
    /// Puts the next value to send into `value`, which is as long as it may be; its characteristic and length.
    fn next(&self, value: &mut [u8]) -> Option<(Way, usize)>;
    /// The phone is gone.
    fn close(&self);
}

type Connected<'s, 'v> = GattConnection<'s, 'v, DefaultPacketPool>;
type Radio = ExternalController<SerialTransport<NoopRawMutex, &'static HciPipe, &'static HciPipe>, 4>;

/// Advertises, and serves one phone after the other, for ever. Without a radio it waits, and nothing else does. A task,
/// because a future would be compiled with its user, for speed.
#[embassy_executor::task]
pub async fn run(from_radio: &'static HciPipe, to_radio: &'static HciPipe, insole: &'static dyn Insole) -> ! {
    let radio: Radio = ExternalController::new(SerialTransport::new(from_radio, to_radio));
    let built = build_table(insole);
    let mut resources = Resources::new();
    loop {
        let stack = set_up(&radio, insole, &mut resources);
        let mut runner = stack.runner();
        // A radio that fails is set up anew.
        select(runner.run(), serve(&stack, built, insole)).await;
        insole.close();
        Timer::after(RADIO_PAUSE).await;
    }
}

/// For one phone. A new bond has a place before the oldest leaves.
type Resources = HostResources<DefaultPacketPool, 1, 0, 1, { MAX_BONDS + 1 }>;

/// Apart, like [`set_up`], because its stack would be that of everything else too.
#[inline(never)]
fn build_table(insole: &'static dyn Insole) -> &'static (Table, Server<'static>) {
    static TABLE: StaticCell<(Table, Server<'static>)> = StaticCell::new();
    // The task runs once.
    TABLE.init_with(|| Table::build(insole))
}

#[inline(never)]
fn set_up<'a>(radio: &'a Radio, insole: &'a dyn Insole, resources: &'a mut Resources) -> Host<'a> {
    let mut builder = trouble_host::new(Gate { radio, insole }, resources);
    if let Some(address) = insole.address() {
        builder = builder.set_random_address(Address::random(address));
    }
    let stack = builder.build();
    for bond in bonds::kept(insole) {
        // There is a place for each.
        let _ = stack.add_bond_information(bond.bond());
    }
    stack
}

type Host<'s> = Stack<'s, Gate<'s, Radio>, DefaultPacketPool>;

async fn serve(stack: &Host<'_>, (table, server): &(Table, Server<'_>), insole: &dyn Insole) -> Result<(), Error> {
    let mut peripheral = stack.peripheral();
    let (mut advertised, mut scanned) = ([0; 31], [0; 31]);
    let len = AdStructure::encode_slice(
        &[
            AdStructure::Flags(LE_GENERAL_DISCOVERABLE | BR_EDR_NOT_SUPPORTED),
            AdStructure::CompleteServiceUuids128(&[table::SERVICE.to_le_bytes()]),
            AdStructure::IncompleteServiceUuids16(&[service::RUNNING_SPEED_AND_CADENCE.to_le_bytes()]),
        ],
        &mut advertised,
    )?;
    let scanned_len =
        AdStructure::encode_slice(&[AdStructure::CompleteLocalName(insole.name().as_bytes())], &mut scanned)?;
    let advertisement = Advertisement::ConnectableScannableUndirected {
        adv_data: &advertised[..len],
        scan_data: &scanned[..scanned_len],
    };
    loop {
        let advertised = peripheral.advertise(&AdvertisementParameters::default(), advertisement).await;
        let advertiser = advertised.map_err(|_| Error::Other)?;
        let Ok(connection) = advertiser.accept().await else { continue };
        // Who may bond is the gate's to say.
        let _ = connection.set_bondable(true);
        let Ok(connection) = connection.with_attribute_server(server) else { continue };
        let serving = select(listen(&connection, table, stack, insole), async {
            if send(&connection, table, insole).await.is_err() {
                connection.raw().disconnect();
            }
            core::future::pending::<()>().await
        });
        // The host drops the event of the end where its queue is full.
        select(serving, async {
            while connection.raw().is_connected() {
                Timer::after(LOOK).await;
            }
        })
        .await;
        insole.close();
    }
}

/// Why a phone may not do what needs a bond.
fn guard(connection: &Connected) -> Result<(), AttErrorCode> {
    let connection = connection.raw();
    let is_encrypted = connection.security_level().is_ok_and(|level| level.encrypted());
    match (connection.is_bonded_peer(), is_encrypted) {
        (true, true) => Ok(()),
        (true, false) => Err(AttErrorCode::INSUFFICIENT_ENCRYPTION),
        (false, _) => Err(AttErrorCode::INSUFFICIENT_AUTHENTICATION),
    }
}

const fn att_error(refused: Refused) -> AttErrorCode {
    match refused {
        Refused::Length => AttErrorCode::INVALID_ATTRIBUTE_VALUE_LENGTH,
        Refused::Value => AttErrorCode::VALUE_NOT_ALLOWED,
        // The application's own.
        Refused::OutOfOrder => AttErrorCode::new(0x80),
        Refused::NotUnderstood => AttErrorCode::new(0x81),
    }
}

/// Answers a phone until it is gone.
async fn listen(connection: &Connected<'_, '_>, table: &Table, stack: &Host<'_>, insole: &dyn Insole) {
    loop {
        let event = match connection.next().await {
            GattConnectionEvent::Disconnected { .. } => return,
            GattConnectionEvent::PairingComplete { bond: Some(bond), .. }
            | GattConnectionEvent::Encrypted { bond: Some(bond), .. } => {
                bonds::remember(stack, bond, insole);
                continue;
            }
            GattConnectionEvent::Gatt { event } => event,
            _ => continue,
        };
        // Both fit their places in the table.
        let _ = connection.set(&table.battery, &insole.battery_percent());
        let _ = connection.set(&table.time, &insole.current_time());
        free_packets::<1>().await;
        let is_command = matches!(event.payload().incoming(), AttClient::Command(_));
        let reply = match event {
            GattEvent::Write(event) => {
                let handle = event.handle();
                let allowed = if table.is_guarded(handle) { guard(connection) } else { Ok(()) };
                let way = table.written(handle);
                let taken = allowed.and_then(|()| match way {
                    Some(way) => event.with_data(|_, value| insole.write(way, value)).map_err(att_error),
                    None => Ok(()),
                });
                match taken {
                    // What cannot be answered is passed over.
                    Err(_) if is_command => {
                        event.into_payload();
                        continue;
                    }
                    Err(code) => event.reject(code),
                    Ok(()) if way.is_some() => event.accept_unprocessed(),
                    Ok(()) => event.accept(),
                }
            }
            // The host does not know it, and would look for handles in an empty request.
            GattEvent::Other(event)
                if matches!(event.payload().incoming(), AttClient::Request(AttReq::ReadMultiple { .. })) =>
            {
                event.reject(AttErrorCode::REQUEST_NOT_SUPPORTED)
            }
            event => event.accept(),
        };
        if let Ok(reply) = reply {
            reply.send().await;
        }
        insole.changed().signal(());
    }
}

/// Sends what there is to send until the phone is gone.
async fn send(connection: &Connected<'_, '_>, table: &Table, insole: &dyn Insole) -> Result<(), Error> {
    let mut value = [0; MAX_VALUE];
    loop {
        insole.changed().wait().await;
        // A value is what an attribute packet holds besides its header.
        while let Some((way, len)) = {
            let room = usize::from(connection.raw().att_mtu()) - 3;
            insole.next(&mut value[..room.min(MAX_VALUE)])
        } {
            let value = &value[..len];
            match way {
                Way::Time => deliver(connection, &table.time, value).await?,
                way => deliver(connection, table.sent(way), value).await?,
            }
        }
    }
}

/// Waits until so many packets are free.
async fn free_packets<const N: usize>() {
    while [(); N].map(|()| DefaultPacketPool::allocate()).iter().any(Option::is_none) {
        Timer::after(POOL_PAUSE).await;
    }
}

/// Sends a value to a phone that subscribed: as an indication, where the characteristic has them, which ends with the
/// phone's confirmation; else as a notification.
async fn deliver<T: AsGatt>(
    connection: &Connected<'_, '_>,
    way: &Characteristic<T>,
    value: &[u8],
) -> Result<(), Error> {
    loop {
        // A request and its answer find a packet each, whatever goes out.
        free_packets::<3>().await;
        let sent = if way.props.any(&[CharacteristicProp::Indicate]) {
            way.indicate_raw(connection, value, false).await
        } else {
            way.notify_raw(connection, value, false).await
        };
        match sent {
            Err(Error::OutOfMemory) => Timer::after(POOL_PAUSE).await,
            sent => return sent,
        }
    }
}
