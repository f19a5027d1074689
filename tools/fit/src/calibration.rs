//! The calibration of an insole's cells by known pressures that are the same on all cells, without I/O.
//!
//! By the sensor law ([`SensorLaw`]), a cell with the gain g and the code u above its zero carries the pressure
//! p = g F (u / C)^(1/e): F is the pressure at full scale, C is [`FULL_CODE`], and e is the exponent. A *level* is the plateaus
//! of one nominal pressure: an error of the gauge is the same in all of them, so a level counts once. The gain of a cell is that
//! for which the mean of its logarithmic errors over the levels is 0, with the law of the firmware as the insole evaluates it
//! ([`Curve`]). The errors of a sheet are proportional to the pressure, so all levels have the same weight.
//!
//! The levels also determine the law: ln(u / C) = e (ln p - ln F - ln g), a straight line in ln p. The logarithms are averaged
//! over the cells and over the plateaus of a level, so that the confidence interval of e describes the deviations of the levels
//! from a power law.

use crate::interval::Noise;
use plantar::pipeline::calibrate::{CellCalibration, Curve, FULL_CODE, SensorLaw};
use recording::{Plateau, Plateaus};

/// A cell responds to a pressure if its mean code exceeds its zero by at least this.
const LEAST_RESPONSE: f64 = 16.0;
/// A pressure was not applied if this part of the cells does not respond to it.
const SILENT: f64 = 0.5;
/// Part of full scale from which on a mean code counts as saturated. Single frames above 99 % read as full scale.
const SATURATED: f64 = 0.985;
/// Part of the cells that may saturate at a plateau; at more, the plateau is not used.
const MAX_SATURATED: f64 = 0.1;
/// Part of the cells that may fail.
const MAX_FAILING: f64 = 0.1;
/// Part of the cells that [`Errors::range`] and [`Errors::most`] include.
const MOST: f64 = 0.95;
/// The law of the firmware fits if the mean error is below this at each level.
const LAW_ERROR: f64 = 0.03;
/// Number of offsets of the gauge that are tried to explain a deviation from the law, in each direction.
const OFFSETS: i32 = 500;

/// The reason why plateaus do not determine a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No plateau is without load.
    #[error("no plateau of 0 kPa: measure the insole without load, too")]
    NoZero,
    /// Most cells read no load at a plateau.
    #[error(
        "plateau {number}, {pressure_kpa} kPa: most cells read no load: the pressure was not applied; measure the plateaus \
         again in another folder"
    )]
    NoLoad {
        /// Number of the plateau, from 1.
        number: usize,
        /// Its pressure, kPa.
        pressure_kpa: f64,
    },
    /// Fewer than two different pressures can be used.
    #[error(
        "{0} usable pressures above 0 kPa, but at least two are needed, so that each can be checked by the others: measure \
         more pressures at which few cells saturate"
    )]
    TooFewPressures(usize),
    /// Too many cells fail.
    #[error(
        "{failing} of {cells} cells fail, the first one is cell {cell}: {reason}; check that the pressure acts on the whole \
         insole, and that the insole is intact"
    )]
    TooManyFailing {
        /// Number of cells that fail.
        failing: usize,
        /// Number of cells of the insole.
        cells: usize,
        /// The first one that fails.
        cell: usize,
        /// Why it fails.
        reason: Failure,
    },
    /// The plateaus follow no possible sensor law.
    #[error(
        "the codes of the plateaus would be those of a sensor with the exponent {0:.2}, which is impossible: check the order and \
         the unit of the pressures (kPa above the pressure of the atmosphere)"
    )]
    Law(f64),
}

/// Why a cell cannot be calibrated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// The code without load is too high.
    #[error("shorted: a code of at least half of its scale without load")]
    Shorted,
    /// It does not respond at this pressure, kPa, or at all.
    #[error("no response at {0} kPa")]
    NoResponse(f64),
    /// It is at full scale at all pressures.
    #[error("at full scale at all pressures")]
    Saturated,
    /// The gain is out of range.
    #[error("its gain would be {0:.3}, but a gain is 0.1 to 10")]
    Gain(f64),
}

/// The calibration of an insole.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The calibration of each cell for the law of the firmware. A cell that fails has the median gain, so that it measures
    /// plausibly if it responds again.
    pub cells: Vec<CellCalibration>,
    /// For each cell, why it fails; `None` for a cell that does not.
    pub failures: Vec<Option<Failure>>,
    /// The gains of the cells that do not fail, in increasing order; at least one.
    pub gains: Vec<f64>,
    /// The plateaus with load, in the order of measurement.
    pub checks: Vec<Check>,
    /// The largest difference between a plateau after a lower and one after a higher pressure; `None` without such a pair.
    pub hysteresis: Option<Hysteresis>,
    /// The change of the zero; `None` with only one plateau of 0 kPa.
    pub zero_change: Option<ZeroChange>,
    /// The law that follows from the plateaus; `None` for fewer than three usable levels.
    pub law: Option<FittedLaw>,
}

