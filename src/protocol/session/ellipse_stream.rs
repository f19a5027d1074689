//! The stream of ellipses in a session.

use super::Session;
use crate::pipeline::setup::Setup;
use crate::protocol::{ELLIPSES_PERIOD_US, Ellipses, Refusal};

impl Session {
    /// Begins a stream of ellipses with one of every `every` frames, or none for 0; refuses a rate above 25 Hz.
    pub(super) fn start_ellipses(&mut self, every: u8) {
        let least = |setup: &Setup| ELLIPSES_PERIOD_US.div_ceil(setup.period_us.max(1)).min(u8::MAX.into()) as u8;
        match self.setup().map(least) {
            _ if every == 0 => self.ellipses.start(0),
            None => self.refuse(Refusal::NoLayout),
            Some(least) if every < least => self.refuse(Refusal::EllipseRate { every: least }),
            Some(_) => self.ellipses.start(every),
        }
    }

    /// One of so many frames is due in the stream of ellipses; 0 without a stream.
    pub fn ellipses_every(&self) -> u8 {
        self.ellipses.every
    }

    /// The number of the message with ellipses that is due with this frame. To be called once for each frame.
    #[inline(always)]
    pub fn next_ellipses(&mut self) -> Option<u32> {
        if self.ellipses.every == 0 { None } else { self.ellipses.count_frame() }
    }

    /// Holds the ellipses of a frame until the carrier has sent everything else, in place of older ones.
    pub fn push_ellipses(&mut self, ellipses: Ellipses) {
        self.ellipses.push(ellipses);
    }
}
