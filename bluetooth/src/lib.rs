//! The insole as a Bluetooth LE peripheral: advertising, bonds, and the GATT table of `docs/bluetooth.md`. The values of the
//! characteristics are defined in [`plantar::firmware::ble`]. In this package, the host is the Bluetooth host (`trouble-host`),
//! which runs on the insole.
//!
//! This is a separate package because it is compiled for size, while the data path is compiled for speed. Its entry point,
//! [`run`], is not generic: generic code would be compiled with its caller.
#![no_std]
#![forbid(unsafe_code)]

mod bonds;
mod gate;
mod table;

use bonds::Keys;
use bt_hci::cmd::le::LeRand;
use bt_hci_serial::SerialTransport;
use embassy_futures::select::{Either, select, select3};
use embassy_sync::blocking_mutex::raw::{CriticalSectionRawMutex, NoopRawMutex};
use embassy_sync::pipe::Pipe;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use gate::{Gate, Progress};
use plantar::firmware::admission::Admission;
use plantar::firmware::ble::GattServer;
use plantar::protocol::gatt::{self, GattChannel, WriteError};
use static_cell::StaticCell;
use table::{Attributes, Server, Table};
use trouble_host::att::{AttClient, AttErrorCode, AttReq};
use trouble_host::prelude::*;

/// Time after power-on, or after a reset by the user, in which a central can bond.
pub const BONDING_WINDOW: Duration = Duration::from_secs(60);
/// Largest number of stored bonds. A further bond replaces the least recently used bond.
pub const MAX_BONDS: usize = 4;

/// Time before a radio that failed is set up again. Each set-up computes public keys, which delays the evaluation of the frames
/// by some tenths of a second and costs most steps in which it falls. Several set-ups must fit into the time after which the
/// supervision restarts the board.
const RADIO_RETRY: Duration = Duration::from_secs(4);
/// Time before a packet is requested again from an exhausted pool.
const POOL_RETRY: Duration = Duration::from_millis(10);
/// Time between two checks whether the radio answers.
const RADIO_CHECK: Duration = Duration::from_secs(1);
/// Time between two checks whether the central is still connected or, while the insole advertises, whether it is worn.
const CONNECTION_CHECK: Duration = Duration::from_millis(200);

/// Time between two advertisements of a worn insole: an interval of Apple's guidelines for accessories, which also fits the
/// windows in which other phones scan. A phone finds the insole within a second.
const ADVERTISING_WORN: Duration = Duration::from_micros(152_500);
/// Time between two advertisements of an insole that is not worn, also one of these intervals. It is longer, to save energy; a
/// phone finds the insole within some seconds.
const ADVERTISING_UNWORN: Duration = Duration::from_millis(1_285);

/// What the insole requests of a central, within the rules of Apple's guidelines for accessories. Without a request, phones and
/// computers have chosen intervals up to 60 ms, too long for 100 live frames a second, and Linux a timeout of 0.42 s, in which a
/// body between insole and computer interrupts the link.
const LINK: RequestedConnParams = RequestedConnParams {
    min_connection_interval: Duration::from_millis(15),
    max_connection_interval: Duration::from_millis(30),
    max_latency: 0,
    min_event_length: Duration::from_ticks(0),
    max_event_length: Duration::from_ticks(0),
    supervision_timeout: Duration::from_secs(4),
};

/// Timeout of sending this request: a radio that does not take it must not keep the insole from serving the central.
const LINK_REQUEST: Duration = Duration::from_secs(1);

/// Least ATT MTU that a central may have, bytes (Bluetooth Core Specification 5.4, Vol. 3, Part G, 5.2.1).
const LEAST_ATT_MTU: usize = 23;

/// The HCI byte stream (H4) between radio and Bluetooth host, in one direction.
pub type HciPipe = Pipe<CriticalSectionRawMutex, 128>;

/// A connection with a central.
type Connected<'s, 'v> = GattConnection<'s, 'v, DefaultPacketPool>;
/// The controller behind its HCI byte streams.
type Radio = ExternalController<SerialTransport<NoopRawMutex, &'static HciPipe, &'static HciPipe>, 4>;