/// A plateau with load, and the errors of the calibrated cells in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// The pressure by the gauge, kPa.
    pub pressure_kpa: f64,
    /// Number of frames.
    pub frames: u32,
    /// Number of cells at full scale that are not shorted. They are not used.
    pub saturated: usize,
    /// The results; `None` if too many cells saturate, so that the plateau is not used.
    pub result: Option<CheckResult>,
}

/// The errors of the calibrated cells at a plateau.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckResult {
    /// Change of the reading during the measurement, as a fraction of the pressure, mean over the cells: creep, or a pressure
    /// that was not constant.
    pub change: f64,
    /// The errors with the calibration.
    pub errors: Errors,
    /// The errors with gains from the other levels only.
    pub left_out: Errors,
    /// True if this level is the lowest or the highest one, so that the errors of `left_out` are those of an extrapolation.
    pub is_end: bool,
}

/// Errors of the measured pressure, as fractions of that of the gauge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Mean over the cells.
    pub mean: f64,
    /// The quantiles 2.5 % and 97.5 % over the cells.
    pub range: [f64; 2],
    /// The absolute error that 95 % of the cells do not exceed.
    pub most: f64,
}

/// The difference between two plateaus of one nominal pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hysteresis {
    /// The nominal pressure, kPa.
    pub nominal_kpa: f64,
    /// Reading after a higher pressure minus that after a lower one, as a fraction of the latter, mean over the cells.
    pub difference: f64,
}

/// The change from the first to the last plateau of 0 kPa, mean over the cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroChange {
    /// The change of the code.
    pub codes: f64,
    /// This change as a fraction of the mean code above zero at the lowest level.
    pub share: f64,
}

/// The sensor law that follows from the plateaus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedLaw {
    /// The law, with the full scale for which the geometric mean of the gains is 1.
    pub sensor: SensorLaw,
    /// The 95 % confidence interval of the exponent.
    pub interval: [f64; 2],
    /// The largest mean error of a level with the law of the firmware.
    pub worst_firmware: f64,
    /// The largest mean error of a level with this law.
    pub worst: f64,
    /// The offset of the gauge, true minus stated pressure, kPa, with which the law of the firmware fits best.
    pub gauge_offset_kpa: f64,
    /// Whether the law of the firmware fits.
    pub verdict: Verdict,
}

/// Whether the law of the firmware fits the plateaus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It does.
    Fits,
    /// It does not: its error is 3 % or more, at least twice that of the fitted law, and the interval excludes its exponent.
    DoesNotFit,
    /// The plateaus scatter too much to decide.
    Undetermined,
}

/// The codes above zero at a plateau, as fractions of full scale; `None` for cells that fail or saturate.
struct Reading<'p> {
    plateau: &'p Plateau,
    fractions: Vec<Option<f64>>,
    saturated: usize,
}

impl<'p> Reading<'p> {
    fn new(plateau: &'p Plateau, zero_codes: &[f64]) -> Self {
        let full = f64::from(FULL_CODE);
        let (mut fractions, mut saturated) = (Vec::new(), 0);
        for (&code, &zero_code) in plateau.codes.iter().zip(zero_codes) {
            let is_saturated = f64::from(code) >= SATURATED * full;
            saturated += usize::from(is_saturated && !is_shorted(zero_code));
            let is_used = !is_saturated && !is_shorted(zero_code);
            fractions.push(is_used.then(|| (f64::from(code) - zero_code) / full));
        }
        Self { plateau, fractions, saturated }
    }

    fn is_usable(&self) -> bool {
        self.saturated as f64 <= MAX_SATURATED * self.fractions.len() as f64
    }

    fn ln_kpa(&self) -> f64 {
        self.plateau.pressure_kpa.ln()
    }

    /// The cells that have a code and do not respond.
    fn silent(&self) -> usize {
        let is_silent = |fraction: &&f64| **fraction * f64::from(FULL_CODE) < LEAST_RESPONSE;
        self.fractions.iter().flatten().filter(is_silent).count()
    }

    /// Change of the reading, as a fraction of the pressure. For small changes, the pressure of a cell changes by 1/e times the
    /// relative change of its code above zero.
    fn change(&self, law: &SensorLaw) -> f64 {
        let change = |(fraction, change): (&Option<f64>, &f32)| {
            Some(f64::from(*change) / ((*fraction)? * f64::from(FULL_CODE)) / f64::from(law.exponent))
        };
        mean(self.fractions.iter().zip(&self.plateau.changes).filter_map(change))
    }

    /// The errors of all cells with these gains; `None` without cells.
    fn errors(&self, curve: &Curve, gains: &[f64]) -> Option<Errors> {
        let error = |(fraction, gain): (&Option<f64>, &f64)| {
            Some(gain * pressure_kpa((*fraction)?, curve) / self.plateau.pressure_kpa - 1.0)
        };
        let mut errors: Vec<f64> = self.fractions.iter().zip(gains).filter_map(error).collect();
        let mean = mean(errors.iter().copied());
        let range = [quantile(&mut errors, 0.5 - MOST / 2.0)?, quantile(&mut errors, 0.5 + MOST / 2.0)?];
        errors.iter_mut().for_each(|error| *error = error.abs());
        Some(Errors { mean, range, most: quantile(&mut errors, MOST)? })
    }
}

