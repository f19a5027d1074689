//! The firmware's loops, which reach the hardware through a few board traits and are independent of any chip, executor or
//! simulator.
//!
//! A board initialises its hardware, calls [`start::start`], and spawns the loops. [`scan::scan`] belongs on an interrupt
//! executor: its deadline is one frame time, and a frame that it misses is counted. [`process::process`],
//! [`serve::serve`], [`persist::persist`] and the board's Bluetooth loop share a low-priority executor. If processing is late,
//! frames wait in the board's queue; while it is full, frames are not scanned but counted. If storing is late, up to
//! [`shared::STORAGE_QUEUE`] load records (steps, load bouts, alerts) wait; further steps and bouts are dropped and counted, and
//! an alert waits until the queue has space. The link has no deadline. [`supervise`] checks that scan, processing, link,
//! storage and radio make progress.

#![allow(
    async_fn_in_trait,
    reason = "boards implement these traits for executors that do not move tasks between threads"
)]

pub mod board;
pub mod front_end;
pub mod layout;
pub mod scan;
pub mod shared;
pub mod process;
pub mod serve;
pub mod admission;
pub mod ble;
mod manage;
pub mod persist;
mod trial;
pub mod supervise;
pub mod boot_report;
pub mod start;

use crate::insole::Insole;
use crate::pipeline::setup::DEVICE_CELLS;

/// The insole of a device.
pub type DeviceInsole = Insole<f32, DEVICE_CELLS>;
