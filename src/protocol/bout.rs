//! The load bout as a message. The macro `quantities` in `quantities.rs` documents the form of the declarations.

use super::quantities::quantities;
use crate::num::Real;
use crate::pipeline::bout::{BoutKind, BoutRecord, BoutRegion as Region};
use crate::pipeline::region::Side;
use postcard::fixint::le;
use serde::{Deserialize, Serialize};

quantities! {
    /// A [`BoutRecord`] in scaled integers.
    #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
    pub struct Bout {
        /// Number of the record.
        number: u32 = record.number
            => number [1 per "count"],
            "Steps, load bouts and alerts are numbered together; the number continues after a restart.";
        /// Foot.
        side: Side = record.side;
        /// The kind of the bout.
        kind: BoutKind = record.kind;
        /// Time of the first frame, since the first scan.
        start_us: u64 = record.start_us
            => start_s [1_000_000 per "s"],
            "First frame after the previous bout that is not part of a step.";
        /// Time from the first frame to the end of the last one; if the next bout begins after a step, to the start of that bout.
        duration_us: u32 = record.duration_us
            => duration_s [1_000_000 per "s"],
            "A frame ends a frame period after its scan. The bout can span steps; their load is not part of it.";
        /// The regions, in the order of [`crate::Region::ALL`].
        regions: [BoutRegion; 8] = record.regions.each_ref().map(BoutRegion::new);
        /// Boots of the insole since the one that recorded this bout; `start_s` counts from that boot.
        boots_since: u32 = 0
            => boots_since [1 per "count"],
            "Counted by the insole.";
        /// `start_us` on the wall clock (UTC; local time if Current Time has set it), us since 1970; `None` if it was not set.
        start_unix_us: Option<u64> = None;
    }

    /// Rounds a bout of the running boot to the integer units of the message.
    pub fn new<R: Real>(record: &BoutRecord<R>);
}

quantities! {
    /// One region of a [`Bout`].
    #[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
    pub struct BoutRegion {
        /// Force-time integral of the measured force.
        #[serde(with = "le")]
        measured_integral_cns: u32 = round_u32(region.integral_n_s * R::of(100.0))
            => measured_force_integral_n_s [100 per "N s"],
            "Sum over the frames, times the time between them.";
        /// Pressure-time integral.
        #[serde(with = "le")]
        pressure_integral_dkpas: u32 = round_u32(region.pressure_integral_kpa_s * R::of(10.0))
            => pressure_integral_kpa_s [10 per "kPa s"],
            "Largest cell pressure in each frame, times the time between frames, summed.";
        /// Largest pressure of a cell.
        #[serde(with = "le")]
        peak_pressure_dkpa: u16 = (region.peak_pressure_kpa * R::of(10.0)).round_u16()
            => peak_pressure_kpa [10 per "kPa"],
            "Largest pressure of any cell of the region in the bout.";
    }

    /// Rounds a region to the integer units of the message.
    fn new<R: Real>(region: &Region<R>);
}

/// Nearest integer of a value that is not negative. In `f32`, values from 2^23 on are already integers, and the result may be
/// the next integer, because the sum is rounded.
fn round_u32<R: Real>(value: R) -> u32 {
    (value + R::of(0.5)).to_u32()
}
