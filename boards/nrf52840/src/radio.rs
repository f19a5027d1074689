//! Bluetooth of the nRF52840: Nordic's controller (SoftDevice Controller), a library, behind the byte streams of the Bluetooth
//! host.
//!
//! The library has a function for each command and no function for a command packet. This file reads the packets of the host (H4,
//! the format of HCI over a serial port), calls the functions, and composes the events that report their results. All other
//! events come from the library. In this file, the host is the Bluetooth host (package `bluetooth`).
//!
//! All functions of the library must be called at the same priority, so all of this file runs in one task.

use bluetooth::{BONDING_WINDOW, HciPipe};
use bt_hci::cmd::controller_baseband::{HostBufferSize, Reset, SetEventMask, SetEventMaskPage2};
use bt_hci::cmd::info::ReadBdAddr;
use bt_hci::cmd::le::{
    LeAddDeviceToFilterAcceptList, LeAddDeviceToResolvingList, LeClearFilterAcceptList, LeClearResolvingList,
    LeLongTermKeyRequestReply, LeRand, LeReadBufferSize, LeReadFilterAcceptListSize, LeRemoveDeviceFromResolvingList,
    LeSetAddrResolutionEnable, LeSetAdvData, LeSetAdvEnable, LeSetAdvParams, LeSetEventMask, LeSetPrivacyMode,
    LeSetRandomAddr, LeSetResolvablePrivateAddrTimeout, LeSetScanResponseData,
};
use bt_hci::cmd::link_control::Disconnect;
use bt_hci::cmd::{self, Cmd, Opcode, SyncCmd};
use bt_hci::controller::ControllerCmdSync;
use bt_hci::param::{Error as HciError, Status};
use bt_hci::{AsHciBytes, FixedSizeValue, FromHciBytes};
use core::future::pending;
use embassy_futures::join::join3;
use embassy_nrf::mode::Blocking;
use embassy_nrf::rng::Rng;
use embassy_nrf::{Peri, bind_interrupts, pac, peripherals};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Read;
use nrf_sdc::mpsl::{
    ClockInterruptHandler, HighPrioInterruptHandler, LowPrioInterruptHandler, MultiprotocolServiceLayer,
    Peripherals as SchedulerPeripherals, raw as scheduler,
};
use nrf_sdc::{Builder, Error, Mem, Peripherals as ControllerPeripherals, SoftdeviceController, raw as controller};
use plantar::firmware::board::BluetoothBoard;
use plantar::firmware::scan::ScanCounters;
use static_cell::StaticCell;

use crate::matrix;

bind_interrupts!(struct Irqs {
    EGU0_SWI0 => LowPrioInterruptHandler;
    CLOCK_POWER => ClockInterruptHandler;
    RADIO => HighPrioInterruptHandler;
    TIMER0 => HighPrioInterruptHandler;
    RTC0 => HighPrioInterruptHandler;
});

/// Longest data packet, bytes: the size of the Bluetooth host's packets.
const PACKET: u16 = 251;
/// Number of packets to the central that the controller buffers.
const TX_PACKETS: u8 = 3;
/// Number of packets from the central that the controller buffers.
const RX_PACKETS: u8 = 2;
/// Memory of the controller for one central, bytes: the largest need by the macros of `sdc.h`. A link takes 923, which includes
/// one packet of 27 bytes in each direction. Each packet takes its length plus 15; the two included ones are subtracted. The
/// table of links takes 17, advertising with 31 bytes 574, and the filter accept list 68. The library logs its need if it differs
/// from this constant, and does not start if the constant is smaller. Version 0.3 of `nrf-sdc-sys` needs 2,616 of these 2,832
/// bytes.
const MEMORY: usize = {
    let packets = (TX_PACKETS + RX_PACKETS) as usize * (PACKET as usize + 15) - 2 * (27 + 15);
    (923 + packets + 17 + 574 + 68).next_multiple_of(8)
};
/// Time before the controller is asked for a packet again after an error.
const RETRY: Duration = Duration::from_millis(100);

/// Type of an H4 packet: a command.
const H4_COMMAND: u8 = 1;
/// Type of an H4 packet: data.
const H4_DATA: u8 = 2;
/// Type of an H4 packet: an event.
const H4_EVENT: u8 = 4;
/// Event Command Complete.
const COMMAND_COMPLETE: u8 = 0x0e;
/// Event Command Status.
const COMMAND_STATUS: u8 = 0x0f;
/// Length of the parameters that both events have: status, number of command packets, and opcode. In Command Complete, the
/// return parameters after the status are added to it.
const STATUS_BYTES: u8 = 4;

