//! Names of regions, sides and areas.
//!
//! Regions and sides are serialised by the lower-case names that are used in files, instead of their Rust identifiers.

use plantar::Side;
use plantar::pipeline::contact::ContactRule;

/// The name of an area that a contact rule determines. With covered shares ([`ContactRule::COVERED`]), the area also depends on
/// pressure and on the size of the cells, so it is called effective.
pub fn area_title(rule: &ContactRule) -> &'static str {
    if rule.full_kpa > 0.0 { "effective area" } else { "contact area" }
}

/// A name for both feet: the name of a file of one foot without the word for the foot at its end, which an import appends.
pub fn without_side(name: &str) -> &str {
    let without = |side: Side| match name.strip_suffix(side.name())? {
        "" => Some("both feet"),
        start => start.strip_suffix(['.', '-', '_', ' ']),
    };
    [Side::Left, Side::Right].into_iter().find_map(without).unwrap_or(name)
}

/// `#[serde(with = "names::region")]`: a region as its [`plantar::Region::name`].
pub mod region {
    use plantar::Region;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(region: &Region, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(region.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Region, D::Error> {
        let name = String::deserialize(from)?;
        Region::from_name(&name).ok_or_else(|| D::Error::custom(super::unknown_region(&name)))
    }
}

/// `#[serde(with = "names::side")]`: a side as `left` or `right`.
pub mod side {
    use plantar::Side;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(side: &Side, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(side.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Side, D::Error> {
        match String::deserialize(from)?.as_str() {
            "left" => Ok(Side::Left),
            "right" => Ok(Side::Right),
            other => Err(D::Error::custom(format!("unknown side `{other}`, expected left or right"))),
        }
    }
}

/// A message for a name that no region has.
pub fn unknown_region(name: &str) -> String {
    format!("unknown region `{name}`, expected one of {}", all_regions())
}

/// The names of all regions, separated by commas.
pub fn all_regions() -> String {
    plantar::Region::ALL.map(plantar::Region::name).join(", ")
}

#[cfg(test)]
mod tests {
    use super::without_side;

    #[test]
    fn the_name_for_both_feet_has_no_word_for_one_of_them() {
        for (name, both) in [
            ("pedar.left", "pedar"),
            ("ann-right", "ann"),
            ("left", "both feet"),
            ("bright", "bright"),
            ("walk", "walk"),
        ] {
            assert_eq!(without_side(name), both);
        }
    }
}
