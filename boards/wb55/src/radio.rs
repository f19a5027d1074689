//! Bluetooth of the STM32WB55: HCI to the radio's core through memory that both cores share.
//!
//! The packets of the mailbox have the format of H4, the transport of HCI over a serial port, so the byte stream is the same as
//! that of a serial controller. In this file, the host is the Bluetooth host on this core (package `bluetooth`).

use crate::channels;
use bluetooth::{BONDING_WINDOW, HciPipe};
use core::future::pending;
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut};
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_stm32::peripherals::IPCC;
use embassy_stm32::{Peri, uid};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Read;
use heapless::Vec;
use plantar::firmware::board::BluetoothBoard;
use plantar::firmware::scan::ScanCounters;
use wb55_mailbox::connected::with_peer_address;
use wb55_mailbox::system::{CoreStop, SystemEvent, reply_status};
use wb55_mailbox::{
    BLE_INIT_OPCODE, Ble, BleInit, COMMAND, EVENT, H4_COMMAND, H4_DATA, H4_EVENT, H4_SYSTEM_COMMAND, Memory, Node,
    POOL_BYTES, POOLED, References, Shared, System,
};

#[unsafe(link_section = ".mailbox")]
static mut SHARED: MaybeUninit<Shared> = MaybeUninit::uninit();

/// The address of a field of [`SHARED`].
macro_rules! at {
    ($($field:tt)+) => {{
        // SAFETY: only an address is taken.
        unsafe { addr_of!((*addr_of!(SHARED).cast::<Shared>()).$($field)+) as u32 }
    }};
}

/// All packets that can be in a queue: the packets of the pool, the two spare packets, and the two packets in which Bluetooth's
/// answers arrive (`ble_command` and `ble_status`).
type Packets = Vec<u32, { POOLED + 4 }>;

/// Reads a word that the other core may have written.
fn read(at: u32) -> u32 {
    // SAFETY: every caller passes the address of a whole word in SHARED; those that the radio's core has written are checked by
    // `is_shared`. The access is volatile, because the other core writes to the word.
    unsafe { (at as *const u32).read_volatile() }
}

fn write(at: u32, word: u32) {
    // SAFETY: as in `read`.
    unsafe { (at as *mut u32).write_volatile(word) }
}

/// Offset of the address of the next node in a node.
const NEXT: u32 = 0;
/// Offset of the address of the previous node in a node.
const PREVIOUS: u32 = 4;
/// Offset of the H4 byte in a packet, after its node.
const H4: u32 = size_of::<Node>() as u32;

/// True if a node and the longest packet after it are in [`SHARED`], at an aligned address.
fn is_shared(packet: u32) -> bool {
    let offset = packet.wrapping_sub(addr_of!(SHARED) as u32) as usize;
    packet.is_multiple_of(4) && offset <= size_of::<Shared>() - size_of::<Node>() - EVENT
}

/// Takes the packets from a queue that belongs to this core; `None` if it was empty. More packets than expected remain in the
/// queue. An address outside of the shared memory ends the queue.
fn drain(queue: u32) -> Option<Packets> {
    let mut packets = Packets::new();
    let mut packet = read(queue + NEXT);
    while packet != queue {
        if !is_shared(packet) {
            defmt::error!("the radio's core queued a packet outside of the shared memory");
            packet = queue;
        } else if packets.push(packet).is_ok() {
            packet = read(packet + NEXT);
        } else {
            break;
        }
    }
    write(packet + PREVIOUS, queue);
    write(queue + NEXT, packet);
    Some(packets).filter(|packets| !packets.is_empty())
}

/// Appends a packet to a queue. The radio's core takes packets from it and writes the address of the last one: if that address is
/// outside of the shared memory, the packet becomes the only one in the queue.
fn append(queue: u32, packet: u32) {
    let last = Some(read(queue + PREVIOUS)).filter(|&last| is_shared(last)).unwrap_or(queue);
    write(packet + NEXT, queue);
    write(packet + PREVIOUS, last);
    write(last + NEXT, packet);
    write(queue + PREVIOUS, packet);
}

/// The bytes of a packet that belongs to this core.
fn bytes(packet: u32) -> &'static [u8] {
    let h4 = (packet + H4) as *const u8;
    // SAFETY: the packet is in SHARED, and the radio's core does not write to it until this core returns it, after the last use
    // of these bytes.
    unsafe {
        let len = match *h4 {
            H4_DATA => 5 + usize::from(u16::from_le_bytes([*h4.add(3), *h4.add(4)])),
            _ => 3 + usize::from(*h4.add(2)),
        };
        // No packet is longer, regardless of the length in its header.
        core::slice::from_raw_parts(h4, len.min(EVENT))
    }
}

