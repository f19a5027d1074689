//! Selects one of the insoles in radio range.

use super::SERVICE;
use btleplug::api::PeripheralProperties;
use plantar::Side;
use plantar::protocol::gatt;
use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

/// Selects one of the insoles in radio range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selector {
    /// Any insole for this foot.
    Side(Side),
    /// The insole with this address, or with this identifier on systems that hide addresses.
    Address(String),
}

impl Selector {
    /// True if a peripheral with this identifier and these properties is selected.
    pub fn matches(&self, id: &str, properties: &PeripheralProperties) -> bool {
        let name = properties.advertisement_name.as_deref().or(properties.local_name.as_deref());
        match self {
            Self::Side(side) => properties.services.contains(&SERVICE) && name == Some(gatt::name(*side)),
            Self::Address(address) => {
                address.eq_ignore_ascii_case(id) || address.eq_ignore_ascii_case(&properties.address.to_string())
            }
        }
    }
}

impl FromStr for Selector {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "left" => Self::Side(Side::Left),
            "right" => Self::Side(Side::Right),
            address => Self::Address(address.into()),
        })
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Side(side) => write!(f, "the {} insole", side.name()),
            Self::Address(address) => write!(f, "the insole {address}"),
        }
    }
}
