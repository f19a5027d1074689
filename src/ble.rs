//! The session over Bluetooth LE, the same on every board: what the values of the package `bluetooth` mean.
//!
//! The messages are those of the serial port, [`crate::wire`], without its frames: each value of a characteristic is a piece
//! of a message ([`crate::fragment`]).

use crate::app::{Carrier, Session};
use crate::clock;
use crate::fragment::{self, Joiner, Splitter};
use crate::region::Side;
use crate::wire::{ToDevice, ToHost, decode};
pub use bluetooth::{BONDING_WINDOW, HciPipe, run};
use bluetooth::{BONDS_BYTES, Insole, Refused, Way};
use core::cell::{Cell, RefCell};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use heapless::Vec;

const _: () = assert!(BONDS_BYTES <= crate::store::MAX_BONDS_BYTES);

/// What Bluetooth asks of a board.
pub trait Board {
    /// The random static address, or `None` where the controller has a public one.
    fn address(&self) -> Option<[u8; 6]>;

    /// Charge of the battery, percent.
    fn battery_percent(&self) -> u8;

    /// The owner allows a phone to bond: power came on less than [`BONDING_WINDOW`] ago, or a button is held.
    fn allows_bonding(&self) -> bool;
}

/// The insole as [`bluetooth::run`] needs it.
pub struct OverBluetooth<'a, B> {
    session: &'a Session,
    board: B,
    /// The message that is being written, and where.
    joiner: RefCell<(Way, Joiner)>,
    /// The message that is being sent, and where.
    splitter: RefCell<(Way, Splitter)>,
    /// The pace and the setting of the clock that a phone was told last.
    shown: Cell<((u32, u8), u32)>,
}

impl<'a, B> OverBluetooth<'a, B> {
    /// Nobody connected yet.
    pub fn new(session: &'a Session, board: B) -> Self {
        Self {
            session,
            board,
            joiner: RefCell::new((Way::Control, Joiner::new())),
            splitter: RefCell::new((Way::Control, Splitter::new())),
            shown: Cell::new((session.pace(), session.clock_sets())),
        }
    }

    fn join(&self, way: Way, piece: &[u8]) -> Result<(), Refused> {
        let (joining, joiner) = &mut *self.joiner.borrow_mut();
        // What is begun on one characteristic does not go on on another.
        if core::mem::replace(joining, way) != way {
            *joiner = Joiner::new();
        }
        let message = joiner.push(piece).map_err(|refused| match refused {
            fragment::Refused::OutOfOrder => Refused::OutOfOrder,
            fragment::Refused::Empty | fragment::Refused::TooLong => Refused::Length,
        })?;
        let Some(message) = message else { return Ok(()) };
        let message = decode(message).ok_or(Refused::NotUnderstood)?;
        let is_parameters = matches!(message, ToDevice::SetTissue(_) | ToDevice::GetTissue);
        if is_parameters != (way == Way::Parameters) {
            return Err(Refused::NotUnderstood);
        }
        self.session.receive(Carrier::Bluetooth, Some(message));
        Ok(())
    }
}

/// The characteristic that an encoded message goes out on.
fn way_of(message: &[u8]) -> Way {
    match message.first() {
        Some(&ToHost::LIVE) => Way::Live,
        Some(&ToHost::STEP) => Way::Steps,
        // What is not understood is refused as an attribute error, so a refusal is one of what is to be kept.
        Some(&(ToHost::TISSUE | ToHost::REFUSED)) => Way::Parameters,
        _ => Way::Control,
    }
}

impl<B: Board> Insole for OverBluetooth<'_, B> {
    fn name(&self) -> &str {
        match self.session.hello.side {
            Side::Left => "Plantar L",
            Side::Right => "Plantar R",
        }
    }

    fn model(&self) -> &str {
        &self.session.hello.board
    }

    fn firmware(&self) -> &str {
        &self.session.hello.firmware
    }

    fn address(&self) -> Option<[u8; 6]> {
        self.board.address()
    }

    fn battery_percent(&self) -> u8 {
        self.board.battery_percent()
    }

    fn allows_bonding(&self) -> bool {
        self.board.allows_bonding()
    }

    fn load_bonds(&self, bytes: &mut [u8; BONDS_BYTES]) -> usize {
        let bonds = self.session.bonds();
        bytes.get_mut(..bonds.len()).map_or(0, |place| {
            place.copy_from_slice(&bonds);
            bonds.len()
        })
    }

    fn save_bonds(&self, bytes: &[u8]) {
        // BONDS_BYTES fit.
        self.session.keep_bonds(Vec::from_slice(bytes).unwrap_or_default());
    }

    fn current_time(&self) -> [u8; 10] {
        clock::to_current_time(self.session.unix_us())
    }

    fn write(&self, way: Way, value: &[u8]) -> Result<(), Refused> {
        let taken = match way {
            Way::Time => clock::from_current_time(value).map(|us| self.session.set_clock(us)).ok_or(Refused::Value),
            way => self.join(way, value),
        };
        taken.inspect_err(|_| self.session.count_bad_frame())
    }

    fn changed(&self) -> &Signal<NoopRawMutex, ()> {
        self.session.changed(Carrier::Bluetooth)
    }

    fn next(&self, value: &mut [u8]) -> Option<(Way, usize)> {
        let (way, splitter) = &mut *self.splitter.borrow_mut();
        if splitter.is_done() {
            let (pace, clock_sets) = self.shown.get();
            let now = self.session.pace();
            if now != pace {
                self.shown.set((now, clock_sets));
                // No optional fields, and speed 0: it is not known.
                let measurement = [0, 0, 0, now.1];
                value.get_mut(..measurement.len())?.copy_from_slice(&measurement);
                return Some((Way::Cadence, measurement.len()));
            }
            if self.session.clock_sets() != clock_sets {
                self.shown.set((pace, self.session.clock_sets()));
                let time = self.current_time();
                value.get_mut(..time.len())?.copy_from_slice(&time);
                return Some((Way::Time, time.len()));
            }
            let message = self.session.next(Carrier::Bluetooth, splitter.buffer())?;
            *way = way_of(message);
            let len = message.len();
            splitter.start(len);
        }
        splitter.next(value).map(|len| (*way, len))
    }

    fn close(&self) {
        self.session.close(Carrier::Bluetooth);
        self.joiner.borrow_mut().1 = Joiner::new();
        self.splitter.borrow_mut().1 = Splitter::new();
    }
}