/// Length of the reply to a system command: H4 byte, code, length, number of commands, opcode (2 bytes), status.
const REPLY: usize = 7;

/// The reply to a system command, which the radio's core writes to the buffer of the command. Unlike all other packets, it has
/// no node before its H4 byte: `shci_send` in ST's shci_tl.c reads it from the start of the buffer.
fn reply(command: u32) -> [u8; REPLY] {
    let [low, high] = [read(command), read(command + 4)].map(u32::to_le_bytes);
    core::array::from_fn(|i| if i < 4 { low[i] } else { high[i - 4] })
}

/// Copies a packet to a buffer that belongs to this core.
fn fill(buffer: u32, packet: &[u8]) {
    // SAFETY: every buffer has room for the longest packet of its kind.
    unsafe { core::ptr::copy_nonoverlapping(packet.as_ptr(), (buffer + H4) as *mut u8, packet.len()) }
}

/// Initialises the tables, with empty queues.
fn init_tables() {
    let unused = at!(unused);
    let references = References {
        device_info: at!(device_info),
        ble: at!(ble),
        thread: unused,
        system: at!(system),
        memory: at!(memory),
        traces: unused,
        mac: unused,
        zigbee: unused,
        lld_tests: unused,
        ble_lld: unused,
    };
    let ble = Ble { command: at!(ble_command), status: at!(ble_status), events: at!(ble_events), data: at!(ble_data) };
    let system = System { command: at!(system_command), events: at!(system_events) };
    let memory = Memory {
        spare_ble: at!(spare_ble),
        spare_system: at!(spare_system),
        pool: at!(pool),
        pool_bytes: POOL_BYTES as u32,
        free: at!(free),
        traces_pool: 0,
        traces_bytes: 0,
    };
    // SAFETY: the radio's core does not run yet, and zeros are valid for all fields.
    unsafe {
        let shared = (*addr_of_mut!(SHARED)).as_mut_ptr();
        shared.write_bytes(0, 1);
        addr_of_mut!((*shared).references).write_volatile(references);
        addr_of_mut!((*shared).ble).write_volatile(ble);
        addr_of_mut!((*shared).system).write_volatile(system);
        addr_of_mut!((*shared).memory).write_volatile(memory);
    }
    for queue in [at!(free), at!(ble_events), at!(system_events)] {
        write(queue + NEXT, queue);
        write(queue + PREVIOUS, queue);
    }
}

/// Logs the system events among these packets; other packets are ignored. Returns false if one of the events reports that the
/// radio's core has no wireless firmware.
fn log_system_events(packets: &Packets) -> bool {
    let mut has_firmware = true;
    for &packet in packets {
        match SystemEvent::decode(bytes(packet)) {
            Some(SystemEvent::Ready) => defmt::info!("radio: the wireless firmware runs"),
            Some(SystemEvent::UpdateService) => {
                defmt::error!("radio: ST's update service runs, because the wireless firmware is missing: install it");
                has_firmware = false;
            }
            Some(SystemEvent::Error(code)) => defmt::error!("radio: the radio's core reports error {=u8}", code),
            Some(SystemEvent::Other(code)) => defmt::warn!("radio: system event {=u16:x}", code),
            None => {}
        }
    }
    has_firmware
}

/// Logs whether the radio's core stopped in the previous run. To be called before the mailbox is initialised.
fn log_core_stop() {
    match CoreStop::of(read(at!(references.device_info))) {
        Some(CoreStop::Fault) => {
            // The radio's core has overwritten these two words of the mailbox with its program counter and its link register.
            let (at, from) = (read(at!(references.ble)), read(at!(references.thread)));
            defmt::error!("radio: the radio's core had a fault at {=u32:x}, called from {=u32:x}", at, from);
        }
        Some(CoreStop::Attack) => defmt::error!("radio: the radio's core stopped, because it suspected an attack"),
        None => {}
    }
}

