//! The memory that the two cores of the STM32WB55 share, in the layout that the radio's core expects: ST's application note
//! AN5289 and the headers of ST's open middleware (STM32CubeWB: mbox_def.h, tl.h, shci.h). `tests/tables.rs` checks offsets and
//! sizes.
//!
//! Addresses are 32-bit numbers and not pointers, so that the layout is the same on the host that runs the tests.
#![no_std]
#![allow(missing_docs, reason = "the fields are those of ST's headers, in the same order")]

pub mod channels;
pub mod connected;
pub mod system;

/// Length of the longest command, bytes. Like every packet, it begins with its H4 byte, which states the kind of the packet.
pub const COMMAND: usize = 1 + 3 + 255;
/// Length of the longest event, bytes.
pub const EVENT: usize = 1 + 2 + 255;
/// Length of the longest data packet, bytes.
pub const DATA: usize = 1 + 4 + 251;
/// Number of packets in the pool for received events and data (ST's examples have five).
pub const POOLED: usize = 4;
/// Size of this pool, bytes. Each packet takes whole words.
pub const POOL_BYTES: usize = POOLED * 4 * (size_of::<Node>() + EVENT).div_ceil(4);

/// H4 byte of a Bluetooth command.
pub const H4_COMMAND: u8 = 1;
/// H4 byte of a Bluetooth data packet.
pub const H4_DATA: u8 = 2;
/// H4 byte of a Bluetooth event.
pub const H4_EVENT: u8 = 4;
/// H4 byte of a system command, defined by ST.
pub const H4_SYSTEM_COMMAND: u8 = 0x10;

/// The command that starts Bluetooth on the radio's core: SHCI_OPCODE_C2_BLE_INIT.
pub const BLE_INIT_OPCODE: u16 = 0xfc66;

/// The addresses of the tables (`MB_RefTable_t`).
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

/// Bluetooth's table (`MB_BleTable_t`): the addresses of the command buffer, of the buffer for Command Status, of the queue of
/// events, and of the data buffer.
#[repr(C)]
pub struct Ble {
    pub command: u32,
    pub status: u32,
    pub events: u32,
    pub data: u32,
}

/// The table of the system channel (`MB_SysTable_t`): the addresses of the command buffer and of the queue of events.
#[repr(C)]
pub struct System {
    pub command: u32,
    pub events: u32,
}

/// The table of the memory for packets (`MB_MemManagerTable_t`): the addresses of the two spare packets, the pool and its size
/// in bytes, the address of the queue of packets that this core returns, and the pool for traces, which is not used.
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

/// The head of a queue, or the links of a packet in a queue (`tListNode`). A queue is a ring of addresses.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Node {
    pub next: u32,
    pub previous: u32,
}

/// The links of a packet, and the packet of at most `N` bytes from its H4 byte on.
#[repr(C, align(4))]
pub struct Packet<const N: usize> {
    pub node: Node,
    pub h4: [u8; N],
}

/// All of the shared memory. The references must come first.
#[repr(C)]
pub struct Shared {
    pub references: References,
    /// Versions, which the radio's core writes.
    pub device_info: [u32; 8],
    pub ble: Ble,
    pub system: System,
    pub memory: Memory,
    /// Stands for the tables of unused functions, of which the longest has four words.
    pub unused: [u32; 4],
    pub free: Node,
    pub ble_events: Node,
    pub system_events: Node,
    pub ble_command: Packet<COMMAND>,
    /// Seven bytes: H4 byte, code and length, and the four bytes of a Command Status.
    pub ble_status: Packet<7>,
    pub ble_data: Packet<DATA>,
    pub system_command: Packet<COMMAND>,
    pub spare_ble: Packet<EVENT>,
    pub spare_system: Packet<EVENT>,
    pub pool: [u32; POOL_BYTES / 4],
}

/// Parameters of [`BLE_INIT_OPCODE`] (`SHCI_C2_Ble_Init_Cmd_Param_t`). The radio's core runs its link layer only, so the
/// parameters of ST's own host (`host_...`) are 0.
///
/// The structure has grown at its end. These are its 47 bytes in STM32CubeWB 1.23: version 1.16 added `more_options`, and version
/// 1.23 `host_bearers`. Version 1.24 adds the address and the size of a buffer, 8 bytes. A radio's core with this version finds
/// zeros in their place, because the command buffer is zeroed before this first command. `docs/bring-up.md` has the assumption
/// that the radio's core accepts other lengths than its own.
#[repr(C, packed)]
pub struct BleInit {
    pub unused_buffer: [u32; 2],
    pub host_attributes: [u16; 3],
    /// Largest number of connections.
    pub links: u8,
    /// 1 for data packets of up to 251 bytes.
    pub extended_length: u8,
    pub host_blocks: [u8; 2],
    pub host_mtu: u16,
    /// Accuracy of the sleep clock: as a peripheral in ppm, as a central by class.
    pub peripheral_ppm: u16,
    pub central_accuracy: u8,
    /// Bit 2: the sleep clock is HSE / 1024.
    pub sleep_clock: u8,
    /// Longest connection event, in units of 625/256 us.
    pub most_event: u32,
    /// Start-up time of the crystal, in units of 625/256 us.
    pub crystal_start: u16,
    /// 1 if the receiver uses the Viterbi algorithm.
    pub viterbi: u8,
    /// Bit 0: the radio runs its link layer only.
    pub options: u8,
    /// Reserved; 0.
    pub hardware: u8,
    pub host_channels: u8,
    /// Lowest transmit power, dBm.
    pub least_dbm: i8,
    /// Highest transmit power, dBm.
    pub most_dbm: i8,
    /// Model of the automatic gain control: 0 for the older one, 1 for the one with better resistance to interference.
    pub receiver_model: u8,
    /// Number of sets of extended advertising, which is not used.
    pub advertising_sets: u8,
    /// Longest data of extended advertising, bytes.
    pub advertising_bytes: u16,
    /// Compensation of the transmit and the receive path, in units of 0.1 dB.
    pub path_decidb: [i16; 2],
    /// 11 stands for version 5.2.
    pub core_version: u8,
    /// Further options, which concern ST's own host only.
    pub more_options: u8,
    pub host_bearers: u8,
}

impl BleInit {
    /// Parameters for one central, with the timing of ST's examples.
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

    /// The parameters as they are sent.
    pub fn bytes(&self) -> &[u8] {
        // SAFETY: the struct is packed, so it consists of initialised integers without padding.
        unsafe { core::slice::from_raw_parts((&raw const *self).cast(), size_of::<Self>()) }
    }
}
