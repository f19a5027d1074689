//! Which of the insoles in reach.

use crate::SERVICE;
use btleplug::api::PeripheralProperties;
use plantar::Side;
use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

/// Names one of the insoles in reach.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Which {
    /// Any of this foot.
    Side(Side),
    /// The one with this address, or what the system has instead of addresses.
    Address(String),
}

impl Which {
    /// True for what a system tells of the insole that is meant.
    pub fn is(&self, id: &str, properties: &PeripheralProperties) -> bool {
        let name = properties.advertisement_name.as_deref().or(properties.local_name.as_deref());
        match self {
            Self::Side(side) => properties.services.contains(&SERVICE) && name == Some(advertised(*side)),
            Self::Address(address) => {
                address.eq_ignore_ascii_case(id) || address.eq_ignore_ascii_case(&properties.address.to_string())
            }
        }
    }
}

/// The name that an insole advertises.
const fn advertised(side: Side) -> &'static str {
    match side {
        Side::Left => "Plantar L",
        Side::Right => "Plantar R",
    }
}

impl FromStr for Which {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "left" => Self::Side(Side::Left),
            "right" => Self::Side(Side::Right),
            address => Self::Address(address.into()),
        })
    }
}

impl fmt::Display for Which {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Side(side) => write!(f, "the {} insole", side.name()),
            Self::Address(address) => write!(f, "the insole {address}"),
        }
    }
}
