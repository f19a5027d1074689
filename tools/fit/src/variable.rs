//! The numbers of a fitted region that are averaged and compared between people: mechanical quantities, parameters and errors.

use crate::RegionFit;
use crate::measures::Quantity;
use std::borrow::Cow;

/// A number of a fitted region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Variable {
    /// A mechanical quantity. It has no value in a region that does not reach the force or the strain at which the quantity is
    /// defined.
    Quantity(Quantity),
    /// A parameter or an error, which every fitted region has.
    Scalar(&'static Scalar),
}

/// A number that every fitted region has.
#[derive(Debug)]
pub struct Scalar {
    /// Name with unit, as in tables.
    pub name: &'static str,
    /// Symbol or name in figures.
    pub title: &'static str,
    /// Unit in figures.
    pub unit: &'static str,
    /// The number of a fitted region.
    value: fn(&RegionFit) -> f64,
}

impl PartialEq for Scalar {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

const fn scalar(name: &'static str, title: &'static str, unit: &'static str, value: fn(&RegionFit) -> f64) -> Scalar {
    Scalar { name, title, unit, value }
}

/// The paper's eight parameters, in the order of its Fig. 8.
pub static PARAMETERS: [Scalar; 8] = [
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
static COMBINATIONS: [Scalar; 3] = [
    scalar("ab_mm2", "A B", "mm²", |fit| fit.law.ab_m2 * 1e6),
    scalar("stiffness_pa", "K", "Pa", |fit| fit.law.stiffness_pa),
    scalar("damping_pa_s", "G", "Pa s", |fit| fit.law.damping_pa_s),
];

/// The errors of the model force (Eq. 20).
static ERRORS: [Scalar; 2] = [
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

    /// All mechanical quantities.
    pub fn quantities() -> impl Iterator<Item = Self> {
        Quantity::all().map(Self::Quantity)
    }

    /// The paper's eight parameters.
    pub fn parameters() -> impl Iterator<Item = Self> {
        PARAMETERS.iter().map(Self::Scalar)
    }

    /// The quantities, then the eight parameters: the variables whose repeatability is computed.
    pub fn repeated() -> impl Iterator<Item = Self> {
        Self::quantities().chain(Self::parameters())
    }

    /// All variables, the quantities first. Arrays of values have this order.
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
            Self::Quantity(quantity) => quantity.name().into(),
            Self::Scalar(scalar) => scalar.name.into(),
        }
    }

    /// Symbol or name in figures, and unit, which may be empty.
    pub fn title(self) -> (Cow<'static, str>, &'static str) {
        match self {
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

    /// The value of a fitted region; `None` for a quantity that it does not have.
    pub fn of(self, fit: &RegionFit) -> Option<f64> {
        let value = match self {
            Self::Quantity(quantity) => fit.measure(quantity).map(|m| m.value),
            Self::Scalar(scalar) => Some((scalar.value)(fit)),
        };
        value.filter(|value| value.is_finite())
    }
}
