//! Older formats of stored data.

use crate::pipeline::contact::ContactRule;
use crate::pipeline::region::Side;
use crate::protocol::{Step, StepFoot, StepRegion, decode};
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// Decodes version 1 of one of the records in [`super::records`], which have versions of their own. Only
/// [`IdentifiedRecord`](super::IdentifiedRecord) has a later one: version 1 lacks its last byte, the identified regions. Without
/// this knowledge, no region is tracked. A version 1 of this record without an identification cannot be decoded, and counts as
/// missing; the effect is the same.
pub(super) fn record<R: DeserializeOwned>(bytes: &[u8]) -> Option<R> {
    let mut padded = [0; 64];
    padded.get_mut(..bytes.len())?.copy_from_slice(bytes);
    decode(padded.get(..bytes.len() + 1)?)
}

/// Number of bytes of a [`StepRegion`] in version 1, which lacks the fields after the model error.
const REGION_V1_BYTES: usize = 30;
/// Number of bytes of a [`StepRegion`] in version 2, which lacks the fields after the number of masked cells.
const REGION_V2_BYTES: usize = 31;

/// An older version of the entries of the step log.
#[derive(Deserialize)]
#[allow(clippy::large_enum_variant, reason = "a value exists only while an entry is decoded")]
pub(super) enum OldEntry<S> {
    Step { boot: u32, step: S },
    Acknowledged { next: u32 },
}

/// Version 1 of a step, which lacks the number of boots, the wall clock, the masked cells, and the fields that version 2 lacks.
#[derive(Deserialize)]
pub(super) struct StepV1 {
    head: StepHead,
    regions: [[u8; REGION_V1_BYTES]; 8],
}

/// Version 2 of a step, which lacks the results of tracking ([`Step::refit`] and the change of the stiffness of each region), the
/// measures of the foot and those of the regions.
#[derive(Deserialize)]
pub(super) struct StepV2 {
    head: StepHead,
    regions: [[u8; REGION_V2_BYTES]; 8],
    boots_since: u32,
    start_unix_us: Option<u64>,
}

/// The first fields of a step, which all versions have.
#[derive(Deserialize)]
struct StepHead {
    step: u32,
    side: Side,
    start_us: u64,
    duration_us: u32,
    sample_us: u32,
    bridged_frames: u16,
    saturated: u8,
    clamped: u8,
    contact_rule: ContactRule,
}

impl StepHead {
    /// The step with these regions. The fields that older versions lack are 0.
    fn step<const N: usize>(self, regions: [[u8; N]; 8]) -> Step {
        Step {
            step: self.step,
            side: self.side,
            start_us: self.start_us,
            duration_us: self.duration_us,
            sample_us: self.sample_us,
            bridged_frames: self.bridged_frames,
            saturated: self.saturated,
            clamped: self.clamped,
            contact_rule: self.contact_rule,
            regions: regions.map(|region| region_of(&region)),
            boots_since: 0,
            start_unix_us: None,
            refit: 0,
            foot: StepFoot::default(),
        }
    }
}

/// Decodes the bytes of a region of an older version, which is a prefix of the present one, but for the unit of two numbers.
fn region_of(bytes: &[u8]) -> StepRegion {
    // More bytes than a region of the present version has.
    let mut padded = [0; 64];
    padded[..bytes.len()].copy_from_slice(bytes);
    // All numbers have a fixed length, so any bytes are a region. The numbers that the older version lacks are 0.
    let mut region: StepRegion = postcard::take_from_bytes(&padded).map(|(region, _)| region).unwrap_or_default();
    // The older versions stored these two in 0.01 N s.
    for integral in [&mut region.measured_integral_dns, &mut region.model_integral_dns] {
        *integral = integral.saturating_add(5) / 10;
    }
    region
}

impl From<StepV1> for Step {
    fn from(old: StepV1) -> Self {
        old.head.step(old.regions)
    }
}

impl From<StepV2> for Step {
    fn from(old: StepV2) -> Self {
        Self { boots_since: old.boots_since, start_unix_us: old.start_unix_us, ..old.head.step(old.regions) }
    }
}
