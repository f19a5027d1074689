//! The live stream: one message for each frame.

use crate::num::Real;
use crate::pipeline::live::RegionLoad;
use serde::{Deserialize, Serialize};

/// Longest live frame as a message, bytes.
pub const MAX_LIVE: usize = 84;

/// One frame: 8 regions in the order of [`crate::Region::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Live {
    /// Counts the frames of the stream; a gap is a frame that was dropped or lost on the way.
    pub sequence: u32,
    /// Time of the scan since the first scan, us.
    pub t_us: u64,
    /// Bit i: a cell of region i is saturated.
    pub saturated: u8,
    /// Bit i: region i's contact exceeds its ellipsoid.
    pub clamped: u8,
    /// Bit i: region i has masked cells.
    pub masked: u8,
    /// The regions.
    #[serde(with = "live_regions")]
    pub regions: [LiveRegion; 8],
}

/// One region of a [`Live`] frame in scaled integers.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct LiveRegion {
    /// Contact area, mm2.
    pub area_mm2: u16,
    /// Tissue deformation, um.
    pub deformation_um: u16,
    /// Model force, 0.1 N.
    pub model_dn: u16,
    /// Measured force, 0.1 N.
    pub measured_dn: u16,
}

/// Serialises the regions of a [`Live`] frame as one run of bytes, two for each number, little endian: faster than number by
/// number.
mod live_regions {
    use super::LiveRegion;
    use core::fmt;
    use serde::de::{Error, Visitor};
    use serde::{Deserializer, Serializer};

    const REGION: usize = 8;

    pub fn serialize<S: Serializer>(regions: &[LiveRegion; 8], serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = [0; 8 * REGION];
        for (place, region) in bytes.chunks_exact_mut(REGION).zip(regions) {
            let LiveRegion { area_mm2, deformation_um, model_dn, measured_dn } = *region;
            for (place, number) in place.chunks_exact_mut(2).zip([area_mm2, deformation_um, model_dn, measured_dn]) {
                place.copy_from_slice(&number.to_le_bytes());
            }
        }
        serializer.serialize_bytes(&bytes)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[LiveRegion; 8], D::Error> {
        struct Regions;

        impl Visitor<'_> for Regions {
            type Value = [LiveRegion; 8];

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("eight regions of eight bytes")
            }

            fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Self::Value, E> {
                if bytes.len() != 8 * REGION {
                    return Err(E::invalid_length(bytes.len(), &self));
                }
                let number = |i: usize| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
                Ok(core::array::from_fn(|i| LiveRegion {
                    area_mm2: number(4 * i),
                    deformation_um: number(4 * i + 1),
                    model_dn: number(4 * i + 2),
                    measured_dn: number(4 * i + 3),
                }))
            }
        }

        deserializer.deserialize_bytes(Regions)
    }
}

impl Live {
    /// Rounds one frame to the units of the wire; `masked` is [`crate::insole::Insole::masked`].
    pub fn new<R: Real>(sequence: u32, t_us: u64, loads: &[RegionLoad<R>; 8], masked: u8) -> Self {
        let mut live = Self { sequence, t_us, masked, ..Self::default() };
        for (i, (region, load)) in live.regions.iter_mut().zip(loads).enumerate() {
            live.saturated |= u8::from(load.frame.saturated) << i;
            live.clamped |= u8::from(load.tissue.clamped) << i;
            *region = LiveRegion {
                area_mm2: load.frame.area.area_mm2::<R>().round_u16(),
                deformation_um: (load.tissue.deformation_m * R::of(1e6)).round_u16(),
                model_dn: (load.tissue.model_n * R::of(10.0)).round_u16(),
                measured_dn: (load.frame.force.force_n * R::of(10.0)).round_u16(),
            };
        }
        live
    }
}
