//! The options of the package: the attributes of the Python class `Options`.

use crate::exception;
use fit::{Filter, Method};
use parameters::{InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use recording::{VirtualInsole, Zero};
use std::path::PathBuf;
use study::walk::OptionNames;
use study::{ContactOptions, Search, StanceOptions};

/// The default of `bounds`.
const FREE_BOUNDS: &str = "free";

/// The names of the options in notes on contacts.
pub const OPTION_NAMES: OptionNames = OptionNames {
    strike: "strike_n",
    release: "release_n",
    min_stance: "min_stance_ms",
    max_stance: "max_stance_ms",
    zero: "zero",
};

/// The attributes of the Python class `Options`, which describes them.
pub struct Options {
    size: i64,
    filter: Option<String>,
    method: String,
    bounds: String,
    tissue: Option<PathBuf>,
    compression: Option<f64>,
    contact_on_kpa: Option<f32>,
    contact_off_kpa: Option<f32>,
    contact_full_kpa: Option<f32>,
    thresholds: String,
    strike_n: Option<f32>,
    release_n: Option<f32>,
    min_stance_ms: Option<u16>,
    min_swing_ms: Option<u16>,
    max_stance_ms: Option<u16>,
    /// The zero file.
    pub zero: Option<PathBuf>,
}

impl<'py> FromPyObject<'_, 'py> for Options {
    type Error = PyErr;

    fn extract(options: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let (text, number, path) = ("a text", "a number or None", "a path or None");
        let duration = "a whole number from 0 to 65535 or None";
        Ok(Self {
            size: attribute(options, "size", "a whole number")?,
            filter: attribute(options, "filter", "a text or None")?,
            method: attribute(options, "method", text)?,
            bounds: attribute(options, "bounds", text)?,
            tissue: attribute(options, "tissue", path)?,
            compression: attribute(options, "compression", number)?,
            contact_on_kpa: attribute(options, "contact_on_kpa", number)?,
            contact_off_kpa: attribute(options, "contact_off_kpa", number)?,
            contact_full_kpa: attribute(options, "contact_full_kpa", number)?,
            thresholds: attribute(options, "thresholds", text)?,
            strike_n: attribute(options, "strike_n", number)?,
            release_n: attribute(options, "release_n", number)?,
            min_stance_ms: attribute(options, "min_stance_ms", duration)?,
            min_swing_ms: attribute(options, "min_swing_ms", duration)?,
            max_stance_ms: attribute(options, "max_stance_ms", duration)?,
            zero: attribute(options, "zero", path)?,
        })
    }
}

/// The attribute `name` of the options. The exception for a value of another type than `expected` contains the value, that for
/// an object without this attribute contains the object.
fn attribute<'py, T: FromPyObjectOwned<'py>>(
    options: Borrowed<'_, 'py, PyAny>,
    name: &str,
    expected: &str,
) -> PyResult<T> {
    let Ok(value) = options.getattr(name) else {
        return Err(PyTypeError::new_err(format!("expected a plantar.Options, not {}", options.repr()?)));
    };
    match value.extract() {
        Ok(value) => Ok(value),
        Err(_) => Err(PyTypeError::new_err(format!("{name} = {}: expected {expected}", value.repr()?))),
    }
}

/// The value in `all` with this name. The exception for an unknown name contains `option`, the name of the option.
pub fn named<T>(option: &str, name: &str, all: &[(&str, T)]) -> PyResult<T>
where
    T: Copy,
{
    all.iter().find(|(known, _)| *known == name).map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        PyValueError::new_err(format!("{option} = \"{name}\": expected {}", names.join(" or ")))
    })
}

/// An error if an option is given. `of_what` is what it has no effect on.
fn refuse(of_what: &str, options: &[(&str, bool)]) -> PyResult<()> {
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => {
            Err(PyValueError::new_err(format!("the option {name} has no effect on {of_what}: leave it out")))
        }
        None => Ok(()),
    }
}

impl Options {
    /// The shoe size.
    pub fn size(&self) -> PyResult<InsoleSize> {
        self.size.to_string().parse().map_err(PyValueError::new_err::<String>)
    }

    /// An error if an option of the search differs from its default: a replay would ignore it.
    pub fn check_replay(&self) -> PyResult<()> {
        refuse("a replay, only on the identification of parameters", &self.given_for_search())
    }

    /// An error if another option than those of the stance rule, the zero and the size differs from its default: the measures of
    /// gait would not depend on it.
    pub fn check_gait(&self) -> PyResult<()> {
        let of_contact = [
            ("contact_on_kpa", self.contact_on_kpa.is_some()),
            ("contact_off_kpa", self.contact_off_kpa.is_some()),
            ("contact_full_kpa", self.contact_full_kpa.is_some()),
        ];
        refuse("the measures of gait", &[&self.given_for_search()[..], &of_contact].concat())
    }

    /// The options of the search, and whether each differs from its default. The default of the size cannot be recognised.
    fn given_for_search(&self) -> [(&'static str, bool); 5] {
        [
            ("filter", self.filter.is_some()),
            ("method", self.method != Method::Projection.name()),
            ("bounds", self.bounds != FREE_BOUNDS),
            ("tissue", self.tissue.is_some()),
            ("compression", self.compression.is_some()),
        ]
    }

    /// Lets the insole subtract the zeros in the zero file, if there is one.
    pub fn subtract_zero(&self, insole: &mut VirtualInsole) -> anyhow::Result<()> {
        if let Some(path) = &self.zero {
            Zero::read(path)?.apply_to(insole, &path.display().to_string())?;
        }
        Ok(())
    }

    /// Filter, method and bounds of the search.
    pub fn search(&self) -> PyResult<Search> {
        let filters = [Filter::Direct, Filter::Live, Filter::Smoothed].map(|filter| (filter.name(), filter));
        let methods = [Method::Projection, Method::Paper].map(|method| (method.name(), method));
        let filter = self.filter.as_ref().map(|name| named("filter", name, &filters)).transpose()?;
        let default = Search::default();
        Ok(Search {
            filter,
            method: named("method", &self.method, &methods)?,
            has_paper_bounds: named("bounds", &self.bounds, &[(FREE_BOUNDS, false), ("paper", true)])?,
            tissue: self.tissue.clone(),
            size: self.size()?,
            compression: self.compression.unwrap_or(default.compression),
        })
    }

    /// The rule with which the parameters were identified, or otherwise the default rule, changed by the options.
    pub fn contact(&self, parameters: Option<&Parameters>) -> PyResult<ContactRule> {
        let identified = parameters.and_then(|parameters| parameters.identified.as_ref());
        let options = ContactOptions {
            on_kpa: self.contact_on_kpa,
            off_kpa: self.contact_off_kpa,
            full_kpa: self.contact_full_kpa,
        };
        options.rule(identified.map_or(ContactRule::COVERED, |i| i.contact)).map_err(exception)
    }

    /// The default stance rule, changed by the options.
    pub fn stance(&self) -> PyResult<StanceRule> {
        let kinds = [("adaptive", true), ("absolute", false)];
        let options = StanceOptions {
            is_adaptive: Some(named("thresholds", &self.thresholds, &kinds)?),
            strike_n: self.strike_n,
            release_n: self.release_n,
            min_stance_ms: self.min_stance_ms,
            min_swing_ms: self.min_swing_ms,
            max_stance_ms: self.max_stance_ms,
        };
        options.rule().map_err(exception)
    }
}