/// The usable readings of one nominal pressure.
struct Level<'p> {
    nominal_kpa: f64,
    readings: Vec<&'p Reading<'p>>,
}

impl Calibration {
    /// Determines the calibration with the law of the firmware.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn of(plateaus: &Plateaus) -> Result<Self, CalibrationError> {
        let zeros: Vec<&Plateau> = plateaus.plateaus.iter().filter(|plateau| plateau.nominal_kpa == 0.0).collect();
        let (Some(first_zero), Some(last_zero)) = (zeros.first(), zeros.last()) else {
            return Err(CalibrationError::NoZero);
        };
        let zero_code = |cell: usize| mean(zeros.iter().map(|plateau| f64::from(plateau.codes[cell])));
        let zero_codes: Vec<f64> = (0..plateaus.cells.len()).map(zero_code).collect();
        let mut readings: Vec<Reading> = Vec::new();
        for (i, plateau) in plateaus.plateaus.iter().enumerate().filter(|(_, plateau)| plateau.nominal_kpa > 0.0) {
            let reading = Reading::new(plateau, &zero_codes);
            let intact = reading.fractions.iter().flatten().count() + reading.saturated;
            if reading.silent() as f64 > SILENT * intact as f64 {
                return Err(CalibrationError::NoLoad { number: i + 1, pressure_kpa: plateau.pressure_kpa });
            }
            readings.push(reading);
        }
        let curve = curve_of(&plateaus.law);
        let (failures, gains) = exclude_failing(&mut readings, &zero_codes, &curve)?;
        let levels = levels(&readings);
        let checks = readings.iter().map(|reading| check(reading, &levels, &plateaus.law, &curve, &gains)).collect();
        let sound = gains.iter().zip(&failures).filter(|(_, failure)| failure.is_none());
        let mut sound: Vec<f64> = sound.map(|(gain, _)| *gain).collect();
        sound.sort_by(f64::total_cmp);
        let median_gain = quantile(&mut sound, 0.5).unwrap_or(1.0);
        let cell = |cell: usize| {
            // The zero of a shorted cell is not valid. Others are rounded up, as by `zero_offset`.
            let offset = if is_shorted(zero_codes[cell]) { 0 } else { zero_codes[cell].ceil() as u16 };
            CellCalibration { offset, gain: failures[cell].map_or(gains[cell], |_| median_gain) as f32 }
        };
        let changes = first_zero.codes.iter().zip(&last_zero.codes).map(|(first, last)| f64::from(last - first));
        let codes = mean(changes.zip(&failures).filter(|(_, failure)| failure.is_none()).map(|(change, _)| change));
        let lowest = levels.first().map_or(f64::NAN, |level| mean_fraction(level)) * f64::from(FULL_CODE);
        Ok(Self {
            cells: (0..plateaus.cells.len()).map(cell).collect(),
            hysteresis: hysteresis(&readings, &plateaus.law),
            zero_change: (zeros.len() > 1).then_some(ZeroChange { codes, share: codes / lowest }),
            law: fitted_law(&levels, &plateaus.law, &curve, &gains)?,
            failures,
            gains: sound,
            checks,
        })
    }

    /// The median gain of the cells that do not fail.
    pub fn median_gain(&self) -> f64 {
        self.gains.get(self.gains.len().saturating_sub(1) / 2).copied().unwrap_or(1.0)
    }
}

/// True if a calibration must not have this code as its offset.
fn is_shorted(zero_code: f64) -> bool {
    !CellCalibration { offset: zero_code.ceil() as u16, gain: 1.0 }.is_valid()
}

fn curve_of(law: &SensorLaw) -> Curve {
    let mut curve = Curve::new();
    curve.set(law);
    curve
}

/// The pressure of a cell with the gain 1, kPa, at a code above zero, a fraction of full scale: as the insole evaluates it, and
/// on the line between two whole codes, because the fraction is that of a mean code.
fn pressure_kpa(fraction: f64, curve: &Curve) -> f64 {
    let code = (fraction * f64::from(FULL_CODE)).clamp(0.0, u16::MAX.into());
    let [low, high] = [code.floor(), code.ceil()].map(|code| curve.pressure_kpa::<f64>(code as i32));
    low + (code - code.floor()) * (high - low)
}

/// The mean; not a number without values.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// The value that this part of all values does not exceed; `None` without values. Sorts the values.
pub fn quantile(values: &mut [f64], part: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let number = (part * values.len() as f64).ceil().max(1.0);
    values.get(number as usize - 1).copied()
}

