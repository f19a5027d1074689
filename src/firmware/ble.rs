//! The session over Bluetooth LE. It defines the values of the GATT characteristics, which are the same on every board.
//!
//! The messages are those of the serial port, [`crate::protocol`], without its framing: each value of a characteristic is a
//! fragment of a message ([`crate::protocol::fragment`]). The Bluetooth stack (package `bluetooth`) implements advertising,
//! bonds and the attribute table; it uses the session through [`GattServer`].

use super::board::BluetoothBoard;
use super::manage::IS_MANAGED;
use super::shared::{Carrier, Shared};
use super::supervise::Part;
use crate::protocol::fragment::{FragmentError, Joiner, Splitter};
use crate::protocol::gatt::{self, GattChannel, WriteError};
use crate::protocol::{ToDevice, current_time, decode};
use crate::storage::MAX_BONDS_BYTES;
use core::cell::{Cell, RefCell};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};
use heapless::Vec;

/// The interface of application and board to the Bluetooth stack, which uses it as a trait object: so the stack is not generic,
/// and is compiled only once, optimised for size.
pub trait GattServer {
    /// The advertised name: at most 22 bytes, and at most 11 if the insole serves management tools, because the scan response of
    /// 31 bytes then also contains the UUID of their service.
    fn name(&self) -> &str;
    /// The model number of Device Information.
    fn model(&self) -> &str;
    /// The firmware revision of Device Information.
    fn firmware(&self) -> &str;
    /// See [`BluetoothBoard::address`].
    fn address(&self) -> Option<[u8; 6]>;
    /// See [`BluetoothBoard::battery_percent`].
    fn battery_percent(&self) -> Option<u8>;
    /// See [`BluetoothBoard::allows_bonding`].
    fn allows_bonding(&self) -> bool;
    /// Copies the stored bonds, with the insole's identity key, into `bytes` and returns their length, 0 if nothing is stored.
    fn load_bonds(&self, bytes: &mut [u8; MAX_BONDS_BYTES]) -> usize;
    /// Replaces the stored bonds and the identity key, completely or not at all.
    fn save_bonds(&self, bytes: &[u8]);
    /// The wall clock as the value of Current Time.
    fn current_time(&self) -> [u8; 10];
    /// Processes a value that a bonded central wrote.
    ///
    /// # Errors
    /// The reason, which the central receives as an attribute error.
    fn write(&self, channel: GattChannel, value: &[u8]) -> Result<(), WriteError>;
    /// The signal that is set when there may be something to send.
    fn changed(&self) -> &Signal<NoopRawMutex, ()>;
    /// Writes the next value to send into `value`, which is as long as the link allows; returns its characteristic and length.
    fn next(&self, value: &mut [u8]) -> Option<(GattChannel, usize)>;
    /// Ends the session after the central disconnected.
    fn close(&self);
    /// True if the insole serves management tools, on the characteristic [`gatt::MANAGEMENT`].
    fn is_managed(&self) -> bool;
    /// False while the insole is not worn; it then advertises slowly.
    fn is_worn(&self) -> bool;
    /// Counts a heartbeat of the radio: it has executed a command. To be called every second while centrals can connect or one is
    /// connected.
    fn radio_answered(&self);
}

/// Longest time between two parts of a request of a management tool. A part that arrives later begins a new request.
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

/// The insole as a GATT server.
pub struct GattSession<'a, B> {
    shared: &'a Shared,
    board: B,
    /// The message that is being received, its characteristic, and the time of its last part.
    joiner: RefCell<(GattChannel, Joiner, Instant)>,
    /// The message that is being sent, and its characteristic.
    splitter: RefCell<(GattChannel, Splitter)>,
    /// The values of [`Shared::cadence`] and [`Shared::clock_sets`] at the last notification.
    notified: Cell<((u32, u8), u32)>,
}

impl<'a, B> GattSession<'a, B> {
    /// The state before the first connection.
    pub fn new(shared: &'a Shared, board: B) -> Self {
        Self {
            shared,
            board,
            joiner: RefCell::new((GattChannel::Control, Joiner::new(), Instant::MIN)),
            splitter: RefCell::new((GattChannel::Control, Splitter::new())),
            notified: Cell::new((shared.cadence(), shared.clock_sets())),
        }
    }