/// After `delay`, starts the radio's core, then passes packets in both directions. Never returns. If the radio's core has no
/// firmware, or refuses its parameters, the board runs without Bluetooth, and log and status have the reason.
pub async fn run(
    delay: Duration,
    ipcc: Peri<'static, IPCC>,
    from_radio: &HciPipe,
    to_radio: &HciPipe,
    counters: &ScanCounters,
) -> ! {
    log_core_stop();
    Timer::after(delay).await;
    init_tables();
    channels::start(ipcc);
    // The first event reports that the radio's core runs. Its packet is not returned, because the remaining packets of the pool
    // suffice.
    let started = channels::receive(channels::SYSTEM, || drain(at!(system_events))).await;
    if !log_system_events(&started) {
        counters.radio_has_no_firmware();
        pending::<()>().await;
    }
    channels::send(channels::SYSTEM, || {
        let [low, high] = BLE_INIT_OPCODE.to_le_bytes();
        let parameters = BleInit::PERIPHERAL.bytes();
        fill(at!(system_command), &[H4_SYSTEM_COMMAND, low, high, parameters.len() as u8]);
        // After the four bytes of the header.
        fill(at!(system_command) + 4, parameters);
    })
    .await;
    // The radio's core empties the channel when the command is complete.
    channels::emptied(channels::SYSTEM).await;
    match reply_status(&reply(at!(system_command)), BLE_INIT_OPCODE) {
        Some(0) => {}
        Some(status) => {
            defmt::error!("radio: Bluetooth does not start, status {=u8}", status);
            counters.radio_failed(status);
            pending::<()>().await;
        }
        // The set-up of the host fails if the radio did not start, and is tried again.
        None => defmt::warn!("radio: no reply to the Bluetooth parameters"),
    }
    join(receive(from_radio), send(to_radio)).await.0
}

/// Passes packets from the radio's core to the host.
async fn receive(host: &HciPipe) -> ! {
    loop {
        let ble = channels::receive(channels::BLE, || drain(at!(ble_events)));
        let system = channels::receive(channels::SYSTEM, || drain(at!(system_events)));
        let (Either::First(packets) | Either::Second(packets)) = select(ble, system).await;
        // Only for the log: the firmware was checked at the start.
        log_system_events(&packets);
        for packet in packets {
            let h4 = bytes(packet);
            // System events are not for the host.
            if matches!(h4[0], H4_EVENT | H4_DATA) {
                match with_peer_address(h4) {
                    Some(corrected) => host.write_all(&corrected).await,
                    None => host.write_all(h4).await,
                }
            }
            // Answers have buffers of their own, which are not returned.
            if ![at!(ble_command), at!(ble_status)].contains(&packet) {
                channels::send(channels::RELEASE, || append(at!(free), packet)).await;
            }
        }
    }
}

/// Passes packets from the host to the radio's core.
async fn send(mut host: &HciPipe) -> ! {
    let mut packet = [0; COMMAND];
    loop {
        // A pipe neither ends nor fails, and no packet of the host is longer than its kind allows.
        let _ = host.read_exact(&mut packet[..4]).await;
        let (kind, len) = match packet[0] {
            H4_DATA => {
                let _ = host.read_exact(&mut packet[4..5]).await;
                (H4_DATA, 5 + usize::from(u16::from_le_bytes([packet[3], packet[4]])))
            }
            _ => (H4_COMMAND, 4 + usize::from(packet[3])),
        };
        let (buffer, channel) =
            if kind == H4_DATA { (at!(ble_data), channels::DATA) } else { (at!(ble_command), channels::BLE) };
        let head = if kind == H4_DATA { 5 } else { 4 };
        let Some(rest) = packet.get_mut(head..len) else { continue };
        let _ = host.read_exact(rest).await;
        channels::send(channel, || fill(buffer, &packet[..len])).await;
    }
}

/// The Bluetooth configuration of this board.
pub struct Wb55 {
    /// See `BootReport::is_started_by_user`.
    pub is_started_by_user: bool,
}

impl BluetoothBoard for Wb55 {
    fn address(&self) -> Option<[u8; 6]> {
        // The address is derived from the unique number of the controller.
        let id = uid::uid();
        let mut address = core::array::from_fn(|i| id[i] ^ id[i + 6]);
        // The two highest bits mark a random static address.
        address[5] |= 0xc0;
        Some(address)
    }

    fn battery_percent(&self) -> Option<u8> {
        // Not measured.
        None
    }

    fn allows_bonding(&self) -> bool {
        self.is_started_by_user && Instant::now().as_micros() < BONDING_WINDOW.as_micros()
    }
}