/// The levels of the usable readings, in increasing order.
fn levels<'p>(readings: &'p [Reading<'p>]) -> Vec<Level<'p>> {
    let mut levels: Vec<Level> = Vec::new();
    for reading in readings.iter().filter(|reading| reading.is_usable()) {
        let nominal_kpa = reading.plateau.nominal_kpa;
        match levels.iter_mut().find(|level| level.nominal_kpa == nominal_kpa) {
            Some(level) => level.readings.push(reading),
            None => levels.push(Level { nominal_kpa, readings: vec![reading] }),
        }
    }
    levels.sort_by(|a, b| a.nominal_kpa.total_cmp(&b.nominal_kpa));
    levels
}

/// The mean code above zero of all cells at a level, as a fraction of full scale.
fn mean_fraction(level: &Level) -> f64 {
    mean(level.readings.iter().flat_map(|reading| reading.fractions.iter().copied().flatten()))
}

/// The gain of each cell. It is not a finite number for a cell without codes, or with one that is not above zero.
fn gains<'p>(levels: impl Iterator<Item = &'p Level<'p>> + Clone, curve: &Curve) -> Vec<f64> {
    let first = levels.clone().next().and_then(|level| level.readings.first());
    let gain = |cell: usize| {
        let of_level = |level: &Level| {
            let ratio =
                |reading: &&Reading| Some(reading.ln_kpa() - pressure_kpa(reading.fractions[cell]?, curve).ln());
            Some(mean(level.readings.iter().filter_map(ratio))).filter(|mean| !mean.is_nan())
        };
        mean(levels.clone().filter_map(of_level)).exp()
    };
    (0..first.map_or(0, |reading| reading.fractions.len())).map(gain).collect()
}

/// Finds the cells that fail, and removes them from the readings. Returns why they fail, and the gains of all cells.
///
/// # Errors
/// Fails if too many cells fail, or if fewer than two levels can be used.
fn exclude_failing(
    readings: &mut [Reading],
    zero_codes: &[f64],
    curve: &Curve,
) -> Result<(Vec<Option<Failure>>, Vec<f64>), CalibrationError> {
    let levels = levels(readings);
    if levels.len() < 2 {
        return Err(CalibrationError::TooFewPressures(levels.len()));
    }
    let gains = gains(levels.iter(), curve);
    let failure = |(cell, zero_code): (usize, &f64)| {
        if is_shorted(*zero_code) {
            return Some(Failure::Shorted);
        }
        let responds = |reading: &&&Reading| {
            reading.fractions[cell].is_none_or(|fraction| fraction * f64::from(FULL_CODE) >= LEAST_RESPONSE)
        };
        let mut all = levels.iter().flat_map(|level| &level.readings);
        if let Some(silent) = all.find(|reading| !responds(reading)) {
            return Some(Failure::NoResponse(silent.plateau.pressure_kpa));
        }
        if !gains[cell].is_finite() {
            return Some(Failure::Saturated);
        }
        Some(Failure::Gain(gains[cell])).filter(|_| !(0.1..=10.0).contains(&gains[cell]))
    };
    let failures: Vec<Option<Failure>> = zero_codes.iter().enumerate().map(failure).collect();
    let failing = failures.iter().flatten().count();
    if failing == failures.len() || failing as f64 > (MAX_FAILING * failures.len() as f64).max(1.0) {
        let mut all = failures.iter().enumerate().filter_map(|(cell, failure)| Some((cell, (*failure)?)));
        if let Some((cell, reason)) = all.next() {
            return Err(CalibrationError::TooManyFailing { failing, cells: failures.len(), cell, reason });
        }
    }
    for reading in readings {
        for (fraction, failure) in reading.fractions.iter_mut().zip(&failures) {
            *fraction = fraction.filter(|_| failure.is_none());
        }
    }
    Ok((failures, gains))
}

fn check(reading: &Reading, levels: &[Level], law: &SensorLaw, curve: &Curve, all: &[f64]) -> Check {
    let Plateau { nominal_kpa, pressure_kpa, frames, .. } = *reading.plateau;
    let others = levels.iter().filter(|level| level.nominal_kpa != nominal_kpa);
    let result = || {
        Some(CheckResult {
            change: reading.change(law),
            errors: reading.errors(curve, all)?,
            left_out: reading.errors(curve, &gains(others.clone(), curve))?,
            is_end: [levels.first(), levels.last()].into_iter().flatten().any(|end| end.nominal_kpa == nominal_kpa),
        })
    };
    let result = if reading.is_usable() { result() } else { None };
    Check { pressure_kpa, frames, saturated: reading.saturated, result }
}