/// Advertises, and serves one central at a time. Never returns. As long as the radio has not responded, this task waits, and no
/// other task is affected; for a radio that responds with errors, see [`RADIO_RETRY`]; if a radio that has responded stops for
/// 30 s, the supervision restarts the board. It is a task and not an async function, because the future of a function would be
/// compiled with its caller, for speed.
#[embassy_executor::task]
pub async fn run(from_radio: &'static HciPipe, to_radio: &'static HciPipe, insole: &'static dyn GattServer) -> ! {
    let radio: Radio = ExternalController::new(SerialTransport::new(from_radio, to_radio));
    let (table, server) = build_table(insole);
    let mut admission = Admission::new();
    let mut resources = Resources::new();
    let progress = Progress::default();
    loop {
        progress.reset();
        let (stack, has_key) = set_up(&radio, &progress, insole, &mut resources);
        let (mut rx, mut control, mut tx) = stack.runner().split();
        // If the radio fails, or the identity key was just created, one of these futures ends, and the host is set up again.
        select3(rx.run(), control.run(), async {
            // Without an answer of the radio, `tx` and `serve` would run in a busy loop, so they start after the first one.
            progress.answered.wait().await;
            if let Ok(false) = create_identity_key(&stack, insole).await {
                // Until the radio has the key, it would advertise with the address that does not change.
                if has_key {
                    progress.is_private.wait().await;
                }
                let served = serve(&stack, table, server, insole, &mut admission, &progress);
                select3(tx.run(), served, check_radio(&stack, insole)).await;
            }
        })
        .await;
        insole.close();
        Timer::after(RADIO_RETRY).await;
    }
}

/// Resources of the Bluetooth host for one central. There is room for one more bond, because a new bond is added before the least
/// recently used one is removed.
type Resources = HostResources<DefaultPacketPool, 1, 0, 1, { MAX_BONDS + 1 }>;

/// Builds the GATT table and its server. Like [`set_up`], it is not inlined: its local variables would otherwise be part of the
/// stack frame of every poll of the task [`run`].
#[inline(never)]
fn build_table(insole: &'static dyn GattServer) -> (&'static Table, &'static Server<'static>) {
    // The cells of this function and of `start_server` are initialised once, because the task runs once.
    static TABLE: StaticCell<Table> = StaticCell::new();
    let mut attributes = Attributes::new();
    let table = Table::build(&mut attributes, insole);
    (TABLE.init(table), start_server(attributes))
}

/// Builds the server in its static memory. If this function were inlined, or the server passed to `init`, the stack would hold
/// one or two more copies of the attributes, 2 KiB each, which is more than any later use of the stack without a pairing.
#[inline(never)]
fn start_server(attributes: Attributes<'static>) -> &'static Server<'static> {
    static SERVER: StaticCell<Server<'static>> = StaticCell::new();
    SERVER.uninit().write(AttributeServer::new(attributes))
}

/// Sets up the Bluetooth host with the address, the identity key and the bonds of the insole. Returns the host, and true if the
/// insole has an identity key: the controller then advertises with private addresses, which it changes every 15 minutes, and only
/// bonded centrals recognise the insole.
#[inline(never)]
fn set_up<'a>(
    radio: &'a Radio,
    progress: &'a Progress,
    insole: &'a dyn GattServer,
    resources: &'a mut Resources,
) -> (Host<'a>, bool) {
    let mut builder = trouble_host::new(Gate { radio, progress, insole }, resources);
    if let Some(address) = insole.address() {
        builder = builder.set_random_address(Address::random(address));
    }
    let Keys { identity_key, bonds } = bonds::load(insole);
    let key = identity_key.and_then(IdentityResolvingKey::from_le_bytes);
    if let Some(key) = key {
        builder = builder.enable_privacy(key);
    }
    let stack = builder.build();
    for bond in bonds {
        // The host has room for all stored bonds.
        let _ = stack.add_bond_information(bond.bond());
    }
    (stack, key.is_some())
}

/// Creates and stores the insole's identity key, if it has none and no central has bonded: the address that a bonded central
/// knows must not change. Returns true if it created the key, which the next set-up of the host uses.
async fn create_identity_key(stack: &Host<'_>, insole: &dyn GattServer) -> Result<bool, Error> {
    let mut keys = bonds::load(insole);
    if keys.identity_key.is_some() || !keys.bonds.is_empty() {
        return Ok(false);
    }
    let mut key = [0; 16];
    for half in key.chunks_exact_mut(8) {
        let random = stack.command(LeRand::new()).await.map_err(|_| Error::Other)?;
        half.copy_from_slice(random.as_slice());
    }
    keys.identity_key = Some(key);
    bonds::store(&keys, insole);
    Ok(true)
}

/// The Bluetooth host.
type Host<'s> = Stack<'s, Gate<'s, Radio>, DefaultPacketPool>;

