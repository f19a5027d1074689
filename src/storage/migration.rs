//! Older formats of stored data.

use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use crate::protocol::{Step, StepRegion};
use serde::Deserialize;

/// Decodes an older version of a record. All kinds are at version 1, so there is no older version yet.
pub(super) fn record<R>(_version: u8, _bytes: &[u8]) -> Option<R> {
    None
}

/// Number of bytes of a [`StepRegion`] in version 1, which lacks the fields after the ellipse.
const REGION_V1_BYTES: usize = 30;

/// Version 1 of the entries of the step log.
#[derive(Deserialize)]
#[allow(clippy::large_enum_variant, reason = "it exists for a moment")]
pub(super) enum EntryV1 {
    Step { boot: u32, step: StepV1 },
    Acknowledged { next: u32 },
}

/// Version 1 of a step, without the wall clock and masked cells.
#[derive(Deserialize)]
pub(super) struct StepV1 {
    step: u32,
    side: Side,
    start_us: u64,
    duration_us: u32,
    sample_us: u32,
    bridged_frames: u16,
    saturated: u8,
    clamped: u8,
    contact_rule: ContactRule,
    regions: [[u8; REGION_V1_BYTES]; 8],
}

fn region_from_v1(bytes: [u8; REGION_V1_BYTES]) -> StepRegion {
    let mut padded = [0; 2 * REGION_V1_BYTES];
    padded[..REGION_V1_BYTES].copy_from_slice(&bytes);
    // All numbers have a fixed length, so any bytes are a region. Those of later versions are 0.
    postcard::take_from_bytes(&padded).map(|(region, _)| region).unwrap_or_default()
}

impl From<StepV1> for Step {
    fn from(old: StepV1) -> Self {
        Self {
            step: old.step,
            side: old.side,
            start_us: old.start_us,
            duration_us: old.duration_us,
            sample_us: old.sample_us,
            bridged_frames: old.bridged_frames,
            saturated: old.saturated,
            clamped: old.clamped,
            contact_rule: old.contact_rule,
            regions: old.regions.map(region_from_v1),
            boots_since: 0,
            start_unix_us: None,
        }
    }
}