/// See [`Calibration::hysteresis`]. For small differences, the pressure of a cell differs by 1/e times the relative difference of
/// its code; the difference of the pressures of the gauge is subtracted.
fn hysteresis(readings: &[Reading], law: &SensorLaw) -> Option<Hysteresis> {
    let step = |i: usize| {
        let before_kpa = i.checked_sub(1).map_or(0.0, |before| readings[before].plateau.nominal_kpa);
        readings[i].plateau.nominal_kpa - before_kpa
    };
    let usable = || (0..readings.len()).filter(|i| readings[*i].is_usable());
    let (rising, falling) = (usable().filter(|i| step(*i) > 0.0), usable().filter(|i| step(*i) < 0.0));
    let falling: Vec<&Reading> = falling.map(|i| &readings[i]).collect();
    let pairs = rising.map(|i| &readings[i]).flat_map(|up| falling.iter().map(move |down| (up, *down)));
    let difference = |(up, down): (&Reading, &Reading)| {
        let logarithm =
            |(up, down): (&Option<f64>, &Option<f64>)| Some(((*down)? / (*up)?).ln() / f64::from(law.exponent));
        let codes = mean(up.fractions.iter().zip(&down.fractions).filter_map(logarithm));
        let difference = (codes + up.ln_kpa() - down.ln_kpa()).exp() - 1.0;
        Hysteresis { nominal_kpa: up.plateau.nominal_kpa, difference }
    };
    let equal = pairs.filter(|(up, down)| up.plateau.nominal_kpa == down.plateau.nominal_kpa).map(difference);
    equal.max_by(|a, b| a.difference.abs().total_cmp(&b.difference.abs()))
}

/// The law that fits the levels best; `None` for fewer than three levels. Only cells with a code in each reading are used.
///
/// # Errors
/// Fails if the law is impossible.
fn fitted_law(
    levels: &[Level],
    firmware: &SensorLaw,
    curve: &Curve,
    all_gains: &[f64],
) -> Result<Option<FittedLaw>, CalibrationError> {
    let readings = || levels.iter().flat_map(|level| &level.readings);
    let is_complete = |cell: &usize| readings().all(|reading| reading.fractions[*cell].is_some());
    let complete: Vec<usize> = (0..all_gains.len()).filter(is_complete).collect();
    if levels.len() < 3 || complete.is_empty() {
        return Ok(None);
    }
    let ln_fraction =
        |reading: &&Reading| mean(complete.iter().filter_map(|&cell| reading.fractions[cell]).map(f64::ln));
    let x = |level: &Level| mean(level.readings.iter().map(|reading| reading.ln_kpa()));
    let y = |level: &Level| mean(level.readings.iter().map(ln_fraction));
    let points: Vec<(f64, f64)> = levels.iter().map(|level| (x(level), y(level))).collect();
    let (mean_x, mean_y) = (mean(points.iter().map(|(x, _)| *x)), mean(points.iter().map(|(_, y)| *y)));
    let squares: f64 = points.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    let exponent = points.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>() / squares;
    let residuals: f64 = points.iter().map(|(x, y)| (y - mean_y - exponent * (x - mean_x)).powi(2)).sum();
    let degrees_of_freedom = points.len() as f64 - 2.0;
    let noise = Noise { variance: residuals / degrees_of_freedom, degrees_of_freedom };
    let half = noise.quantile() * (noise.variance / squares).sqrt();
    let law = SensorLaw { full_kpa: (mean_x - mean_y / exponent).exp() as f32, exponent: exponent as f32 };
    if !law.is_valid() {
        return Err(CalibrationError::Law(exponent));
    }
    let worst_of = |curve: &Curve, gains: &[f64]| {
        let of_level = |level: &Level| {
            mean(level.readings.iter().filter_map(|reading| reading.errors(curve, gains)).map(|errors| errors.mean))
        };
        levels.iter().map(|level| of_level(level).abs()).fold(0.0, f64::max)
    };
    let fitted_curve = curve_of(&law);
    let worst = worst_of(&fitted_curve, &gains(levels.iter(), &fitted_curve));
    let worst_firmware = worst_of(curve, all_gains);
    let interval = [exponent - half, exponent + half];
    let excludes = !(interval[0]..=interval[1]).contains(&firmware.exponent.into());
    let verdict = match worst_firmware {
        error if error < LAW_ERROR => Verdict::Fits,
        error if excludes && worst <= error / 2.0 => Verdict::DoesNotFit,
        _ => Verdict::Undetermined,
    };
    let gauge_offset_kpa = gauge_offset_kpa(&points, firmware);
    Ok(Some(FittedLaw { sensor: law, interval, worst_firmware, worst, gauge_offset_kpa, verdict }))
}

