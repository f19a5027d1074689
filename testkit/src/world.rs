//! Simulated insoles in virtual time, and the events that act on them.

use crate::insole::HostInsole;
use crate::virtual_time::{advance_to, clear_timers, now_us, wake_due};
use crate::walk::{Codes, Posture};
use emulator::SensorFault;
use plantar::Side;
use plantar::storage::flash_map::SMALL_LOG;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// An event that acts on an insole or its links.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InsoleEvent {
    /// The wearer walks.
    Walk {
        /// Steps of this foot.
        steps: u32,
    },
    /// The wearer stands, shuffles or sits.
    Rest {
        /// What the wearer does.
        posture: Posture,
        /// Duration, us.
        for_us: u64,
    },
    /// Power is off for this time.
    PowerCut {
        /// Duration, us.
        off_us: u64,
    },
    /// Power fails within a write or erase operation of the flash chip, and returns after a second.
    PowerCutInWrite {
        /// Number of write and erase operations that still succeed, from now on.
        operations: u64,
    },
    /// The cable is cut for this time.
    CableCut {
        /// Duration, us.
        for_us: u64,
    },
    /// The rate of the cable is limited from now on, or no longer limited.
    CableRate {
        /// Bytes per second; 0 for no limit.
        bytes_per_s: f64,
    },
    /// Bytes to the host are damaged at random distances from now on, or no longer damaged.
    Damage {
        /// Mean number of bytes from one damaged byte to the next; 0 for no damage.
        every_bytes: u32,
    },
    /// The radio link is lost.
    RadioLost,
    /// The matrix answers only for its first rows, or not at all, for a number of frames.
    MissFrames {
        /// Number of incomplete frames.
        frames: u32,
        /// The first row for which the matrix does not answer.
        from_row: usize,
    },
    /// The sensor has a fault from now on.
    SensorFault(SensorFault),
    /// One of the tasks `scan`, `process` (processes frames), `link` (serves the serial link) and `radio` (Bluetooth) stalls, as
    /// in an endless loop.
    Stall(&'static str),
    /// The firmware panics.
    Panic,
    /// The flash chip does not answer from the next start on.
    ChipSilent,
    /// From the next start on, the firmware's first read of the bootloader's state fails in each start.
    StateReadFails,
    /// For this time, the supply voltage is too low to write or erase the flash chip.
    LowSupply {
        /// Duration, us.
        for_us: u64,
    },
    /// The supply voltage is sufficient again; scheduled by [`Self::LowSupply`].
    SupplyRecovered,
    /// For this time, the flash chip does not return what the log of load records contains.
    LogUnreadable {
        /// Duration, us.
        for_us: u64,
    },
    /// The log can be read again; scheduled by [`Self::LogUnreadable`].
    LogReadable,
    /// A cut cable is repaired; scheduled by [`Self::CableCut`].
    CableRepaired,
}

/// A scheduled event of an insole, and its time.
#[derive(Clone, Copy, Debug)]
struct Due {
    at_us: u64,
    insole: usize,
    event: InsoleEvent,
}

/// All insoles of a test.
pub struct World {
    /// The insoles: the left one first.
    pub insoles: Vec<HostInsole>,
    /// Scheduled events, sorted by time.
    due: VecDeque<Due>,
}

/// A world that hosts and tests share.
pub type SharedWorld = Rc<RefCell<World>>;

impl World {
    /// A left insole and, if `count` is 2, a right one, which scan at this rate. A thread must have only one world at a time.
    pub fn new(count: usize, rate_hz: f64) -> Self {
        clear_timers();
        let codes = |side| Rc::new(Codes::new(side, rate_hz));
        let insoles = [Side::Left, Side::Right].into_iter().take(count).map(|side| HostInsole::new(codes(side)));
        Self { insoles: insoles.collect(), due: VecDeque::new() }
    }

    /// Schedules an event of the insole with the index `insole`, at the virtual time `at_us`.
    pub fn schedule(&mut self, at_us: u64, insole: usize, event: InsoleEvent) {
        let index = self.due.partition_point(|due| due.at_us <= at_us);
        self.due.insert(index, Due { at_us, insole, event });
    }

