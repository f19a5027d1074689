//! The options of the package: the attributes of the Python class `Options`.

use crate::exception;
use fit::{Filter, Method};
use parameters::{InsoleSize, Parameters};
use plantar::pipeline::contact::ContactRule;
use pyo3::exceptions::PyValueError;
use pyo3::{FromPyObject, PyResult};
use std::path::PathBuf;
use study::{ContactOptions, Search};

/// The attributes of the Python class `Options`, which describes them.
#[derive(FromPyObject)]
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
    /// The zero file.
    pub zero: Option<PathBuf>,
}

/// The value in `all` with this name. The exception for an unknown name contains `option`, the name of the option.
fn named<T>(option: &str, name: &str, all: &[(&str, T)]) -> PyResult<T>
where
    T: Copy,
{
    all.iter().find(|(known, _)| *known == name).map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|(name, _)| format!("\"{name}\"")).collect();
        PyValueError::new_err(format!("{option} = \"{name}\": expected {}", names.join(" or ")))
    })
}

impl Options {
    /// The shoe size.
    pub fn size(&self) -> PyResult<InsoleSize> {
        InsoleSize::try_from(self.size).map_err(PyValueError::new_err)
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
            has_paper_bounds: named("bounds", &self.bounds, &[("free", false), ("paper", true)])?,
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
}
