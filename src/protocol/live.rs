//! The live stream: one message for each frame. The macro `quantities` in `quantities.rs` documents the form of the
//! declarations. Equation numbers are those of the paper that [`crate::pipeline::model`] implements.

use super::quantities::{bits, quantities, region_bytes};
use crate::num::Real;
use crate::pipeline::live::RegionLoad;
use postcard::fixint::le;
use serde::{Deserialize, Serialize};

/// Length of the longest encoded [`super::ToHost::Live`], bytes.
pub const MAX_LIVE: usize = 88;

quantities! {
    /// One frame: 8 regions in the order of [`crate::Region::ALL`].
    #[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
    pub struct Live {
        /// Number of the frame in its session; a gap is a frame that was dropped or lost on the way.
        sequence: u32 = sequence
            => sequence [1 per "count"],
            "Counted by the insole from the start of the session, also if the live stream is turned off and on.";
        /// Time of the scan since the first scan.
        t_us: u64 = t_us
            => t_s [1_000_000 per "s"],
            "Clock of the insole.";
        /// A cell is saturated, so the force is a lower bound.
        saturated: u8 = bits(loads, |load| load.frame.saturated),
            flags "The code of a cell is at the end of the scale.";
        /// The contact exceeds the ellipsoid: the deformation is limited to C, a lower bound, and the model force is that at C.
        clamped: u8 = bits(loads, |load| load.tissue.clamped),
            flags "The contact area exceeds pi A B.";
        /// Cells are masked.
        masked: u8 = masked,
            flags "The fault detector replaces cells by the mean of their neighbours, or by zero.";
        /// Centre of pressure of the foot, to the lateral side in foot coordinates; null unless the foot is on the ground.
        #[serde(with = "le")]
        centre_x_dmm: i16 = centre_mm.map_or(0, |(x_mm, _)| (x_mm * R::of(10.0)).round_i16())
            => centre_x_mm [10 per "mm"] if centre_y_dmm,
            "Sum over the cells of force times position, divided by the total force.";
        /// Centre of pressure of the foot, from heel to toe in foot coordinates; null unless the foot is on the ground.
        #[serde(with = "le")]
        centre_y_dmm: i16 = centre_mm.map_or(0, |(_, y_mm)| (y_mm * R::of(10.0)).round_i16())
            => centre_y_mm [10 per "mm"] if centre_y_dmm,
            "Sum over the cells of force times position, divided by the total force.";
        /// The regions.
        #[serde(with = "live_regions")]
        regions: [LiveRegion; 8] = loads.each_ref().map(LiveRegion::new);
    }

    /// Rounds one frame to the integer units of the message. `masked` is the value of [`crate::insole::Insole::masked`], and
    /// `centre_mm` that of [`crate::insole::Insole::foot_centre_mm`].
    pub fn new<R: Real>(
        sequence: u32,
        t_us: u64,
        loads: &[RegionLoad<R>; 8],
        masked: u8,
        centre_mm: Option<(R, R)>,
    );
}

quantities! {
    /// One region of a [`Live`] frame in scaled integers.
    #[derive(Clone, Copy, Debug, PartialEq, Default)]
    pub struct LiveRegion {
        /// Contact area; the effective area if the contact rule has covered shares.
        area_mm2: u16 = load.frame.area.area_mm2::<R>().round_u16()
            => area_mm2 [1 per "mm2"],
            "Sum of the areas of the cells in contact; with covered shares, each times its share, which depends on pressure and cell size.";
        /// Tissue deformation of the model (scaled by assumption, unless its scale was measured).
        deformation_um: u16 = (load.tissue.deformation_m * R::of(1e6)).round_u16()
            => deformation_mm [1000 per "mm"],
            "Eq. 14, on the mean contact area of three frames.";
        /// Model force.
        model_dn: u16 = (load.tissue.model_n * R::of(10.0)).round_u16()
            => model_force_n as "model_n" [10 per "N"],
            "Eq. 13, with the backward difference instead of the forward difference of Eq. 16.";
        /// Measured force.
        measured_dn: u16 = (load.frame.force.force_n * R::of(10.0)).round_u16()
            => measured_force_n as "measured_n" [10 per "N"],
            "Sum over the cells of pressure times area.";
    }

    /// Rounds a region to the integer units of the message.
    fn new<R: Real>(load: &RegionLoad<R>);
    fn numbers(&self) -> [u16];
}

// Serialising all numbers as one sequence of bytes takes fewer instructions than serialising each number.
region_bytes!(live_regions, LiveRegion, u16);