    /// Runs all insoles until `is_done` returns true, or until the time `until_us`; returns whether `is_done` returned true.
    pub fn run(&mut self, until_us: u64, mut is_done: impl FnMut(&mut Self) -> bool) -> bool {
        loop {
            self.run_due();
            let next_timer_us = self.run_ready();
            if is_done(self) {
                return true;
            }
            if now_us() >= until_us {
                return false;
            }
            let starts = self.insoles.iter().filter_map(HostInsole::starts_at_us);
            let due = self.due.front().map(|due| due.at_us);
            let next_us = starts.chain(due).fold(until_us.min(next_timer_us), u64::min);
            advance_to(next_us.max(now_us()));
        }
    }

    /// Runs all tasks until none is ready; returns the time of the next timer, us, and `u64::MAX` if there is none.
    ///
    /// # Panics
    /// If a task never waits, so that virtual time cannot advance.
    fn run_ready(&mut self) -> u64 {
        for _ in 0..100_000 {
            let next_timer_us = wake_due();
            if !self.insoles.iter_mut().fold(false, |ran, insole| insole.run() | ran) {
                return next_timer_us;
            }
        }
        panic!("a task of the firmware never waits");
    }

    /// Runs all insoles for this duration.
    pub fn run_for(&mut self, time_us: u64) {
        self.run(now_us() + time_us, |_| false);
    }

    /// Executes the events that are due.
    fn run_due(&mut self) {
        while let Some(due) = self.due.pop_front_if(|due| due.at_us <= now_us()) {
            self.execute(due);
        }
    }

    fn execute(&mut self, Due { insole: index, event, .. }: Due) {
        // A cut that ends during another one lasts until the later end, and so do a low supply and an unreadable log.
        let continues = |end: InsoleEvent| self.due.iter().any(|due| due.insole == index && due.event == end);
        let (is_still_cut, is_still_low) =
            (continues(InsoleEvent::CableRepaired), continues(InsoleEvent::SupplyRecovered));
        let is_still_unreadable = continues(InsoleEvent::LogReadable);
        let insole = &mut self.insoles[index];
        match event {
            InsoleEvent::Walk { steps } => {
                insole.wearer.borrow_mut().walk(now_us(), steps);
            }
            InsoleEvent::Rest { posture, for_us } => insole.wearer.borrow_mut().rest(now_us(), posture, for_us),
            InsoleEvent::PowerCut { off_us } => insole.cut_power(off_us),
            InsoleEvent::PowerCutInWrite { operations } => insole.cut_power_in_operation(operations),
            InsoleEvent::CableCut { for_us } => {
                insole.cable.borrow_mut().is_cut = true;
                self.schedule(now_us() + for_us, index, InsoleEvent::CableRepaired);
            }
            InsoleEvent::CableRepaired => insole.cable.borrow_mut().is_cut = is_still_cut,
            InsoleEvent::CableRate { bytes_per_s } => {
                insole.cable.borrow_mut().byte_us = if bytes_per_s > 0.0 { 1e6 / bytes_per_s } else { 0.0 };
            }
            InsoleEvent::Damage { every_bytes } => insole.cable.borrow_mut().damaged_every = every_bytes,
            InsoleEvent::RadioLost => insole.radio.borrow_mut().set_connected(false),
            InsoleEvent::MissFrames { frames, from_row } => insole.wearer.borrow_mut().miss_frames(frames, from_row),
            InsoleEvent::SensorFault(fault) => insole.wearer.borrow_mut().add_fault(fault, now_us()),
            InsoleEvent::Stall(part) => insole.stall(part),
            InsoleEvent::Panic => insole.crash(),
            InsoleEvent::ChipSilent => insole.is_chip_silent = true,
            InsoleEvent::StateReadFails => insole.fails_state_read = true,
            InsoleEvent::LowSupply { for_us } => {
                insole.chip.0.borrow_mut().refuses_changes = true;
                self.schedule(now_us() + for_us, index, InsoleEvent::SupplyRecovered);
            }
            InsoleEvent::SupplyRecovered => insole.chip.0.borrow_mut().refuses_changes = is_still_low,
            InsoleEvent::LogUnreadable { for_us } => {
                insole.chip.0.borrow_mut().unreadable = SMALL_LOG;
                self.schedule(now_us() + for_us, index, InsoleEvent::LogReadable);
            }
            InsoleEvent::LogReadable => {
                insole.chip.0.borrow_mut().unreadable = if is_still_unreadable { SMALL_LOG } else { 0..0 };
            }
        }
    }
}