/// Lets the radio execute a command every second, and counts its heartbeats. Returns if the radio refuses the command; the
/// supervision detects a radio that does not answer.
async fn check_radio(stack: &Host<'_>, insole: &dyn GattServer) -> Result<(), Error> {
    loop {
        // The wait comes first, so that no heartbeat is counted if advertising fails at once and ends this function.
        Timer::after(RADIO_CHECK).await;
        stack.command(LeRand::new()).await.map_err(|_| Error::Other)?;
        insole.radio_answered();
    }
}

/// Advertises and serves centrals. Returns if the radio fails.
async fn serve(
    stack: &Host<'_>,
    table: &Table,
    server: &Server<'_>,
    insole: &dyn GattServer,
    admission: &mut Admission,
    progress: &Progress,
) -> Result<(), Error> {
    let mut peripheral = stack.peripheral();
    let (mut advertising_bytes, mut scan_response_bytes) = ([0; 31], [0; 31]);
    let advertising_len = AdStructure::encode_slice(
        &[
            AdStructure::Flags(LE_GENERAL_DISCOVERABLE | BR_EDR_NOT_SUPPORTED),
            AdStructure::CompleteServiceUuids128(&[gatt::SERVICE.to_le_bytes()]),
            AdStructure::IncompleteServiceUuids16(&[service::RUNNING_SPEED_AND_CADENCE.to_le_bytes()]),
        ],
        &mut advertising_bytes,
    )?;
    let scan_response = [
        AdStructure::CompleteLocalName(insole.name().as_bytes()),
        AdStructure::IncompleteServiceUuids128(&[gatt::MANAGEMENT_SERVICE.to_le_bytes()]),
    ];
    let structures = if insole.is_managed() { &scan_response[..] } else { &scan_response[..1] };
    let scan_response_len = AdStructure::encode_slice(structures, &mut scan_response_bytes)?;
    let advertisement = Advertisement::ConnectableScannableUndirected {
        adv_data: &advertising_bytes[..advertising_len],
        scan_data: &scan_response_bytes[..scan_response_len],
    };
    loop {
        progress.is_bondable.reset();
        let is_worn = insole.is_worn();
        let interval = if is_worn { ADVERTISING_WORN } else { ADVERTISING_UNWORN };
        let parameters =
            AdvertisementParameters { interval_min: interval, interval_max: interval, ..Default::default() };
        let advertiser = peripheral.advertise(&parameters, advertisement).await;
        let advertiser = advertiser.map_err(|_| Error::Other)?;
        let other_interval_due = async {
            while insole.is_worn() == is_worn {
                Timer::after(CONNECTION_CHECK).await;
            }
        };
        let Either::First(Ok(connection)) = select(advertiser.accept(), other_interval_due).await else { continue };
        // The host always allows bonding: the gate rejects pairing requests while the insole does not allow it.
        let _ = connection.set_bondable(true);
        progress.is_bondable.signal(());
        // The central may refuse: the link then remains as the central has set it up. The request comes before all others,
        // because a future within that of `answer` would need further RAM.
        let _ = with_timeout(LINK_REQUEST, connection.update_connection_params(stack, &LINK)).await;
        let Ok(connection) = connection.with_attribute_server(server) else { continue };
        let serving = select(answer(&connection, table, stack, insole), async {
            if send(&connection, table, insole).await.is_err() {
                connection.raw().disconnect();
            }
            core::future::pending::<()>().await
        });
        // The host drops the event of a disconnection if its queue is full, so the connection is also checked periodically.
        let connected_at = Instant::now();
        let mut was_admitted = false;
        select(serving, async {
            while connection.raw().is_connected() {
                let is_admitted = guard(&connection).is_ok();
                was_admitted |= is_admitted;
                let limit = admission.time_limit(connection.raw().is_bonded_peer(), insole.allows_bonding());
                if !is_admitted && connected_at.elapsed() >= limit {
                    connection.raw().disconnect();
                }
                Timer::after(CONNECTION_CHECK).await;
            }
        })
        .await;
        admission.ended(connected_at.elapsed(), was_admitted);
        insole.close();
    }
}

/// Checks that the central is bonded and the link encrypted.
///
/// # Errors
/// The ATT error that makes the central pair or encrypt.
fn guard(connection: &Connected) -> Result<(), AttErrorCode> {
    let connection = connection.raw();
    let is_encrypted = connection.security_level().is_ok_and(|level| level.encrypted());
    match (connection.is_bonded_peer(), is_encrypted) {
        (true, true) => Ok(()),
        (true, false) => Err(AttErrorCode::INSUFFICIENT_ENCRYPTION),
        (false, _) => Err(AttErrorCode::INSUFFICIENT_AUTHENTICATION),
    }
}