/// The peripherals that the radio uses.
pub struct Parts {
    /// For the scheduler of the radio, Nordic's Multiprotocol Service Layer (MPSL).
    pub scheduler: SchedulerPeripherals<'static>,
    /// For the Bluetooth controller.
    pub controller: ControllerPeripherals<'static>,
    /// For the keys of bonds, by way of the command LE Rand.
    pub rng: Peri<'static, peripherals::RNG>,
    /// True if the 32.768 kHz crystal has started; otherwise the radio uses the RC oscillator.
    pub has_crystal: bool,
}

/// Starts the radio's scheduler, which provides the high-frequency crystal, and after `delay` the Bluetooth controller. Then
/// passes packets in both directions. Never returns. If the radio does not start, the board runs without Bluetooth; the status
/// reports it, and the log has the reason.
#[embassy_executor::task]
pub async fn run(
    delay: Duration,
    parts: Parts,
    from_radio: &'static HciPipe,
    to_radio: &'static HciPipe,
    counters: &'static ScanCounters,
) -> ! {
    static SCHEDULER: StaticCell<MultiprotocolServiceLayer> = StaticCell::new();
    let clock = low_frequency_clock(parts.has_crystal);
    let layer = match MultiprotocolServiceLayer::new(parts.scheduler, Irqs, clock) {
        Ok(layer) => SCHEDULER.init(layer),
        Err(error) => {
            defmt::error!("radio: the scheduler (MPSL) does not start: {}", error);
            counters.radio_failed(0);
            pending().await
        }
    };
    // The high-frequency crystal stays on, because the internal oscillator is not accurate enough for the serial port.
    let _crystal = layer.request_hfclk().await;
    Timer::after(delay).await;
    let radio = match start(parts.controller, parts.rng, layer) {
        Ok(radio) => radio,
        Err(error) => {
            defmt::error!("radio: the Bluetooth controller does not start: {}", error);
            counters.radio_failed(0);
            pending().await
        }
    };
    // `receive` and `send` both write packets to the host. The mutex keeps each packet in one piece.
    let host = Mutex::new(from_radio);
    join3(layer.run(), receive(&radio, &host), send(&radio, to_radio, &host)).await.0
}

/// The source of the low-frequency clock. Without a crystal it is the RC oscillator, which is calibrated every 8 s,
/// or after 4 s if the temperature has changed.
fn low_frequency_clock(has_crystal: bool) -> scheduler::mpsl_clock_lfclk_cfg_t {
    let (source, rc_ctiv, rc_temp_ctiv, accuracy_ppm) = if has_crystal {
        (scheduler::MPSL_CLOCK_LF_SRC_XTAL as u8, 0, 0, 50)
    } else {
        let (interval, repeat) = (scheduler::MPSL_RECOMMENDED_RC_CTIV, scheduler::MPSL_RECOMMENDED_RC_TEMP_CTIV);
        (scheduler::MPSL_CLOCK_LF_SRC_RC as u8, interval as u8, repeat as u8, 500)
    };
    let skip_wait_lfclk_started = false;
    scheduler::mpsl_clock_lfclk_cfg_t { source, rc_ctiv, rc_temp_ctiv, accuracy_ppm, skip_wait_lfclk_started }
}

/// Starts the Bluetooth controller.
fn start(
    parts: ControllerPeripherals<'static>,
    rng: Peri<'static, peripherals::RNG>,
    layer: &'static MultiprotocolServiceLayer,
) -> Result<SoftdeviceController<'static>, Error> {
    static RANDOM: StaticCell<Rng<'static, Blocking>> = StaticCell::new();
    static CONTROLLER: StaticCell<Mem<MEMORY>> = StaticCell::new();
    let rng = Rng::new_blocking(rng);
    // Zeros and ones of the raw bits are not equally frequent.
    rng.set_bias_correction(true);
    Builder::new()?
        .support_adv()
        .support_peripheral()
        .support_dle_peripheral()
        .support_le_2m_phy()
        .support_phy_update_peripheral()
        // The host sets the lifetime of private addresses, and fails if the controller does not support them.
        .support_le_privacy()
        .peripheral_count(1)?
        .buffer_cfg(PACKET, PACKET, TX_PACKETS, RX_PACKETS)?
        .build(parts, RANDOM.init(rng), layer, CONTROLLER.init_with(Mem::new))
}

