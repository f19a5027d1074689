//! The rows of a recording: each region of each step, fitted separately, as in the paper (DeBerardinis et al. 2019).

use crate::Person;
use crate::table::{Row, Value};
use anyhow::{Result, bail};
use fit::trials::Trial;
use fit::variable::Variable;
use fit::{NotFitted, RegionFit, Step, fit_each_step};
use plantar::{Region, Side};
use recording::FrameSource;
use std::borrow::Cow;
use std::path::Path;

/// A row: the names of the columns with their values.
pub type FitRow = Row<Cow<'static, str>>;

/// Separates the defects in the column `defects`. They are sentences that contain commas and semicolons.
pub const DEFECT_SEPARATOR: &str = " | ";

/// The columns of the five identified parameters, four for each: the value, the two ends of its 95 % interval, and whether the
/// value is at a bound of the search.
const PARAMETER_COLUMNS: [[&str; 4]; 5] = [
    ["ab_mm2", "ab_mm2_low", "ab_mm2_high", "ab_at_bound"],
    ["stiffness_pa", "stiffness_pa_low", "stiffness_pa_high", "stiffness_at_bound"],
    ["damping_pa_s", "damping_pa_s_low", "damping_pa_s_high", "damping_at_bound"],
    ["n", "n_low", "n_high", "n_at_bound"],
    ["m", "m_low", "m_high", "m_at_bound"],
];

/// The rows of a recording of a person: one for each region of each complete step. `path` is the file of the recording; its
/// name is a column.
///
/// # Errors
/// Fails if the recording cannot be evaluated. The message names `path`.
pub fn rows<'a>(person: &Person, recording: impl Into<FrameSource<'a>>, path: &Path) -> Result<Vec<FitRow>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let steps = person.steps(recording.into(), path)?;
    let mut fits = Region::ALL.map(|region| fit_each_step(&steps, region as usize, &person.options).into_iter());
    let mut rows = Vec::new();
    for step in &steps {
        for (region, fits) in Region::ALL.into_iter().zip(&mut fits) {
            rows.extend(fits.next().map(|fit| row(person, &name, step, region, fit)));
        }
    }
    Ok(rows)
}

/// The values of a recording of a person, and the defects of the fits ([`RegionFit::defects`]), each with the name of its region.
/// Each region is fitted to all steps of the recording. A region that could not be fitted has no values and no defects. `path` is
/// the file of the recording.
///
/// # Errors
/// Fails if the recording cannot be evaluated, has no complete step, or no region could be fitted. The message names `path`.
pub fn trial<'a>(person: &Person, recording: impl Into<FrameSource<'a>>, path: &Path) -> Result<(Trial, Vec<String>)> {
    let source = recording.into();
    let side = source.head().side;
    let steps = person.steps(source, path)?;
    if steps.is_empty() {
        bail!("{}: {}", path.display(), NotFitted::NoSteps);
    }
    let fits = fit::fit(&steps, &person.options, &|_| ());
    if fits.iter().all(Result::is_err) {
        bail!("{}: no region could be fitted; `plantar fit` of this recording states the reasons", path.display());
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let defects = Region::ALL.iter().zip(&fits).flat_map(|(region, fit)| {
        let defects = fit.iter().flat_map(|fit| &fit.defects);
        defects.map(|defect| format!("{}: {defect}", region.name()))
    });
    let defects = defects.collect();
    Ok((Trial::of(name.into_owned(), side, &steps, &fits), defects))
}

/// A placeholder row, for the names and types of the columns of a table that may have no rows.
pub fn columns(person: &Person) -> FitRow {
    let step = Step {
        recording: 0,
        number: 0,
        side: Side::Left,
        start_s: 0.0,
        duration_s: 0.0,
        peak_n: 0.0,
        regions: Default::default(),
    };
    row(person, "", &step, Region::Heel, Err(NotFitted::NoSteps))
}

/// The row of one region of a step: its origin, the loads, the quantities, then the parameters and the errors.
fn row(person: &Person, recording: &str, step: &Step, region: Region, fit: Result<RegionFit, NotFitted>) -> FitRow {
    let text = |text: &str| Value::Text(Some(text.into()));
    let integer = |value: Option<usize>| Value::Integer(value.and_then(|v| i32::try_from(v).ok()));
    let real = |value: Option<f64>| Value::Real(value.filter(|v| v.is_finite()));
    let kpa = |value: f32| real(Some(value.into()));
    let Person { contact, options, settings, .. } = person;
    let curves = &step.regions[region as usize];
    let origin: [(&'static str, Value); 19] = [
        ("insole_size", integer(Some(person.size.eur().into()))),
        ("age_years", real(settings.age_years)),
        ("sex", Value::Text(settings.sex.map(|sex| sex.name().into()))),
        ("mass_kg", real(settings.mass_kg)),
        ("height_cm", real(settings.height_cm)),
        ("side", text(step.side.name())),
        ("recording", text(recording)),
        ("step", integer(Some(step.number as usize))),
        ("start_s", real(Some(step.start_s))),
        ("duration_s", real(Some(step.duration_s))),
        ("region", text(region.name())),
        ("fitted", Value::Flag(Some(fit.is_ok()))),
        ("reason", Value::Text(fit.as_ref().err().map(NotFitted::to_string))),
        ("contact_on_kpa", kpa(contact.on_kpa)),
        ("contact_off_kpa", kpa(contact.off_kpa)),
        ("contact_full_kpa", kpa(contact.full_kpa)),
        ("filter", text(options.filter.name())),
        ("method", text(options.method.name())),
        ("masked_cells", integer(Some(curves.record.masked_cells.into()))),
    ];
    let mut row: FitRow = origin.map(|(name, value)| (name.into(), value)).into();
    let fit = fit.ok();
    let fit = fit.as_ref();
    let value = |variable: Variable| (variable.name(), real(variable.of([&curves.record], fit)));
    row.extend(Variable::loads().chain(Variable::quantities()).map(value));
    for (i, [name, low, high, at_bound]) in PARAMETER_COLUMNS.into_iter().enumerate() {
        // The interval of A B is in m2, and its columns are in mm2.
        let factor = if i == 0 { 1e6 } else { 1.0 };
        let interval = fit.and_then(|fit| fit.uncertainty.as_ref()).map(|u| &u.intervals[i]);
        row.extend(Variable::all().filter(|variable| variable.name() == name).map(value));
        // The interval follows from the Jacobian matrix of the fit, because an interval from resampled steps needs several steps.
        row.push((low.into(), real(interval.map(|i| i.jacobian[0] * factor))));
        row.push((high.into(), real(interval.map(|i| i.jacobian[1] * factor))));
        row.push((at_bound.into(), Value::Flag(interval.map(|i| i.at_bound))));
    }
    // The variables that are neither loads, quantities nor identified parameters.
    let rest: Vec<_> =
        Variable::all().map(value).filter(|(name, _)| row.iter().all(|(other, _)| other != name)).collect();
    row.extend(rest);
    let quality = fit.map(|fit| &fit.quality);
    row.push(("floor_percent".into(), real(quality.map(|q| q.floor * 100.0))));
    row.push(("peak_bias_percent".into(), real(quality.map(|q| q.peak_bias * 100.0))));
    row.push(("evaluations".into(), integer(fit.map(|fit| fit.evaluations))));
    row.push(("c_by".into(), Value::Text(fit.map(|fit| fit.fixed.scale.name().into()))));
    let defects = fit.map(|fit| fit.defects.join(DEFECT_SEPARATOR)).filter(|defects| !defects.is_empty());
    row.push(("defects".into(), Value::Text(defects)));
    row
}