/// The ATT error for a value that was not accepted.
const fn att_error(error: WriteError) -> AttErrorCode {
    match error {
        WriteError::Length => AttErrorCode::INVALID_ATTRIBUTE_VALUE_LENGTH,
        WriteError::Value => AttErrorCode::VALUE_NOT_ALLOWED,
        // Error codes of the application; see docs/bluetooth.md.
        WriteError::OutOfOrder => AttErrorCode::new(0x80),
        WriteError::NotUnderstood => AttErrorCode::new(0x81),
    }
}

/// Processes the requests of a central until it disconnects.
async fn answer(connection: &Connected<'_, '_>, table: &Table, stack: &Host<'_>, insole: &dyn GattServer) {
    loop {
        let event = match connection.next().await {
            GattConnectionEvent::Disconnected { .. } => return,
            GattConnectionEvent::PairingComplete { bond: Some(bond), .. }
            | GattConnectionEvent::Encrypted { bond: Some(bond), .. } => {
                bonds::remember(stack, bond, insole);
                // Values have waited for the encryption.
                insole.changed().signal(());
                continue;
            }
            GattConnectionEvent::Gatt { event } => event,
            _ => continue,
        };
        // Setting cannot fail: the values have the types of their attributes.
        if let (Some(battery), Some(percent)) = (&table.battery, insole.battery_percent()) {
            let _ = connection.set(battery, &percent);
        }
        let _ = connection.set(&table.time, &insole.current_time());
        wait_for_free_packets::<1>().await;
        let is_command = matches!(event.payload().incoming(), AttClient::Command(_));
        let reply = match event {
            GattEvent::Write(event) => {
                let handle = event.handle();
                let allowed = if table.is_guarded(handle) { guard(connection) } else { Ok(()) };
                let channel = table.writable_channel(handle);
                let accepted = allowed.and_then(|()| match channel {
                    Some(channel) => event.with_data(|_, value| insole.write(channel, value)).map_err(att_error),
                    None => Ok(()),
                });
                match accepted {
                    // A command has no response, not even an error.
                    Err(_) if is_command => {
                        event.into_payload();
                        continue;
                    }
                    Err(code) => event.reject(code),
                    // The insole has taken the value, so the host does not store it in the table. The host processes all other
                    // writes, such as subscriptions.
                    Ok(()) if channel.is_some() => event.accept_unprocessed(),
                    Ok(()) => event.accept(),
                }
            }
            // The host would respond with an error even to a command, and a central could take it for the response to its
            // next request.
            GattEvent::NotAllowed(event) if is_command => {
                event.into_payload();
                continue;
            }
            // The host does not implement Read Multiple, and would respond that the attribute is missing.
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

/// Sends values until the central disconnects. Nothing is sent before the link of a bonded central is encrypted: the host assigns
/// the stored subscriptions to the central's address, which a stranger can copy.
async fn send(connection: &Connected<'_, '_>, table: &Table, insole: &dyn GattServer) -> Result<(), Error> {
    let mut value = [0; gatt::MAX_VALUE];
    loop {
        insole.changed().wait().await;
        if guard(connection).is_err() {
            continue;
        }
        // A notification has a header of three bytes. A central can request an ATT MTU below the least valid one, which the host
        // does not refuse.
        while let Some((channel, len)) = {
            let room = usize::from(connection.raw().att_mtu()).max(LEAST_ATT_MTU) - 3;
            insole.next(&mut value[..room.min(gatt::MAX_VALUE)])
        } {
            let value = &value[..len];
            match channel {
                GattChannel::Time => deliver(connection, &table.time, value).await?,
                channel => deliver(connection, table.stream(channel), value).await?,
            }
        }
    }
}

/// Waits until `N` packets are free.
async fn wait_for_free_packets<const N: usize>() {
    while [(); N].map(|()| DefaultPacketPool::allocate()).iter().any(Option::is_none) {
        Timer::after(POOL_RETRY).await;
    }
}

/// Sends a value to a central that has subscribed: as an indication if the characteristic has indications, otherwise as a
/// notification. After an indication, it returns once the central has confirmed it.
async fn deliver<T: AsGatt>(
    connection: &Connected<'_, '_>,
    characteristic: &Characteristic<T>,
    value: &[u8],
) -> Result<(), Error> {
    loop {
        // One packet for the value; the others remain for a request and its response.
        wait_for_free_packets::<3>().await;
        let sent = if characteristic.props.any(&[CharacteristicProp::Indicate]) {
            characteristic.indicate_raw(connection, value, false).await
        } else {
            characteristic.notify_raw(connection, value, false).await
        };
        match sent {
            Err(Error::OutOfMemory) => Timer::after(POOL_RETRY).await,
            sent => return sent,
        }
    }
}
