//! What the two cores of the STM32WB55 share, as the radio's core expects it: ST's application note AN5289 and the headers of its
//! open middleware (STM32CubeWB: mbox_def.h, tl.h, shci.h). `host-tests/tests/wb55_mailbox.rs` checks places and sizes.
//!
//! Addresses are numbers, so that a host has the same layout.

/// Longest command, event and data with their H4 byte.
pub const COMMAND: usize = 1 + 3 + 255;
pub const EVENT: usize = 1 + 2 + 255;
pub const DATA: usize = 1 + 4 + 251;
/// Events and data on their way here, of which ST's examples have five, and whole words for each.
pub const POOLED: usize = 4;
pub const POOL_BYTES: usize = POOLED * 4 * (size_of::<Node>() + EVENT).div_ceil(4);

/// H4 bytes: those of Bluetooth, and ST's for the system.
pub const H4_COMMAND: u8 = 1;
pub const H4_DATA: u8 = 2;
pub const H4_EVENT: u8 = 4;
pub const H4_SYSTEM_COMMAND: u8 = 0x10;

/// Starts the radio's side of Bluetooth: SHCI_OPCODE_C2_BLE_INIT.
pub const BLE_INIT_OPCODE: u16 = 0xfc66;

/// Where the tables are.
#[repr(C)]
pub struct References {
    pub device_info: u32,
    pub ble: u32,
    pub thread: u32,
    pub system: u32,
    pub memory: u32,
    pub traces: u32,
    pub mac: u32,
    pub zigbee: u32,
    pub lld_tests: u32,
    pub ble_lld: u32,
}

/// Bluetooth's buffers and queue.
#[repr(C)]
pub struct Ble {
    pub command: u32,
    pub status: u32,
    pub events: u32,
    pub data: u32,
}

/// The system's.
#[repr(C)]
pub struct System {
    pub command: u32,
    pub events: u32,
}

/// What packets are made of.
#[repr(C)]
pub struct Memory {
    pub spare_ble: u32,
    pub spare_system: u32,
    pub pool: u32,
    pub pool_bytes: u32,
    pub free: u32,
    pub traces_pool: u32,
    pub traces_bytes: u32,
}

/// A queue, or a packet's place in one: a ring of addresses.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Node {
    pub next: u32,
    pub previous: u32,
}

/// A packet with its H4 byte.
#[repr(C, align(4))]
pub struct Packet<const N: usize> {
    pub node: Node,
    pub h4: [u8; N],
}

/// All of it; the references come first.
#[repr(C)]
pub struct Shared {
    pub references: References,
    /// Versions, which the radio's core writes.
    pub device_info: [u32; 8],
    pub ble: Ble,
    pub system: System,
    pub memory: Memory,
    /// Tables of what is not used, the longest of four words.
    pub unused: [u32; 4],
    pub free: Node,
    pub ble_events: Node,
    pub system_events: Node,
    pub ble_command: Packet<COMMAND>,
    /// Command Status has four bytes.
    pub ble_status: Packet<7>,
    pub ble_data: Packet<DATA>,
    pub system_command: Packet<COMMAND>,
    pub spare_ble: Packet<EVENT>,
    pub spare_system: Packet<EVENT>,
    pub pool: [u32; POOL_BYTES / 4],
}

/// Parameters of [`BLE_INIT_OPCODE`]. The radio runs its link layer only, so what is for ST's own host is 0.
#[repr(C, packed)]
pub struct BleInit {
    pub unused_buffer: [u32; 2],
    pub host_attributes: [u16; 3],
    pub links: u8,
    /// Packets of 251 bytes.
    pub extended_length: u8,
    pub host_blocks: [u8; 2],
    pub host_mtu: u16,
    /// Accuracy of the sleep clock as a peripheral, ppm, and as a central, a class.
    pub peripheral_ppm: u16,
    pub central_accuracy: u8,
    /// Bit 2: the sleep clock is HSE / 1024.
    pub sleep_clock: u8,
    /// Longest connection event, 625/256 us.
    pub most_event: u32,
    /// Start of the crystal, 625/256 us.
    pub crystal_start: u16,
    pub viterbi: u8,
    /// Bit 0: the link layer only.
    pub options: u8,
    pub hardware: u8,
    pub host_channels: u8,
    pub least_dbm: i8,
    pub most_dbm: i8,
    pub receiver_model: u8,
    pub advertising_sets: u8,
    pub advertising_bytes: u16,
    /// Transmit and receive path, 0.1 dB.
    pub path_decidb: [i16; 2],
    /// 11 is 5.2.
    pub core_version: u8,
    pub more_options: u8,
    pub host_bearers: u8,
}

impl BleInit {
    /// One phone; timing as in ST's examples.
    pub const PERIPHERAL: Self = Self {
        unused_buffer: [0; 2],
        host_attributes: [0; 3],
        links: 1,
        extended_length: 1,
        host_blocks: [0; 2],
        host_mtu: 0,
        peripheral_ppm: 500,
        central_accuracy: 0,
        sleep_clock: 1 << 2,
        most_event: u32::MAX,
        crystal_start: 0x148,
        viterbi: 1,
        options: 1,
        hardware: 0,
        host_channels: 0,
        least_dbm: -40,
        most_dbm: 6,
        receiver_model: 0,
        advertising_sets: 0,
        advertising_bytes: 0,
        path_decidb: [0; 2],
        core_version: 11,
        more_options: 0,
        host_bearers: 0,
    };

    /// As they go over.
    pub fn bytes(&self) -> &[u8] {
        // SAFETY: integers without gaps.
        unsafe { core::slice::from_raw_parts((&raw const *self).cast(), size_of::<Self>()) }
    }
}
