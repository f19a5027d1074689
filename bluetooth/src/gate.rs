//! A filter between radio and Bluetooth host: it replaces packets to which the host would respond incorrectly.

use bt_hci::ControllerToHostPacket;
use bt_hci::cmd::controller_baseband::SetEventMaskPage2;
use bt_hci::cmd::le::LeSetAddrResolutionEnable;
use bt_hci::cmd::{self, AsyncCmd, Cmd, Opcode, SyncCmd};
use bt_hci::controller::{Controller as Hci, ControllerCmdAsync, ControllerCmdSync};
use bt_hci::data::{AclBroadcastFlag, AclPacket, AclPacketBoundary, IsoPacket, SyncPacket};
use bt_hci::param::Error as HciError;
use core::cell::Cell;
use core::future::Future;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, with_timeout};
use embedded_io_async::ErrorType;
use plantar::firmware::ble::GattServer;

/// The radio's progress since the set-up of the host began.
#[derive(Default)]
pub struct Progress {
    /// Signalled when the radio completes a synchronous command without an error.
    pub answered: Signal<NoopRawMutex, ()>,
    /// Signalled when the radio can advertise with private addresses.
    pub is_private: Signal<NoopRawMutex, ()>,
    /// Signalled while the host accepts bonds on the present connection.
    pub is_bondable: Signal<NoopRawMutex, ()>,
    /// Number of times that the radio has switched the resolution of addresses off or on. The host switches it off, passes the
    /// keys, and switches it on, so the second time completes the set-up of private addresses.
    resolution_switches: Cell<u8>,
}

impl Progress {
    /// Clears the signals and the counter, for another set-up of the host.
    pub fn reset(&self) {
        self.answered.reset();
        self.is_private.reset();
        self.is_bondable.reset();
        self.resolution_switches.set(0);
    }

    /// Signals that a synchronous command is complete without an error, and counts the switches of the resolution of addresses.
    fn completed(&self, command: Opcode) {
        if command == LeSetAddrResolutionEnable::OPCODE {
            self.resolution_switches.set(self.resolution_switches.get().saturating_add(1));
            if self.resolution_switches.get() == 2 {
                self.is_private.signal(());
            }
        }
        self.answered.signal(());
    }
}

/// A controller that filters received packets.
pub struct Gate<'a, C> {
    /// The controller of the radio.
    pub radio: &'a C,
    /// The radio's progress since the set-up of the host began.
    pub progress: &'a Progress,
    /// Decides whether bonding is allowed.
    pub insole: &'a dyn GattServer,
}

/// L2CAP channel of the attribute protocol.
const ATT_CHANNEL: u16 = 4;
/// L2CAP channel of the security manager.
const PAIRING_CHANNEL: u16 = 6;
/// Code of the command Pairing Request.
const PAIRING_REQUEST: u8 = 1;
/// Longest time for which a pairing request waits until the connection accepts bonds. Without the wait, the host would pair
/// with a central that requests it at once, but not bond, and the central would have no access although it considers itself
/// bonded.
const BONDABLE_TIMEOUT: Duration = Duration::from_secs(1);
/// An empty packet for no channel, which the host ignores.
const IGNORED: &[u8] = &[0, 0, 0, 0];
/// An undefined pairing command: the host responds that pairing failed, and does not remove a bond.
const REFUSED: &[u8] = &[2, 0, PAIRING_CHANNEL as u8, 0, 0, 0];
/// Code of the request Read By Group Type.
const READ_BY_GROUP_TYPE: u8 = 0x10;
/// Length of this request with a UUID of 128 bits, bytes. The table has no such group, and the host would panic.
const LONG_GROUP_TYPE: u16 = 21;
/// The same request with a group type of an invalid length: the host responds that it does not support the request.
const INVALID_GROUP_TYPE: &[u8] = &[6, 0, ATT_CHANNEL as u8, 0, READ_BY_GROUP_TYPE, 0, 0, 0, 0, 0];

/// Length of the shortest content with this code on the channel of attributes, bytes (Core Specification 5.4, volume 3, part F,
/// section 3.4). The host reads as many bytes without checking the length, so a shorter content would make it panic. `None` for
/// the odd codes, which are those of a server's messages: the insole is no client, so the host would store them and never remove
/// them.
const fn shortest_content(code: u8) -> Option<u16> {
    Some(match code {
        // Exchange MTU, Read, Write Request, Write Command.
        0x02 | 0x0a | 0x12 | 0x52 => 3,
        // Find Information, Read Blob, Read Multiple (the host reads the first handle; there are two at least), Prepare Write.
        0x04 | 0x0c | 0x0e | 0x16 => 5,
        // Find By Type Value, Read By Type, Read By Group Type.
        0x06 | 0x08 | READ_BY_GROUP_TYPE => 7,
        // Execute Write.
        0x18 => 2,
        // The host responds to unknown requests with an error.
        _ if code.is_multiple_of(2) => 1,
        _ => return None,
    })
}

