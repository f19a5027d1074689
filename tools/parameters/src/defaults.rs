//! Typical parameters by insole size. They were not identified from steps of the wearer: they are sufficient for a first view of
//! a live stream, but do not support a statement about a person.

use crate::Parameters;
use plantar::pipeline::model::Ellipsoid;
use serde::Deserialize;
use std::fmt;
use std::str::FromStr;

/// European shoe size, 35 to 46 as in Table 1 of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "i64")]
pub struct InsoleSize(u8);

impl FromStr for InsoleSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(size @ 35..=46) => Ok(Self(size)),
            _ => Err(format!("{text}: a European shoe size from 35 to 46 is required")),
        }
    }
}

impl TryFrom<i64> for InsoleSize {
    type Error = String;

    fn try_from(size: i64) -> Result<Self, String> {
        size.to_string().parse()
    }
}

impl InsoleSize {
    /// The size as a number.
    pub fn eur(self) -> u8 {
        self.0
    }

    /// Length of the foot relative to that of size 42.
    pub fn scale(self) -> f64 {
        f64::from(self.0) / 42.0
    }

    /// Typical thickness of the unloaded tissue, m, in the order of [`plantar::Region::ALL`]; proportional to the size. Under
    /// the heel and the metatarsals it is within published ranges (docs/identification.md).
    pub fn thickness_m(self) -> [f64; 8] {
        SIZE_42.map(|[_, _, d0_mm, ..]| d0_mm * self.scale() * 1e-3)
    }
}

impl fmt::Display for InsoleSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Default for InsoleSize {
    fn default() -> Self {
        Self(42)
    }
}

/// Size 42, for each region from heel to toes: A, B, d0 in mm; K in kPa, G in kPa s, n, m of the force law.
///
/// pi A B exceeds the contact area of nine of ten barefoot walkers on a plate (SpeedPP2DS). K, G, n and m are the least-squares
/// fit to the steps of all ten together; its error is about a fifth of the peak force of a step. In a shoe the foot spreads
/// further, and the contact area often exceeds pi A B; such results are flagged.
const SIZE_42: [[f64; 7]; 8] = [
    [31.5, 39.5, 16.0, 481.0, 19.9, 0.0, 0.5],
    [28.5, 19.0, 12.0, 201.0, 3.9, 0.0, 0.5],
    [30.0, 14.0, 12.0, 200.0, 0.0, 0.0, 0.5],
    [28.0, 30.1, 12.0, 563.0, 0.0, 0.0, 0.5],
    [29.0, 38.7, 10.0, 381.0, 0.0, 0.0, 0.5],
    [24.0, 22.6, 10.0, 550.0, 5.7, 0.0, 0.5],
    [11.5, 13.1, 7.0, 339.0, 0.5, 0.0, 0.5],
    [12.0, 15.8, 7.0, 258.0, 0.0, 0.0, 0.5],
];

/// Assumed largest strain (deformation over thickness): 45.7 %, measured under the metatarsal heads (Cavanagh 1999). It
/// determines C, together with [`MAX_NORMALISED_DEFORMATION`].
const MAX_STRAIN: f64 = 0.457;
/// Normalised deformation g (deformation over C) at a contact area of 90 % of pi A B (Eq. 14).
const MAX_NORMALISED_DEFORMATION: f64 = 0.68;

impl Parameters {
    /// Typical values for a size: lengths are proportional to the size, K, G, n and m are the same for all sizes.
    pub fn typical(size: InsoleSize) -> Self {
        let scale = size.scale();
        let regions = SIZE_42.map(|[a_mm, b_mm, d0_mm, stiffness_kpa, damping_kpa_s, n, m]| {
            let d0_m = d0_mm * scale * 1e-3;
            let c_m = MAX_STRAIN * d0_m / MAX_NORMALISED_DEFORMATION;
            Ellipsoid {
                a_m: a_mm * scale * 1e-3,
                b_m: b_mm * scale * 1e-3,
                c_m,
                d0_m,
                // K = k C^(n+1) / d0^n and G = c C^(m+1) / d0^m, solved for k and c.
                k: stiffness_kpa * 1e3 * d0_m.powf(n) / c_m.powf(n + 1.0),
                n,
                c: damping_kpa_s * 1e3 * d0_m.powf(m) / c_m.powf(m + 1.0),
                m,
            }
        });
        Self { subject: format!("typical, size {size}"), personal: false, identified: None, regions }
    }
}
