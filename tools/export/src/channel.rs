//! The quantities of a frame as channels: their names, units and descriptions in all formats.

use crate::{Foot, Frame};
use plantar::{Region, Side};

/// A quantity of a foot in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Normal force on the whole foot, N.
    TotalForce,
    /// Centre of pressure, mm from the medial edge; absent while the foot is off the ground.
    CopX,
    /// Centre of pressure, mm from the back of the heel; absent while the foot is off the ground.
    CopY,
    /// Normal force on a region, N.
    Force(Region),
    /// Area of a region by the contact rule, mm².
    Area(Region),
}

impl Quantity {
    /// All quantities of a foot.
    pub fn all() -> impl Iterator<Item = Self> {
        let foot = [Self::TotalForce, Self::CopX, Self::CopY];
        foot.into_iter().chain(Region::ALL.map(Self::Force)).chain(Region::ALL.map(Self::Area))
    }

    /// Name with the unit. The quantities of a region have the same name in all regions.
    pub fn name(self) -> &'static str {
        match self {
            Self::TotalForce => "total_force_n",
            Self::CopX => "cop_x_mm",
            Self::CopY => "cop_y_mm",
            Self::Force(_) => "measured_force_n",
            Self::Area(_) => "area_mm2",
        }
    }

    /// The region of a regional quantity.
    pub fn region(self) -> Option<Region> {
        match self {
            Self::Force(region) | Self::Area(region) => Some(region),
            _ => None,
        }
    }

    /// Unit.
    pub fn unit(self) -> &'static str {
        match self {
            Self::TotalForce | Self::Force(_) => "N",
            Self::CopX | Self::CopY => "mm",
            Self::Area(_) => "mm^2",
        }
    }

    /// Description in a few words.
    pub fn description(self) -> String {
        match self {
            Self::TotalForce => "Normal force, sum of all cells".into(),
            Self::CopX => "Centre of pressure, distance from the medial edge".into(),
            Self::CopY => "Centre of pressure, distance from the back of the heel".into(),
            Self::Force(region) => format!("Normal force on the region {}", region.name()),
            Self::Area(region) => format!("Area of the region {} by the contact rule", region.name()),
        }
    }

    /// The value in a frame.
    pub fn of(self, frame: &Frame) -> Option<f64> {
        match self {
            Self::TotalForce => Some(frame.total_force_n()),
            Self::CopX => frame.cop_mm.map(|(x_mm, _)| x_mm),
            Self::CopY => frame.cop_mm.map(|(_, y_mm)| y_mm),
            Self::Force(region) => Some(frame.regions[region as usize].force_n),
            Self::Area(region) => Some(frame.regions[region as usize].area_mm2),
        }
    }
}

/// A quantity of one of the feet.
#[derive(Clone, Copy)]
pub struct Channel<'a> {
    /// The foot.
    pub foot: &'a Foot,
    /// The quantity.
    pub quantity: Quantity,
}

impl Channel<'_> {
    /// The foot.
    pub fn side(&self) -> Side {
        self.foot.side
    }

    /// Name with foot, region and unit, such as `left_heel_measured_force_n`.
    pub fn name(&self) -> String {
        let region = self.quantity.region().map_or(String::new(), |region| format!("{}_", region.name()));
        format!("{}_{region}{}", self.side().name(), self.quantity.name())
    }

    /// The value in frame `i`; `None` if the quantity is absent.
    ///
    /// # Panics
    /// Panics if the foot has no frame `i`.
    pub fn value(&self, i: usize) -> Option<f64> {
        self.quantity.of(&self.foot.frames[i])
    }
}
