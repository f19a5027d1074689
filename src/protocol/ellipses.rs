//! The stream of ellipses: the contact ellipses of the regions, for display. The macro `quantities` in `quantities.rs`
//! documents the form of the declaration.

use super::Refusal;
use super::quantities::{quantities, region_bytes};
use crate::num::Real;
use crate::pipeline::ellipse::Ellipse;
use serde::{Deserialize, Serialize};

/// Shortest time between two messages of the stream, us: 25 Hz.
const ELLIPSES_PERIOD_US: u32 = 40_000;

/// The contact ellipses of one frame: 8 regions in the order of [`crate::Region::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ellipses {
    /// Number of the message in its stream. A gap means that messages were replaced by a newer one in the insole, or lost on
    /// the way.
    pub sequence: u32,
    /// Time of the scan since the first scan, as in [`super::Live::t_us`], us.
    pub t_us: u64,
    /// The regions.
    #[serde(with = "ellipse_regions")]
    pub regions: [ContactEllipse; 8],
}

quantities! {
    /// The contact ellipse of a region in [`Ellipses`], in the same units as the ellipse of a region in a step. Without contact
    /// all numbers are 0.
    #[derive(Clone, Copy, Debug, PartialEq, Default)]
    pub struct ContactEllipse {
        /// Centre of the contact ellipse, to the lateral side in foot coordinates.
        x_dmm: i16 = ellipse.map_or(0, |ellipse| (ellipse.x_mm * R::of(10.0)).round_i16())
            => x_mm [10 per "mm"] if r_a_cmm,
            "Centroid of the contact area.";
        /// Centre of the contact ellipse, from heel to toe in foot coordinates.
        y_dmm: i16 = ellipse.map_or(0, |ellipse| (ellipse.y_mm * R::of(10.0)).round_i16())
            => y_mm [10 per "mm"] if r_a_cmm,
            "Centroid of the contact area.";
        /// Radius of the ellipse along the axis nearer to the medial-lateral one; 0 on the wire without contact.
        r_a_cmm: i16 = ellipse.map_or(0, |ellipse| (ellipse.r_a_mm * R::of(100.0)).round_i16())
            => r_a_mm [100 per "mm"] if r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Radius of the ellipse along the axis nearer to the heel-toe one; 0 on the wire without contact.
        r_b_cmm: i16 = ellipse.map_or(0, |ellipse| (ellipse.r_b_mm * R::of(100.0)).round_i16())
            => r_b_mm [100 per "mm"] if r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
        /// Angle from the x axis to the axis of the first radius, positive from the x axis to the y axis.
        angle_ddeg: i16 = ellipse.map_or(0, |ellipse| (ellipse.angle_deg() * 10.0).round_i16())
            => angle_deg [10 per "deg"] if r_a_cmm,
            "Uniform ellipse with the second moments of the contact area.";
    }

    /// Rounds an ellipse, as [`crate::insole::Insole::ellipse`] returns it, to the integer units of the message.
    pub fn new<R: Real>(ellipse: Option<Ellipse<R>>);
    fn numbers(&self) -> [i16];
}

// Serialising all numbers as one sequence of bytes takes a fifth of the code that serialising each number would take.
region_bytes!(ellipse_regions, ContactEllipse, i16);

/// The insole's side of the stream: determines which frames are due, and holds the newest message that was not sent yet. A
/// newer message replaces an older one, because an ellipse is soon out of date.
#[derive(Debug)]
pub struct EllipseSender {
    /// One of every `every` frames is sent; 0 without a stream.
    every: u8,
    /// Number of frames before the next one that is sent.
    skip: u8,
    /// Number of the next message.
    sequence: u32,
    newest: Option<Ellipses>,
}

impl EllipseSender {
    pub(super) const fn new() -> Self {
        Self { every: 0, skip: 0, sequence: 0, newest: None }
    }

    /// Begins a stream with one of every `every` frames, or none for 0. `period_us` is the time between frames; `None` without a
    /// valid layout.
    pub(super) fn start(&mut self, every: u8, period_us: Option<u32>) -> Result<(), Refusal> {
        let least_every = |period_us: u32| ELLIPSES_PERIOD_US.div_ceil(period_us.max(1)).min(u8::MAX.into()) as u8;
        match period_us.map(least_every) {
            None if every > 0 => return Err(Refusal::NoLayout),
            Some(least) if every > 0 && every < least => return Err(Refusal::EllipseRate { every: least }),
            _ => *self = Self { every, ..Self::new() },
        }
        Ok(())
    }

    /// Number of frames from one that is due to the next one; 0 without a stream.
    pub fn every(&self) -> u8 {
        self.every
    }

    /// To be called once for each frame. Returns the number of the message to be pushed with this frame; `None` if no message
    /// is due.
    #[inline(always)]
    pub fn due(&mut self) -> Option<u32> {
        if self.every == 0 { None } else { self.count_frame() }
    }

    #[cold]
    #[inline(never)]
    fn count_frame(&mut self) -> Option<u32> {
        let is_due = self.skip == 0;
        self.skip = if is_due { self.every } else { self.skip } - 1;
        is_due.then_some(self.sequence)
    }

    /// Queues the ellipses of a frame, in place of older ones.
    pub fn push(&mut self, ellipses: Ellipses) {
        self.sequence = ellipses.sequence.wrapping_add(1);
        self.newest = Some(ellipses);
    }

    /// The message to send next.
    pub(super) fn pop(&mut self) -> Option<Ellipses> {
        self.newest.take()
    }
}
