//! The numbers of a region that are averaged and compared between people: measured loads, mechanical quantities, parameters and
//! errors.

use crate::RegionFit;
use crate::measures::Quantity;
use crate::trials::Moments;
use plantar::protocol::StepRegion;
use std::borrow::Cow;

/// A number of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Variable {
    /// A measured load of the step record. It does not depend on the model, so a region that was not fitted has it, too. It has
    /// no value in a step without contact.
    Load(&'static Scalar<StepRegion>),
    /// A mechanical quantity. It has no value in a region that does not reach the force or the strain at which the quantity is
    /// defined.
    Quantity(Quantity),
    /// A parameter or an error, which every fitted region has.
    Scalar(&'static Scalar<RegionFit>),
}

/// A number that every `T` has.
#[derive(Debug)]
pub struct Scalar<T> {
    /// Name with unit, as in tables.
    pub name: &'static str,
    /// Symbol or name in figures.
    pub title: &'static str,
    /// Unit in figures.
    pub unit: &'static str,
    /// The number.
    value: fn(&T) -> f64,
}

impl<T> PartialEq for Scalar<T> {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

const fn scalar<T>(name: &'static str, title: &'static str, unit: &'static str, value: fn(&T) -> f64) -> Scalar<T> {
    Scalar { name, title, unit, value }
}

/// The loads that studies of plantar pressure usually report. Names and values are those of the step record.
static LOADS: [Scalar<StepRegion>; 6] = [
    scalar("measured_force_peak_n", "peak force", "N", StepRegion::measured_force_peak_n),
    scalar("measured_force_integral_n_s", "force-time integral", "N s", StepRegion::measured_force_integral_n_s),
    scalar("peak_pressure_kpa", "peak pressure", "kPa", StepRegion::peak_pressure_kpa),
    scalar("pressure_integral_kpa_s", "pressure-time integral", "kPa s", StepRegion::pressure_integral_kpa_s),
    scalar("area_peak_mm2", "largest contact area", "mm2", StepRegion::area_peak_mm2),
    scalar("contact_time_s", "contact time", "s", StepRegion::contact_time_s),
];

/// The paper's eight parameters, in the order of its Fig. 8.
pub static PARAMETERS: [Scalar<RegionFit>; 8] = [
    scalar("d0_mm", "d₀: thickness", "mm", |fit| fit.ellipsoid.d0_m * 1e3),
    scalar("a_mm", "A: medial-lateral radius", "mm", |fit| fit.ellipsoid.a_m * 1e3),
    scalar("b_mm", "B: heel-toe radius", "mm", |fit| fit.ellipsoid.b_m * 1e3),
    scalar("c_mm", "C: vertical radius", "mm", |fit| fit.ellipsoid.c_m * 1e3),
    scalar("k_n_m3", "k: stiffness", "N/m³", |fit| fit.ellipsoid.k),
    scalar("n", "n: stiffness exponent", "", |fit| fit.ellipsoid.n),
    scalar("c_n_s_m3", "c: damping", "N s/m³", |fit| fit.ellipsoid.c),
    scalar("m", "m: damping exponent", "", |fit| fit.ellipsoid.m),
];

/// The combinations of the eight parameters that the force determines in addition to n and m.
static COMBINATIONS: [Scalar<RegionFit>; 3] = [
    scalar("ab_mm2", "A B", "mm²", |fit| fit.law.ab_m2 * 1e6),
    scalar("stiffness_pa", "K", "Pa", |fit| fit.law.stiffness_pa),
    scalar("damping_pa_s", "G", "Pa s", |fit| fit.law.damping_pa_s),
];

/// The errors of the model force (Eq. 20).
static ERRORS: [Scalar<RegionFit>; 2] = [
    scalar("nrmse_percent", "NRMSE", "% of peak force", |fit| fit.quality.fitted * 100.0),
    scalar("nrmse_smoothed_percent", "NRMSE, smoothed force", "% of peak force", |fit| {
        fit.quality.fitted_smoothed * 100.0
    }),
];

impl Variable {
    /// The NRMSE of the model force against the measured force.
    pub fn nrmse() -> Self {
        Self::Scalar(&ERRORS[0])
    }

    /// The measured loads.
    pub fn loads() -> impl Iterator<Item = Self> {
        LOADS.iter().map(Self::Load)
    }

    /// All mechanical quantities.
    pub fn quantities() -> impl Iterator<Item = Self> {
        Quantity::all().map(Self::Quantity)
    }

    /// The paper's eight parameters.
    pub fn parameters() -> impl Iterator<Item = Self> {
        PARAMETERS.iter().map(Self::Scalar)
    }

    /// The loads, the quantities, then the eight parameters: the variables of which the repeatability is computed.
    pub fn repeated() -> impl Iterator<Item = Self> {
        Self::loads().chain(Self::quantities()).chain(Self::parameters())
    }

    /// All variables, the loads first. Arrays of values have this order.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::repeated().chain(COMBINATIONS.iter().chain(&ERRORS).map(Self::Scalar))
    }

    /// The index of the variable in [`Variable::all`].
    pub fn index(self) -> usize {
        Self::all().take_while(|variable| *variable != self).count()
    }

    /// Name with unit, as in tables.
    pub fn name(self) -> Cow<'static, str> {
        match self {
            Self::Load(load) => load.name.into(),
            Self::Quantity(quantity) => quantity.name().into(),
            Self::Scalar(scalar) => scalar.name.into(),
        }
    }

    /// Symbol or name in figures, and unit, which may be empty.
    pub fn title(self) -> (Cow<'static, str>, &'static str) {
        match self {
            Self::Load(load) => (load.title.into(), load.unit),
            Self::Quantity(quantity) => {
                let (title, unit) = quantity.title();
                (title.into(), unit)
            }
            Self::Scalar(scalar) => (scalar.title.into(), scalar.unit),
        }
    }

    /// The symbol or name in figures, with its unit.
    pub fn title_and_unit(self) -> String {
        let (title, unit) = self.title();
        if unit.is_empty() { title.into() } else { format!("{title}, {unit}") }
    }

    /// The value of a region, of which `records` are the records of its steps, and `fit` is the fit to these steps, if it could
    /// be fitted. A load is the mean over the steps in which the region is in contact. `None` for a variable that the region does
    /// not have.
    pub fn of<'r>(self, records: impl IntoIterator<Item = &'r StepRegion>, fit: Option<&RegionFit>) -> Option<f64> {
        let value = match self {
            Self::Load(load) => {
                let in_contact = records.into_iter().filter(|record| record.contact_ms > 0);
                Moments::of(in_contact.map(load.value)).map(|moments| moments.mean)
            }
            Self::Quantity(quantity) => fit?.measure(quantity).map(|m| m.value),
            Self::Scalar(scalar) => Some((scalar.value)(fit?)),
        };
        value.filter(|value| value.is_finite())
    }
}