/// The pipe to the host, locked while a packet is written.
type Host<'a> = Mutex<NoopRawMutex, &'a HciPipe>;

/// Passes packets from the controller to the host.
async fn receive(radio: &SoftdeviceController<'_>, host: &Host<'_>) -> ! {
    let mut packet = [0; 1 + controller::HCI_MSG_BUFFER_MAX_SIZE as usize];
    loop {
        let len = match radio.hci_get(&mut packet[1..]).await {
            Ok(bt_hci::PacketKind::AclData) => {
                packet[0] = H4_DATA;
                5 + usize::from(u16::from_le_bytes([packet[3], packet[4]]))
            }
            Ok(_) => {
                packet[0] = H4_EVENT;
                3 + usize::from(packet[2])
            }
            Err(error) => {
                defmt::error!("radio: the controller returned no packet: {}", error);
                Timer::after(RETRY).await;
                continue;
            }
        };
        // No packet is longer than the buffer of the controller.
        if let Some(packet) = packet.get(..len) {
            host.lock().await.write_all(packet).await;
        }
    }
}

/// Passes packets from the host to the controller, and the results of commands to the host.
async fn send(radio: &SoftdeviceController<'_>, mut from_host: &HciPipe, host: &Host<'_>) -> ! {
    let mut packet = [0; 5 + 255];
    loop {
        // A pipe neither ends nor fails, and no packet of the host is longer than its kind allows.
        let _ = from_host.read_exact(&mut packet[..4]).await;
        let is_data = packet[0] == H4_DATA;
        let (head, len) = if is_data {
            let _ = from_host.read_exact(&mut packet[4..5]).await;
            (5, 5 + usize::from(u16::from_le_bytes([packet[3], packet[4]])))
        } else {
            (4, 4 + usize::from(packet[3]))
        };
        let Some(rest) = packet.get_mut(head..len) else { continue };
        let _ = from_host.read_exact(rest).await;
        match (packet[0], packet.get(1..len)) {
            (H4_DATA, Some(data)) => {
                if let Err(error) = radio.hci_data_put(data) {
                    defmt::error!("radio: the controller refused a data packet: {}", error);
                }
            }
            (H4_COMMAND, Some(command)) => {
                let mut reply = Reply::to([command[0], command[1]]);
                execute(radio, &command[3..], &mut reply).await;
                host.lock().await.write_all(reply.packet()).await;
            }
            // The host sends no other packets.
            _ => {}
        }
    }
}

/// Longest return parameters of the commands in [`execute`], bytes.
const RETURN_BYTES: usize = 8;

/// The event that reports the result of a command.
struct Reply {
    opcode: [u8; 2],
    packet: [u8; 3 + STATUS_BYTES as usize + RETURN_BYTES],
    len: usize,
}

impl Reply {
    /// A reply to the command with this opcode. It reports an unknown command until [`Reply::set_status`] or
    /// [`Reply::set_complete`] is called.
    fn to(opcode: [u8; 2]) -> Self {
        let mut reply = Self { opcode, packet: [0; _], len: 0 };
        reply.set_status(Status::UNKNOWN_CMD);
        reply
    }

    /// Reports the status of a command whose completion another event reports, or of an unknown command.
    #[inline(never)]
    fn set_status(&mut self, status: Status) {
        let [low, high] = self.opcode;
        self.set(&[H4_EVENT, COMMAND_STATUS, STATUS_BYTES, status.into_inner(), 1, low, high], &[]);
    }

    /// Reports that a command is complete.
    #[inline(never)]
    fn set_complete(&mut self, status: Status, parameters: &[u8]) {
        let [low, high] = self.opcode;
        let len = STATUS_BYTES + parameters.len() as u8;
        self.set(&[H4_EVENT, COMMAND_COMPLETE, len, 1, low, high, status.into_inner()], parameters);
    }

    #[inline(never)]
    fn set(&mut self, head: &[u8], parameters: &[u8]) {
        self.len = head.len() + parameters.len();
        for (to, from) in self.packet.iter_mut().zip(head.iter().chain(parameters)) {
            *to = *from;
        }
    }

