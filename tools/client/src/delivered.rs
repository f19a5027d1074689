//! Remembers the steps that were delivered to the caller, so that each is delivered only once if the insole repeats it.

use plantar::protocol::Step;
use plantar::protocol::session::STEP_QUEUE;
use plantar::sequence;
use std::collections::VecDeque;

/// Largest number of steps that an insole can send again: those in its RAM, and as many whose acknowledgement was lost.
const CAPACITY: usize = 2 * STEP_QUEUE;

/// The last steps that were delivered, oldest first, each with whether the caller acknowledged it.
#[derive(Debug, Default)]
pub(crate) struct Delivered(VecDeque<(Step, bool)>);

impl Delivered {
    pub const fn new() -> Self {
        Self(VecDeque::new())
    }

    /// Whether the caller acknowledged this step; `None` for a step that was not delivered before.
    pub fn is_acknowledged(&self, step: &Step) -> Option<bool> {
        self.0.iter().find(|(delivered, _)| delivered.is_same(step)).map(|(_, acknowledged)| *acknowledged)
    }

    pub fn push(&mut self, step: Step) {
        if self.0.len() == CAPACITY {
            self.0.pop_front();
        }
        self.0.push_back((step, false));
    }

    /// Marks all steps up to this number as acknowledged.
    pub fn acknowledge(&mut self, number: u32) {
        for (step, acknowledged) in &mut self.0 {
            *acknowledged |= !sequence::is_after(step.step, number);
        }
    }
}