/// See [`FittedLaw::gauge_offset_kpa`]: the offset, up to half of the lowest pressure, for which the logarithmic errors of the
/// firmware's law scatter least. `points` are the logarithms of pressure and code of the levels.
fn gauge_offset_kpa(points: &[(f64, f64)], firmware: &SensorLaw) -> f64 {
    let lowest_kpa = points.iter().map(|(x, _)| x.exp()).fold(f64::INFINITY, f64::min);
    let scatter = |offset_kpa: f64| {
        let errors = || points.iter().map(move |(x, y)| (x.exp() + offset_kpa).ln() - y / f64::from(firmware.exponent));
        let center = mean(errors());
        errors().map(|error| (error - center).powi(2)).sum::<f64>()
    };
    let offsets_kpa = (-OFFSETS..=OFFSETS).map(|i| 0.5 * lowest_kpa * f64::from(i) / f64::from(OFFSETS));
    offsets_kpa.min_by(|a, b| scatter(*a).total_cmp(&scatter(*b))).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fastrand::Rng;
    use plantar::pipeline::contact::ContactRule;
    use plantar::pipeline::region::Cell;
    use plantar::pipeline::setup::{Setup, SetupCell};
    use plantar::pipeline::stance_rule::StanceRule;
    use plantar::{Region, Side};

    const CELLS: usize = 240;
    /// The law of the firmware in these tests.
    const LAW: SensorLaw = SensorLaw { full_kpa: 1000.0, exponent: 0.8 };

    /// A sheet with this law, and a gain and a zero for each cell.
    struct Sheet {
        exponent: f64,
        gains: Vec<f64>,
        zeros: Vec<f64>,
    }

    impl Sheet {
        fn new(exponent: f64, rng: &mut Rng) -> Self {
            let gains = (0..CELLS).map(|_| 0.7 + 0.7 * rng.f64()).collect();
            Self { exponent, gains, zeros: (0..CELLS).map(|_| 5900.0 + 100.0 * rng.f64()).collect() }
        }

        /// The code at a true pressure, kPa.
        fn code(&self, cell: usize, pressure_kpa: f64) -> u16 {
            let share = (pressure_kpa / self.gains[cell] / f64::from(LAW.full_kpa)).powf(self.exponent);
            (self.zeros[cell] + share * f64::from(FULL_CODE)).round().min(f64::from(FULL_CODE)) as u16
        }

        fn frame(&self, true_kpa: f64) -> Vec<u16> {
            (0..CELLS).map(|cell| self.code(cell, true_kpa)).collect()
        }

        /// A plateau that is recorded as `stated_kpa`, although `true_kpa` acts.
        fn plateau(&self, stated_kpa: f64, true_kpa: f64) -> Plateau {
            Plateau::of(stated_kpa, stated_kpa, 0, &vec![self.frame(true_kpa); 3]).expect("three frames")
        }

        fn plateaus(&self, pressures_kpa: &[f64]) -> Plateaus {
            self.with(pressures_kpa.iter().map(|&kpa| self.plateau(kpa, kpa)))
        }

        fn with(&self, plateaus: impl Iterator<Item = Plateau>) -> Plateaus {
            let setup = Setup {
                side: Side::Left,
                layout_id: 1,
                period_us: 10_000,
                sensor: LAW,
                contact: ContactRule::COUNTED,
                stance: StanceRule::ADAPTIVE,
            };
            let cell = Cell { x_mm: 0.0, y_mm: 0.0, area_mm2: 60.0, region: Region::Heel };
            let cell = SetupCell::new(cell, CellCalibration::IDEAL, 0);
            let mut all = Plateaus::new(&setup, &[cell; CELLS], "test", "1.0.0");
            all.plateaus.extend(plateaus);
            all
        }
    }

    /// Pressures up and down, as the documentation recommends.
    const CYCLE: [f64; 11] = [0.0, 25.0, 50.0, 100.0, 200.0, 400.0, 200.0, 100.0, 50.0, 25.0, 0.0];

    fn calibrated(plateaus: &Plateaus) -> Calibration {
        Calibration::of(plateaus).expect("a calibration")
    }

    fn refused(plateaus: &Plateaus) -> CalibrationError {
        Calibration::of(plateaus).expect_err("no calibration")
    }

    /// A normal variate, as the sum of twelve uniform ones, of which the variance is 1.
    fn normal(rng: &mut Rng) -> f64 {
        (0..12).map(|_| rng.f64()).sum::<f64>() - 6.0
    }

    #[test]
    fn the_insole_measures_the_true_pressure_with_the_calibration() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(1));
        let calibration = calibrated(&sheet.plateaus(&CYCLE));
        assert!(calibration.failures.iter().all(Option::is_none));
        let curve = curve_of(&LAW);
        for true_kpa in [10.0, 30.0, 75.0, 300.0, 500.0] {
            for (cell, CellCalibration { offset, gain }) in calibration.cells.iter().enumerate() {
                let above_zero = i32::from(sheet.code(cell, true_kpa).saturating_sub(*offset));
                let measured_kpa = f64::from(*gain) * curve.pressure_kpa::<f64>(above_zero);
                // Codes and zeros are whole numbers: a code is 0.1 % of the pressure at 10 kPa.
                let error = measured_kpa / true_kpa - 1.0;
                assert!(error.abs() < 0.004, "cell {cell}: {measured_kpa:.2} of {true_kpa} kPa");
            }
        }
        let law = calibration.law.expect("a law");
        assert!((law.sensor.exponent - 0.8).abs() < 0.002 && law.verdict == Verdict::Fits, "{law:?}");
        assert_eq!(calibration.checks.len(), 9);
        for result in calibration.checks.iter().map(|check| check.result.expect("used")) {
            for errors in [result.errors, result.left_out] {
                let [low, high] = errors.range;
                assert!(errors.most < 0.005 && low <= errors.mean && errors.mean <= high, "{errors:?}");
            }
        }
    }

    #[test]
    fn a_wrong_exponent_is_found_and_the_errors_are_those_of_the_closed_form() {
        let sheet = Sheet::new(0.9, &mut Rng::with_seed(2));
        let mut plateaus = sheet.plateaus(&CYCLE);
        let calibration = calibrated(&plateaus);
        // The gain makes the mean logarithmic error 0, so the error is that relative to the geometric mean of the levels, 100
        // kPa.
        for check in &calibration.checks {
            let expected = (check.pressure_kpa / 100.0f64).powf(0.9 / 0.8 - 1.0) - 1.0;
            let mean = check.result.expect("used").errors.mean;
            assert!((mean - expected).abs() < 0.003, "{} kPa: {mean:.4}, not {expected:.4}", check.pressure_kpa);
        }
        // The plateau of 400 kPa is left out: the geometric mean of the others is 100 / sqrt(2) kPa.
        let result = calibration.checks[4].result.expect("used");
        assert!(
            (result.left_out.mean - ((4.0 * 2.0f64.sqrt()).powf(0.125) - 1.0)).abs() < 0.003 && result.is_end,
            "{result:?}"
        );
        let law = calibration.law.expect("a law");
        assert!((law.sensor.exponent - 0.9).abs() < 0.003 && law.verdict == Verdict::DoesNotFit, "{law:?}");
        assert!(law.worst < 0.003, "{law:?}");
        // With the fitted law in the firmware, no other law is needed, and the gains are those of the sheet.
        plateaus.law = law.sensor;
        let calibration = calibrated(&plateaus);
        assert_eq!(calibration.law.expect("a law").verdict, Verdict::Fits);
        let scale = f64::from(law.sensor.full_kpa / LAW.full_kpa);
        for (cell, gain) in calibration.cells.iter().map(|cell| f64::from(cell.gain)).zip(&sheet.gains) {
            assert!((cell * scale / gain - 1.0).abs() < 0.005, "{cell:.4} of {gain:.4}");
        }
    }

    /// An error of the gauge is the same in all plateaus of a pressure.
    #[test]
    fn the_interval_of_the_exponent_contains_the_true_one_in_95_percent_of_the_calibrations() {
        let rng = &mut Rng::with_seed(3);
        let sheet = Sheet::new(0.8, rng);
        let trials = 300;
        let (mut contained, mut false_alarms) = (0, 0);
        for _ in 0..trials {
            let errors: Vec<(f64, f64)> = CYCLE.iter().map(|kpa| (*kpa, (0.02 * normal(rng)).exp())).collect();
            let error = |kpa: &f64| errors.iter().find(|(of, _)| of == kpa).map_or(1.0, |(_, error)| *error);
            let law = calibrated(&sheet.with(CYCLE.iter().map(|kpa| sheet.plateau(*kpa, kpa * error(kpa))))).law;
            let FittedLaw { interval, verdict, .. } = law.expect("a law");
            contained += usize::from((interval[0]..=interval[1]).contains(&0.8));
            false_alarms += usize::from(verdict == Verdict::DoesNotFit);
        }
        // 285 are expected, with a standard deviation of 3.8.
        assert!((274..=296).contains(&contained), "{contained} of {trials}");
        // 3 % of the cases are 9, with a standard deviation of 3.
        assert!(false_alarms <= 12, "{false_alarms} of {trials}");
    }

    #[test]
    fn hysteresis_creep_and_a_moving_zero_are_reported() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(4));
        let steps =
            [(0.0, 0.0), (50.0, 50.0), (100.0, 100.0), (200.0, 200.0), (100.0, 106.0), (50.0, 51.0), (0.0, 0.1)];
        let mut plateaus = sheet.with(steps.iter().map(|(stated, acts)| sheet.plateau(*stated, *acts)));
        let frames = [198.0, 200.0, 202.0].map(|kpa| sheet.frame(kpa));
        plateaus.plateaus[3] = Plateau::of(200.0, 200.0, 0, &frames).expect("three frames");
        // The gauge shows the deviation of the last plateau of 50 kPa, so it is none of the sheet.
        plateaus.plateaus[5].pressure_kpa = 51.0;
        let calibration = calibrated(&plateaus);
        let Hysteresis { nominal_kpa, difference } = calibration.hysteresis.expect("two pairs");
        assert_eq!(nominal_kpa, 100.0);
        assert!((difference - 0.06).abs() < 0.001, "{difference:.4}");
        let change = calibration.checks[2].result.expect("used").change;
        assert!((change - 0.02).abs() < 0.001, "{change:.4}");
        // 0.1 kPa is 41 codes at a gain of 1, and 50 kPa are 5965 codes.
        let ZeroChange { codes, share } = calibration.zero_change.expect("two zeros");
        assert!((35.0..50.0).contains(&codes) && (0.006..0.009).contains(&share), "{codes:.1}, {share:.4}");
        // Plateaus that repeat a pressure without a higher one between them show no hysteresis.
        assert_eq!(calibrated(&sheet.plateaus(&[0.0, 50.0, 50.0, 100.0, 200.0])).hysteresis, None);
    }

    #[test]
    fn cells_that_fail_are_named_and_do_not_change_the_others() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(5));
        let whole = sheet.plateaus(&CYCLE);
        let mut damaged = whole.clone();
        let shorted = 20..36;
        for plateau in &mut damaged.plateaus {
            let codes = &mut plateau.codes;
            codes[3] = 5950.0;
            codes[shorted.clone()].fill(FULL_CODE.into());
            // A cell with twelve times the pressure of the law.
            codes[9] =
                sheet.zeros[9] as f32 + (codes[9] - sheet.zeros[9] as f32) * (sheet.gains[9] / 12.0).powf(0.8) as f32;
        }
        let (whole, damaged) = (calibrated(&whole), calibrated(&damaged));
        assert_eq!(damaged.failures[3], Some(Failure::NoResponse(25.0)));
        assert!(matches!(damaged.failures[9], Some(Failure::Gain(gain)) if (gain - 12.0).abs() < 0.1));
        assert!(shorted.clone().all(|cell| damaged.failures[cell] == Some(Failure::Shorted)));
        let median = damaged.median_gain() as f32;
        assert_eq!(damaged.cells[20], CellCalibration { offset: 0, gain: median });
        assert_eq!((damaged.gains.len(), damaged.cells[3].gain), (CELLS - 18, median));
        for (cell, (one, other)) in whole.cells.iter().zip(&damaged.cells).enumerate() {
            assert!(damaged.failures[cell].is_some() || one == other, "cell {cell}");
        }
        assert!(damaged.checks.iter().all(|check| check.saturated == 0 && check.result.is_some()));
    }

    #[test]
    fn a_plateau_at_which_many_cells_saturate_is_not_used() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(6));
        let calibration = calibrated(&sheet.plateaus(&[0.0, 50.0, 100.0, 1000.0]));
        let last = calibration.checks.last().expect("three checks");
        assert!(last.saturated > 100 && last.result.is_none(), "{last:?}");
        assert_eq!(calibration.cells, calibrated(&sheet.plateaus(&[0.0, 50.0, 100.0])).cells);
        assert_eq!(calibration.law, None);
    }

    #[test]
    fn an_offset_of_the_gauge_is_named_as_another_cause() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(7));
        let offset_kpa = |kpa: f64| if kpa > 0.0 { 3.0 } else { 0.0 };
        let law = calibrated(&sheet.with(CYCLE.iter().map(|kpa| sheet.plateau(*kpa, kpa + offset_kpa(*kpa))))).law;
        let law = law.expect("a law");
        assert!((law.gauge_offset_kpa - 3.0).abs() < 0.1, "{law:?}");
        let law = calibrated(&Sheet::new(0.9, &mut Rng::with_seed(7)).plateaus(&CYCLE)).law.expect("a law");
        assert!(law.gauge_offset_kpa.abs() > 4.0, "no small offset has the effect of another exponent: {law:?}");
    }

    #[test]
    fn plateaus_that_do_not_suffice_are_refused_with_the_remedy() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(8));
        let error = |pressures_kpa: &[f64]| refused(&sheet.plateaus(pressures_kpa));
        assert_eq!(error(&[50.0, 100.0]), CalibrationError::NoZero);
        assert_eq!(error(&[0.0]), CalibrationError::TooFewPressures(0));
        assert_eq!(error(&[0.0, 100.0, 100.0]), CalibrationError::TooFewPressures(1));
        // The second plateau was measured without pressure.
        let forgotten = [(0.0, 0.0), (50.0, 0.0), (100.0, 100.0)].map(|(stated, acts)| sheet.plateau(stated, acts));
        let error = refused(&sheet.with(forgotten.into_iter()));
        assert_eq!(error, CalibrationError::NoLoad { number: 2, pressure_kpa: 50.0 });
        // The pressures were applied in the opposite order.
        let reversed = [(0.0, 0.0), (50.0, 200.0), (100.0, 100.0), (200.0, 50.0)];
        let error = refused(&sheet.with(reversed.iter().map(|(stated, acts)| sheet.plateau(*stated, *acts))));
        assert!(matches!(error, CalibrationError::Law(exponent) if (exponent + 0.8).abs() < 0.01), "{error:?}");
        let mut outside = sheet.plateaus(&[0.0, 50.0, 100.0]);
        let zeros = outside.plateaus[0].codes.clone();
        outside.plateaus.iter_mut().for_each(|plateau| plateau.codes[..30].copy_from_slice(&zeros[..30]));
        let error = refused(&outside).to_string();
        assert!(error.contains("30 of 240 cells fail") && error.contains("whole insole"), "{error}");
    }
}