    /// The encoded event, from its H4 type on.
    fn packet(&self) -> &[u8] {
        self.packet.get(..self.len).unwrap_or_default()
    }
}

/// The HCI status that reports this result.
fn status_of<T, E>(result: &Result<T, cmd::Error<E>>) -> Status {
    match result {
        Ok(_) => Status::SUCCESS,
        Err(cmd::Error::Hci(error)) => error.to_status(),
        Err(cmd::Error::Io(_)) => Status::HARDWARE_FAILURE,
    }
}

/// Decodes the parameters of a command.
///
/// # Errors
/// If they are not valid for the command.
fn command<'p, C: Cmd<Params: FromHciBytes<'p>> + From<C::Params>, E>(
    parameters: &'p [u8],
) -> Result<C, cmd::Error<E>> {
    let parameters = C::Params::from_hci_bytes_complete(parameters);
    parameters.map(C::from).map_err(|_| cmd::Error::Hci(HciError::INVALID_HCI_PARAMETERS))
}

/// Executes a command that bt-hci declares with a return value (`SyncCmd`), and reports its completion. Disconnect is one of
/// them, although HCI answers it with a Command Status event: bt-hci declares it with the return value `()`. Its result only
/// states that the command has begun.
async fn run_command<'r, C>(radio: &SoftdeviceController<'r>, parameters: &[u8], reply: &mut Reply)
where
    C: SyncCmd<Return: FixedSizeValue> + From<C::Params>,
    C::Params: for<'p> FromHciBytes<'p>,
    SoftdeviceController<'r>: ControllerCmdSync<C>,
{
    const { assert!(size_of::<C::Return>() <= RETURN_BYTES) };
    let result = match command::<C, _>(parameters) {
        Ok(command) => SyncCmd::exec(&command, radio).await,
        Err(error) => Err(error),
    };
    reply.set_complete(status_of(&result), result.as_ref().map_or(&[], |value| value.as_hci_bytes()));
}

/// Executes a command of the host.
async fn execute(radio: &SoftdeviceController<'_>, parameters: &[u8], reply: &mut Reply) {
    /// Calls [`run_command`] with the command that has this opcode as the type parameter.
    macro_rules! dispatch {
        ($opcode:expr; $($command:ident)*) => {
            match $opcode {
                $(<$command as Cmd>::OPCODE => run_command::<$command>(radio, parameters, reply).await,)*
                opcode => defmt::warn!("radio: the host sent the unknown command {=u16:x}", opcode.to_raw()),
            }
        };
    }
    // An opcode has two bytes, so it is never invalid.
    let Ok(opcode) = Opcode::from_hci_bytes_complete(&reply.opcode) else { return };
    // These are the commands of the Bluetooth host as a peripheral that is connected to one central at a time.
    dispatch! { opcode;
        Disconnect HostBufferSize ReadBdAddr Reset SetEventMask SetEventMaskPage2
        LeAddDeviceToFilterAcceptList LeAddDeviceToResolvingList LeClearFilterAcceptList LeClearResolvingList
        LeLongTermKeyRequestReply LeRand LeReadBufferSize LeReadFilterAcceptListSize LeRemoveDeviceFromResolvingList
        LeSetAddrResolutionEnable LeSetAdvData LeSetAdvEnable LeSetAdvParams LeSetEventMask
        LeSetPrivacyMode LeSetRandomAddr LeSetResolvablePrivateAddrTimeout LeSetScanResponseData
    }
}

/// The Bluetooth configuration of this board.
pub struct Nrf52840 {
    /// See `BootReport::is_started_by_user`.
    pub is_started_by_user: bool,
}

impl BluetoothBoard for Nrf52840 {
    fn address(&self) -> Option<[u8; 6]> {
        // A random number that Nordic wrote into each nRF52840.
        let [low, high] = [0, 1].map(|word| pac::FICR.deviceaddr(word).read().to_le_bytes());
        let mut address = [low[0], low[1], low[2], low[3], high[0], high[1]];
        // The two highest bits mark a random static address.
        address[5] |= 0xc0;
        Some(address)
    }

    fn battery_percent(&self) -> Option<u8> {
        Some(matrix::battery_percent())
    }

    fn allows_bonding(&self) -> bool {
        self.is_started_by_user && Instant::now().as_micros() < BONDING_WINDOW.as_micros()
    }
}
