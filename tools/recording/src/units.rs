//! Units of vendors' exports.

use crate::text::{shortened, strip_name};
use crate::{Error, Result};

/// The value of one unit of pressure in kPa; `None` for an unknown unit. Upper and lower case are not distinguished.
///
/// Source: The International System of Units, 9th edition, and NIST Special Publication 811, appendix B.8.
pub fn kpa_of(unit: &str) -> Option<f64> {
    Some(match normalised(unit).as_str() {
        "kpa" => 1.0,
        "pa" => 1e-3,
        "hpa" | "mbar" => 0.1,
        "mpa" | "n/mm2" => 1e3,
        "bar" => 100.0,
        "n/cm2" => 10.0,
        "mmhg" | "torr" => 0.133_322_39,
        "inh2o" => 0.249_082,
        "psi" | "lb/in2" | "lbf/in2" => 6.894_757,
        "kg/cm2" | "kgf/cm2" | "kp/cm2" => 98.066_5,
        "g/cm2" | "gf/cm2" => 0.098_066_5,
        _ => return None,
    })
}

/// As [`kpa_of`], with an error for an unknown unit.
pub fn kpa(unit: &str, place: &dyn Fn() -> String) -> Result<f64> {
    kpa_of(unit).ok_or_else(|| {
        Error::content(
            place(),
            format!("unknown unit of pressure `{}`", shortened(unit)),
            "export the measurement in kPa, PSI, mmHg or N/cm2",
        )
    })
}

/// A unit of pressure that a header states.
#[derive(Clone, PartialEq)]
pub struct StatedUnit {
    pub name: String,
    pub kpa: f64,
}

/// The unit of pressure that a line of a header states: after `pressure values in`, or, in another wording such as `Druckwerte in
/// N/cm2`, as the last word: in brackets, after `in` or, in a line about pressure or a unit, after a colon. `None` if the line
/// states none.
///
/// # Errors
/// Fails for an unknown unit after `pressure values in`.
pub fn stated(row: &str, place: &dyn Fn() -> String) -> Result<Option<StatedUnit>> {
    if let Some(name) = strip_name(row, "pressure values in") {
        let name = name.trim_matches([' ', '\t', ':']);
        return Ok(Some(StatedUnit { name: shortened(name), kpa: kpa(name, place)? }));
    }
    let mut words = row.split_whitespace().rev();
    let (last, before) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let unit = last.trim_end_matches([':', '.', ',', ';']);
    let of_pressure = || {
        let row = row.to_lowercase();
        ["pressure", "druck", "unit", "einheit"].iter().any(|word| row.contains(word))
    };
    let is_stated = || {
        before.eq_ignore_ascii_case("in") || unit.starts_with(['[', '(']) || (before.ends_with(':') && of_pressure())
    };
    let kpa = kpa_of(unit).filter(|_| is_stated());
    Ok(kpa.map(|kpa| StatedUnit { name: shortened(unit.trim_matches(['[', ']', '(', ')'])), kpa }))
}

/// Reads a line of a header as [`stated`] into `unit`. Two lines must not state different units.
pub fn update_stated(unit: &mut Option<StatedUnit>, row: &str, place: &dyn Fn() -> String) -> Result<()> {
    let Some(stated) = stated(row, place)? else { return Ok(()) };
    if let Some(before) = unit.as_ref().filter(|before| before.kpa != stated.kpa) {
        let problem = format!("the unit {} contradicts {}, which a line above states", stated.name, before.name);
        return Err(Error::content(place(), problem, "export the measurement in one unit, and do not edit the file"));
    }
    *unit = Some(stated);
    Ok(())
}

/// The value of one unit of length in mm.
///
/// # Errors
/// Fails for an unknown unit.
pub fn mm(unit: &str, place: &dyn Fn() -> String) -> Result<f64> {
    Ok(match normalised(unit).as_str() {
        "mm" | "millimeters" | "millimetres" | "millimeter" => 1.0,
        "cm" | "centimeters" | "centimetres" | "centimeter" => 10.0,
        "m" | "meters" => 1e3,
        "in" | "inch" | "inches" | "\"" => 25.4,
        _ => {
            let problem = format!("unknown unit of length `{}`", shortened(unit));
            return Err(Error::content(place(), problem, "export the measurement with lengths in mm, cm or inches"));
        }
    })
}

/// The value of one unit of force in N; `None` for an unknown unit.
pub fn newtons_of(unit: &str) -> Option<f64> {
    Some(match normalised(unit).as_str() {
        "n" | "newton" | "newtons" => 1.0,
        "kg" | "kgs" | "kgf" | "kp" => 9.806_65,
        "lb" | "lbs" | "lbf" | "pounds" => 4.448_222,
        "g" | "gf" => 9.806_65e-3,
        _ => return None,
    })
}

/// A unit in lower case, without blanks, brackets and `^`, and with 2 instead of a superscript 2.
fn normalised(unit: &str) -> String {
    let characters = unit.trim().chars().filter(|c| !c.is_whitespace() && !"()[]^".contains(*c));
    characters.map(|c| if c == '²' { '2' } else { c.to_ascii_lowercase() }).collect()
}