    /// Adds a fragment of a request that was written to `channel`, and passes the request on once it is complete.
    fn join(&self, channel: GattChannel, fragment: &[u8]) -> Result<(), WriteError> {
        let (joining, joiner, last_part_at) = &mut *self.joiner.borrow_mut();
        // A message that was begun on one characteristic does not continue on another. The parts of requests of management tools
        // have no numbers, so if one was lost, only the elapsed time shows that the next part begins a new request.
        let is_other = core::mem::replace(joining, channel) != channel;
        let paused = core::mem::replace(last_part_at, Instant::now()).elapsed();
        if is_other || channel == GattChannel::Management && paused > LONGEST_PAUSE {
            *joiner = Joiner::new();
        }
        let joined = match channel {
            GattChannel::Management => joiner.push_plain(fragment, mcumgr::message_bytes),
            _ => joiner.push(fragment),
        };
        let message = joined.map_err(|error| match error {
            FragmentError::OutOfOrder => WriteError::OutOfOrder,
            FragmentError::Empty | FragmentError::TooLong => WriteError::Length,
        })?;
        let Some(message) = message else { return Ok(()) };
        if channel == GattChannel::Management {
            self.shared.receive_management(Carrier::Bluetooth, message);
            return Ok(());
        }
        let message: ToDevice = decode(message).ok_or(WriteError::NotUnderstood)?;
        if GattChannel::of_request(&message) != channel {
            return Err(WriteError::NotUnderstood);
        }
        self.shared.receive(Carrier::Bluetooth, Some(message));
        Ok(())
    }

    /// The next value of a standard characteristic. The cadence is notified after each step and when it changes; the time is
    /// notified after the clock was set.
    fn next_standard(&self, value: &mut [u8]) -> Option<(GattChannel, usize)> {
        let (cadence, clock_sets) = self.notified.get();
        let new_cadence = self.shared.cadence();
        if new_cadence != cadence {
            self.notified.set((new_cadence, clock_sets));
            let (_, steps_per_min) = new_cadence;
            // RSC Measurement (running speed and cadence): flags 0 for no optional fields, then speed 0, because it is unknown.
            return write_value(value, GattChannel::Cadence, &[0, 0, 0, steps_per_min]);
        }
        if self.shared.clock_sets() != clock_sets {
            self.notified.set((cadence, self.shared.clock_sets()));
            return write_value(value, GattChannel::Time, &current_time::to_current_time(self.shared.unix_us()));
        }
        None
    }
}

fn write_value(value: &mut [u8], channel: GattChannel, bytes: &[u8]) -> Option<(GattChannel, usize)> {
    value.get_mut(..bytes.len())?.copy_from_slice(bytes);
    Some((channel, bytes.len()))
}

impl<B: BluetoothBoard> GattServer for GattSession<'_, B> {
    fn name(&self) -> &str {
        gatt::name(self.shared.hello.side)
    }

    fn model(&self) -> &str {
        &self.shared.hello.board
    }

    fn firmware(&self) -> &str {
        &self.shared.hello.firmware
    }

    fn address(&self) -> Option<[u8; 6]> {
        self.board.address()
    }

    fn battery_percent(&self) -> Option<u8> {
        self.board.battery_percent()
    }

    fn allows_bonding(&self) -> bool {
        self.board.allows_bonding()
    }

    fn load_bonds(&self, bytes: &mut [u8; MAX_BONDS_BYTES]) -> usize {
        let bonds = self.shared.bonds();
        // Bonds are at most MAX_BONDS_BYTES long.
        bytes[..bonds.len()].copy_from_slice(&bonds);
        bonds.len()
    }

    fn save_bonds(&self, bytes: &[u8]) {
        // The stack's bonds are at most MAX_BONDS_BYTES long.
        self.shared.set_bonds(Vec::from_slice(bytes).unwrap_or_default());
    }

    fn current_time(&self) -> [u8; 10] {
        current_time::to_current_time(self.shared.unix_us())
    }

    fn write(&self, channel: GattChannel, value: &[u8]) -> Result<(), WriteError> {
        let accepted = match channel {
            GattChannel::Time => current_time::from_current_time(value)
                .filter(|&unix_us| self.shared.set_clock(unix_us))
                .map(drop)
                .ok_or(WriteError::Value),
            channel => self.join(channel, value),
        };
        accepted.inspect_err(|_| self.shared.count_bad_frame())
    }

    fn changed(&self) -> &Signal<NoopRawMutex, ()> {
        self.shared.changed(Carrier::Bluetooth)
    }

    fn next(&self, value: &mut [u8]) -> Option<(GattChannel, usize)> {
        let (channel, splitter) = &mut *self.splitter.borrow_mut();
        if splitter.is_done() {
            if let Some(next) = self.next_standard(value) {
                return Some(next);
            }
            if let Some(answer) = self.shared.next_management(Carrier::Bluetooth, splitter.buffer()) {
                *channel = GattChannel::Management;
                let len = answer.len();
                splitter.start_plain(len);
            } else {
                let message = self.shared.next(Carrier::Bluetooth, splitter.buffer())?;
                *channel = GattChannel::of_message(message);
                let len = message.len();
                splitter.start(len);
            }
        }
        splitter.next(value).map(|len| (*channel, len))
    }

    fn close(&self) {
        self.shared.close(Carrier::Bluetooth);
        self.joiner.borrow_mut().1 = Joiner::new();
        self.splitter.borrow_mut().1 = Splitter::new();
    }

    fn is_managed(&self) -> bool {
        IS_MANAGED
    }

    fn is_worn(&self) -> bool {
        self.shared.scan.is_worn()
    }

    fn radio_answered(&self) {
        self.shared.scan.heartbeats.progressed(Part::Radio);
    }
}