impl<C> Gate<'_, C> {
    /// Filters the first fragment of a packet. Replaces
    ///
    /// - a fragment without a whole L2CAP header;
    /// - a fragment without any content on the channel of attributes or of pairing;
    /// - on the channel of attributes, content that is too short, messages of a server, and Read By Group Type with a UUID of 128
    ///   bits;
    /// - while bonding is not allowed, a pairing request.
    fn admit<'p>(&self, data: &'p [u8]) -> &'p [u8] {
        let &[length_low, length_high, low, high, ref body @ ..] = data else { return IGNORED };
        // The length of the content of the whole packet, without the L2CAP header. The host refuses more bytes, and waits for the
        // other fragments if there are fewer.
        let length = u16::from_le_bytes([length_low, length_high]);
        match (u16::from_le_bytes([low, high]), body.first()) {
            (ATT_CHANNEL | PAIRING_CHANNEL, None) => IGNORED,
            (ATT_CHANNEL, Some(&READ_BY_GROUP_TYPE)) if length == LONG_GROUP_TYPE => INVALID_GROUP_TYPE,
            (ATT_CHANNEL, Some(&code)) if shortest_content(code).is_none_or(|shortest| length < shortest) => IGNORED,
            _ if is_pairing_request(data) && !self.insole.allows_bonding() => REFUSED,
            _ => data,
        }
    }

    /// Waits until the connection accepts bonds, if this is the first fragment of a pairing request.
    async fn wait_until_bondable(&self, data: &[u8]) {
        // After the timeout, the central pairs without a bond, and has no access.
        if is_pairing_request(data)
            && let Ok(()) = with_timeout(BONDABLE_TIMEOUT, self.progress.is_bondable.wait()).await
        {
            // The wait consumed the signal; a further request on this connection needs it again.
            self.progress.is_bondable.signal(());
        }
    }
}

/// True for the first fragment of a pairing request.
fn is_pairing_request(data: &[u8]) -> bool {
    matches!(data, [_, _, low, high, PAIRING_REQUEST, ..] if u16::from_le_bytes([*low, *high]) == PAIRING_CHANNEL)
}

impl<C: Hci> ErrorType for Gate<'_, C> {
    type Error = C::Error;
}

impl<C: Hci> Hci for Gate<'_, C> {
    type Buffer<'a> = C::Buffer<'a>;

    fn alloc_buf(&self) -> Result<Self::Buffer<'_>, Self::Error> {
        self.radio.alloc_buf()
    }

    fn write_acl_data(&self, packet: &AclPacket) -> impl Future<Output = Result<(), Self::Error>> {
        self.radio.write_acl_data(packet)
    }

    fn write_sync_data(&self, packet: &SyncPacket) -> impl Future<Output = Result<(), Self::Error>> {
        self.radio.write_sync_data(packet)
    }

    fn write_iso_data(&self, packet: &IsoPacket) -> impl Future<Output = Result<(), Self::Error>> {
        self.radio.write_iso_data(packet)
    }

    async fn read<'a>(&self, buffer: &'a mut Self::Buffer<'_>) -> Result<ControllerToHostPacket<'a>, Self::Error> {
        Ok(match self.radio.read(buffer).await? {
            ControllerToHostPacket::Acl(acl) if acl.boundary_flag() != AclPacketBoundary::Continuing => {
                self.wait_until_bondable(acl.data()).await;
                ControllerToHostPacket::Acl(AclPacket::new(
                    acl.handle(),
                    acl.boundary_flag(),
                    AclBroadcastFlag::PointToPoint,
                    self.admit(acl.data()),
                ))
            }
            other => other,
        })
    }
}

impl<C: ControllerCmdSync<Q>, Q: SyncCmd> ControllerCmdSync<Q> for Gate<'_, C> {
    async fn exec(&self, cmd: &Q) -> Result<Q::Return, cmd::Error<Self::Error>> {
        let completed = self.radio.exec(cmd).await;
        if completed.is_ok() {
            self.progress.completed(Q::OPCODE);
        }
        match completed {
            // Without this command, the radio reports a change of encryption by the first version of the event. The host accepts
            // the refusal only with this code; ST's wireless firmware has used others.
            Err(cmd::Error::Hci(_)) if Q::OPCODE == SetEventMaskPage2::OPCODE => {
                Err(cmd::Error::Hci(HciError::UNKNOWN_CMD))
            }
            completed => completed,
        }
    }
}

impl<C: ControllerCmdAsync<Q>, Q: AsyncCmd> ControllerCmdAsync<Q> for Gate<'_, C> {
    fn exec(&self, cmd: &Q) -> impl Future<Output = Result<(), cmd::Error<Self::Error>>> {
        self.radio.exec(cmd)
    }
}
