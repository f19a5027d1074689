//! The calibration of an insole's cells by known pressures that are the same on all cells, without I/O.
//!
//! By the sensor law ([`SensorLaw`]), a cell with the gain g and the code u above its zero carries the pressure
//! p = g F (u / C)^(1/e): F is the pressure at full scale, C is [`FULL_CODE`], and e is the exponent. The gains of all cells are
//! determined with the law of the firmware, so that the mean of the logarithmic errors of each cell over the plateaus is 0: each
//! plateau counts as much as any other, because the errors of a sheet are proportional to the pressure.
//!
//! The plateaus also determine the law: ln(u / C) = e (ln p - ln F - ln g), a straight line in ln p. The logarithms are averaged
//! over the cells, so that the confidence interval of e describes the deviations of the plateaus: those of the applied pressure,
//! of a sheet that does not follow a power law, and of its hysteresis.

#[cfg(doc)]
use plantar::pipeline::calibrate::SensorLaw;
use plantar::pipeline::calibrate::{CellCalibration, FULL_CODE};
use recording::{Plateau, Plateaus};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Smallest code above the zero, at the highest pressure, of a cell that responds.
const LEAST_RESPONSE: f64 = 64.0;
/// Part of full scale from which on a mean code counts as saturated. Single frames above 99 % read as full scale.
const SATURATED: f64 = 0.985;
/// Part of the cells that may saturate at a plateau; at more, the plateau is not used.
const MAX_SATURATED: f64 = 0.01;
/// Part of the cells that may fail.
const MAX_FAILING: f64 = 0.1;
/// Part of the cells that [`Errors::range`] and [`Errors::most`] include.
const MOST: f64 = 0.95;
/// The law of the firmware is reported as wrong if a mean error is at least this, and is halved by the law of the plateaus.
const LAW_ERROR: f64 = 0.03;

/// The reason why plateaus do not determine a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No plateau is without load.
    #[error("no plateau of 0 kPa: measure the insole without load, too")]
    NoZero,
    /// Fewer than two different pressures can be used.
    #[error(
        "{0} usable pressures above 0 kPa, but at least two are needed, so that each can be checked by the others: measure \
         more pressures at which no cells saturate"
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
}

/// Why a cell cannot be calibrated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// The code without load is too high.
    #[error("it reads a code of at least half of its scale without load")]
    Shorted,
    /// It hardly responds.
    #[error("it does not respond to pressure")]
    NoResponse,
    /// The gain is out of range.
    #[error("its gain would be {0:.3}, but a gain is 0.1 to 10")]
    Gain(f64),
}

/// The calibration of an insole.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The calibration of each cell for the law of the firmware. A cell that fails has the gain 1.
    pub cells: Vec<CellCalibration>,
    /// The cells that fail, with the reason.
    pub failing: Vec<(usize, Failure)>,
    /// The plateaus with load, in the order of measurement.
    pub checks: Vec<Check>,
    /// The largest difference between plateaus of equal pressure, as a fraction of the pressure: the later one minus the earlier
    /// one, mean over the cells. With increasing and then decreasing pressures it is the hysteresis. `None` without such
    /// plateaus.
    pub hysteresis: Option<(f64, f64)>,
    /// Change of the code without load from the first to the last plateau of 0 kPa, mean over the cells; `None` with only one.
    pub zero_change: Option<f64>,
    /// The law that follows from the plateaus; `None` for fewer than three usable plateaus.
    pub law: Option<FittedLaw>,
}

/// A plateau with load, and the errors of the calibrated cells in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// The pressure, kPa.
    pub pressure_kpa: f64,
    /// Number of frames.
    pub frames: u32,
    /// Number of cells at full scale. They are not used.
    pub saturated: usize,
    /// Change of the reading during the measurement, as a fraction of the pressure, mean over the cells: creep, or a pressure
    /// that was not constant.
    pub change: f64,
    /// The errors with the calibration; `None` if too many cells saturate, so that the plateau is not used.
    pub errors: Option<Errors>,
    /// The errors with gains from the plateaus of other pressures only: the accuracy to expect at a pressure between, or beyond,
    /// those of the calibration. `None` for a plateau that is not used.
    pub left_out: Option<Errors>,
    /// The mean error, as [`Errors::mean`], with the law and the gains that follow from the plateaus.
    pub fitted_law_mean: Option<f64>,
}

/// Errors of the measured pressure, as fractions of the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Mean over the cells.
    pub mean: f64,
    /// The quantiles 2.5 % and 97.5 % over the cells.
    pub range: [f64; 2],
    /// The absolute error that 95 % of the cells do not exceed.
    pub most: f64,
}

/// The sensor law that follows from the plateaus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedLaw {
    /// The exponent.
    pub exponent: f64,
    /// The 95 % confidence interval of the exponent.
    pub interval: [f64; 2],
    /// The full scale for which the geometric mean of the gains is 1, kPa.
    pub full_kpa: f64,
    /// True if the law of the firmware is wrong by more than the gains can compensate.
    pub is_needed: bool,
}

/// The codes above zero at a plateau, as fractions of full scale; `None` for cells that fail or saturate.
struct Reading<'p> {
    plateau: &'p Plateau,
    shares: Vec<Option<f64>>,
    saturated: usize,
}

impl Reading<'_> {
    fn is_usable(&self) -> bool {
        self.saturated as f64 <= MAX_SATURATED * self.shares.len() as f64
    }

    fn ln_kpa(&self) -> f64 {
        self.plateau.pressure_kpa.ln()
    }
}

impl Calibration {
    /// Determines the calibration with the law of the firmware.
    ///
    /// # Errors
    /// [`CalibrationError`].
    pub fn of(plateaus: &Plateaus) -> Result<Self, CalibrationError> {
        let (zeros, loaded): (Vec<_>, Vec<_>) =
            plateaus.plateaus.iter().partition(|plateau| plateau.pressure_kpa <= 0.0);
        let (Some(first_zero), Some(last_zero)) = (zeros.first(), zeros.last()) else {
            return Err(CalibrationError::NoZero);
        };
        let count = plateaus.cells.len();
        let law = [f64::from(plateaus.law.full_kpa), f64::from(plateaus.law.exponent)];
        let zero = |cell: usize| mean(zeros.iter().map(|plateau| f64::from(plateau.codes[cell])));
        let zero_codes: Vec<f64> = (0..count).map(zero).collect();
        let mut readings: Vec<Reading> = loaded.iter().map(|plateau| reading(plateau, &zero_codes)).collect();
        let failing = exclude_failing(&mut readings, &zero_codes, law)?;
        let usable: Vec<&Reading> = readings.iter().filter(|reading| reading.is_usable()).collect();
        let gains = gains(&usable, law);
        let fitted = fitted_law(&usable);
        let fitted_gains = fitted.map(|(law, _)| (law, self::gains(&usable, law)));
        let check = |reading: &Reading| {
            let pressure_kpa = reading.plateau.pressure_kpa;
            let is_other = |other: &&Reading| other.plateau.pressure_kpa != pressure_kpa;
            let others: Vec<&Reading> = usable.iter().copied().filter(is_other).collect();
            let errors = |law, gains: &[f64]| errors(reading, law, gains).filter(|_| reading.is_usable());
            Check {
                pressure_kpa,
                frames: reading.plateau.frames,
                saturated: reading.saturated,
                change: change(reading, law),
                errors: errors(law, &gains),
                left_out: errors(law, &self::gains(&others, law)),
                fitted_law_mean: fitted_gains.as_ref().and_then(|(law, gains)| Some(errors(*law, gains)?.mean)),
            }
        };
        let checks: Vec<Check> = readings.iter().map(check).collect();
        let worst = |of: fn(&Check) -> Option<f64>| checks.iter().filter_map(of).map(f64::abs).fold(0.0, f64::max);
        let worst_mean = worst(|check| Some(check.errors?.mean));
        let is_needed = worst_mean >= LAW_ERROR && worst(|check| check.fitted_law_mean) <= worst_mean / 2.0;
        let cell = |cell: usize| {
            let fails = failing.iter().any(|(failing, _)| *failing == cell);
            // The zero of a shorted cell is not valid. Others are rounded up, as by `zero_offset`.
            let offset = if is_shorted(zero_codes[cell]) { 0 } else { zero_codes[cell].ceil() as u16 };
            CellCalibration { offset, gain: if fails { 1.0 } else { gains[cell] as f32 } }
        };
        let changes = first_zero.codes.iter().zip(&last_zero.codes).map(|(first, last)| f64::from(last - first));
        Ok(Self {
            cells: (0..count).map(cell).collect(),
            hysteresis: hysteresis(&usable, law),
            zero_change: (zeros.len() > 1).then(|| mean(changes)),
            law: fitted.map(|([full_kpa, exponent], interval)| FittedLaw { exponent, interval, full_kpa, is_needed }),
            failing,
            checks,
        })
    }
}

/// Finds the cells that fail, and removes them from the readings.
///
/// # Errors
/// Fails if too many cells fail, or if fewer than two different pressures remain.
fn exclude_failing(
    readings: &mut [Reading],
    zero_codes: &[f64],
    law: [f64; 2],
) -> Result<Vec<(usize, Failure)>, CalibrationError> {
    let usable: Vec<&Reading> = readings.iter().filter(|reading| reading.is_usable()).collect();
    let mut pressures: Vec<f64> = usable.iter().map(|reading| reading.plateau.pressure_kpa).collect();
    pressures.sort_by(f64::total_cmp);
    pressures.dedup();
    let highest = match (usable.iter().max_by(|a, b| a.ln_kpa().total_cmp(&b.ln_kpa())), pressures.len()) {
        (Some(highest), 2..) => highest,
        (_, pressures) => return Err(CalibrationError::TooFewPressures(pressures)),
    };
    let gains = gains(&usable, law);
    let failure = |cell: usize| {
        let responds = |share: f64| share * f64::from(FULL_CODE) >= LEAST_RESPONSE;
        if is_shorted(zero_codes[cell]) {
            Some(Failure::Shorted)
        } else if !highest.shares[cell].is_none_or(responds) || !gains[cell].is_finite() {
            Some(Failure::NoResponse)
        } else {
            Some(Failure::Gain(gains[cell])).filter(|_| !(0.1..=10.0).contains(&gains[cell]))
        }
    };
    let cells = zero_codes.len();
    let failing: Vec<_> = (0..cells).filter_map(|cell| Some((cell, failure(cell)?))).collect();
    match failing[..] {
        [(cell, reason), ..] if failing.len() as f64 > MAX_FAILING * cells as f64 => {
            return Err(CalibrationError::TooManyFailing { failing: failing.len(), cells, cell, reason });
        }
        _ => {}
    }
    for reading in readings {
        failing.iter().for_each(|(cell, _)| reading.shares[*cell] = None);
    }
    Ok(failing)
}

/// True if a calibration must not have this code as its offset.
fn is_shorted(zero_code: f64) -> bool {
    !CellCalibration { offset: zero_code.ceil() as u16, gain: 1.0 }.is_valid()
}

fn reading<'p>(plateau: &'p Plateau, zero_codes: &[f64]) -> Reading<'p> {
    let full = f64::from(FULL_CODE);
    let is_saturated = |code: f32| f64::from(code) >= SATURATED * full;
    let share = |(&code, &zero): (&f32, &f64)| (!is_saturated(code)).then(|| (f64::from(code) - zero) / full);
    let shares = plateau.codes.iter().zip(zero_codes).map(share).collect();
    Reading { plateau, shares, saturated: plateau.codes.iter().filter(|&&code| is_saturated(code)).count() }
}

/// The pressure of a cell with the gain 1, kPa, by the law with this full scale, kPa, and exponent. It is not finite or 0 if the
/// code is not above the zero.
fn pressure_kpa(share: f64, [full_kpa, exponent]: [f64; 2]) -> f64 {
    full_kpa * share.max(0.0).powf(1.0 / exponent)
}

/// The gain of each cell; not finite for a cell that does not respond at one of the readings, or saturates at all of them.
fn gains(readings: &[&Reading], law: [f64; 2]) -> Vec<f64> {
    let gain = |cell: usize| {
        let ratios = readings.iter().filter_map(|reading| {
            let share = reading.shares[cell]?;
            Some(reading.ln_kpa() - pressure_kpa(share, law).ln())
        });
        mean(ratios).exp()
    };
    (0..readings.first().map_or(0, |reading| reading.shares.len())).map(gain).collect()
}

/// The mean; not a number without values.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// The errors of all cells with these gains at a reading; `None` without cells.
fn errors(reading: &Reading, law: [f64; 2], gains: &[f64]) -> Option<Errors> {
    let error = |(share, gain): (&Option<f64>, &f64)| {
        Some(gain * pressure_kpa((*share)?, law) / reading.plateau.pressure_kpa - 1.0)
    };
    let all = reading.shares.iter().zip(gains).filter_map(error).filter(|error| error.is_finite());
    let mut errors: Vec<f64> = all.collect();
    let mean = mean(errors.iter().copied());
    let range = [quantile(&mut errors, 0.5 - MOST / 2.0)?, quantile(&mut errors, 0.5 + MOST / 2.0)?];
    errors.iter_mut().for_each(|error| *error = error.abs());
    Some(Errors { mean, range, most: quantile(&mut errors, MOST)? })
}

/// The value that this part of all values does not exceed; `None` without values. Sorts the values.
fn quantile(values: &mut [f64], part: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let number = (part * values.len() as f64).ceil().max(1.0);
    values.get(number as usize - 1).copied()
}

/// The change during a plateau as a fraction of the pressure. For small changes, the pressure of a cell changes by 1/e times the
/// relative change of its code above zero.
fn change(reading: &Reading, [_, exponent]: [f64; 2]) -> f64 {
    let above_zero = |share: &Option<f64>| share.map(|share| share * f64::from(FULL_CODE));
    let changes = reading.shares.iter().zip(&reading.plateau.changes);
    mean(changes.filter_map(|(share, change)| Some(f64::from(*change) / above_zero(share)? / exponent)))
}

/// See [`Calibration::hysteresis`]: the pressure, kPa, and the difference. For small differences, the pressure of a cell differs
/// by 1/e times the relative difference of its code.
fn hysteresis(usable: &[&Reading], [_, exponent]: [f64; 2]) -> Option<(f64, f64)> {
    let pairs =
        usable.iter().enumerate().flat_map(|(i, earlier)| usable[i + 1..].iter().map(move |later| (earlier, later)));
    let equal = pairs.filter(|(earlier, later)| earlier.plateau.pressure_kpa == later.plateau.pressure_kpa);
    let difference = |(earlier, later): (&&Reading, &&Reading)| {
        let logarithms =
            earlier.shares.iter().zip(&later.shares).filter_map(|(a, b)| Some(((*b)? / (*a)?).ln() / exponent));
        (earlier.plateau.pressure_kpa, mean(logarithms).exp() - 1.0)
    };
    equal.map(difference).max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))
}

/// Full scale, kPa, and exponent of the law that fits the readings best, and the 95 % confidence interval of the exponent. Only
/// cells that have a code at each reading are used. `None` for fewer than three readings, or equal pressures.
fn fitted_law(usable: &[&Reading]) -> Option<([f64; 2], [f64; 2])> {
    let cells = usable.first()?.shares.len();
    let is_complete =
        |cell: &usize| usable.iter().all(|reading| reading.shares[*cell].is_some_and(|share| share > 0.0));
    let complete: Vec<usize> = (0..cells).filter(is_complete).collect();
    let x: Vec<f64> = usable.iter().map(|reading| reading.ln_kpa()).collect();
    let y = |reading: &&Reading| mean(complete.iter().filter_map(|&cell| reading.shares[cell]).map(f64::ln));
    let y: Vec<f64> = usable.iter().map(y).collect();
    let (mean_x, mean_y) = (mean(x.iter().copied()), mean(y.iter().copied()));
    let squares: f64 = x.iter().map(|x| (x - mean_x).powi(2)).sum();
    let exponent = x.iter().zip(&y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>() / squares;
    let residuals: f64 = x.iter().zip(&y).map(|(x, y)| (y - mean_y - exponent * (x - mean_x)).powi(2)).sum();
    let freedom = usable.len().checked_sub(2).filter(|freedom| *freedom > 0)? as f64;
    let t = StudentsT::new(0.0, 1.0, freedom).ok()?.inverse_cdf(0.975);
    let half = t * (residuals / freedom / squares).sqrt();
    let law = [(mean_x - mean_y / exponent).exp(), exponent];
    (exponent.is_finite() && law[0].is_finite()).then_some((law, [exponent - half, exponent + half]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fastrand::Rng;
    use plantar::pipeline::calibrate::{Curve, SensorLaw};
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

        /// A plateau that is recorded as `stated_kpa`, although `true_kpa` acts.
        fn plateau(&self, stated_kpa: f64, true_kpa: f64) -> Plateau {
            let frame: Vec<u16> = (0..CELLS).map(|cell| self.code(cell, true_kpa)).collect();
            Plateau::of(stated_kpa, &[frame.clone(), frame.clone(), frame]).expect("three frames")
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
            let cell = SetupCell { cell, calibration: CellCalibration::IDEAL, row_column: 0 };
            let mut all = Plateaus::new(&setup, &[cell; CELLS], "test".into());
            all.plateaus.extend(plateaus);
            all
        }
    }

    #[test]
    fn the_insole_measures_the_true_pressure_with_the_calibration() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(1));
        let calibration =
            Calibration::of(&sheet.plateaus(&[0.0, 20.0, 50.0, 100.0, 200.0, 400.0])).expect("a calibration");
        assert_eq!(calibration.failing, []);
        let mut curve = Curve::new();
        curve.set(&LAW);
        for pressure_kpa in [10.0, 30.0, 75.0, 300.0, 500.0] {
            for (cell, CellCalibration { offset, gain }) in calibration.cells.iter().enumerate() {
                let above_zero = i32::from(sheet.code(cell, pressure_kpa).saturating_sub(*offset));
                let measured_kpa = f64::from(*gain) * curve.pressure_kpa::<f64>(above_zero);
                // Codes and zeros are whole numbers: a code is 0.1 % of the pressure at 10 kPa.
                let error = measured_kpa / pressure_kpa - 1.0;
                assert!(error.abs() < 0.004, "cell {cell}: {measured_kpa:.2} of {pressure_kpa} kPa");
            }
        }
        let law = calibration.law.expect("a law");
        assert!((law.exponent - 0.8).abs() < 0.002 && !law.is_needed, "{law:?}");
        for check in &calibration.checks {
            let is_small = |errors: Errors| {
                errors.most < 0.005 && errors.range[0] <= errors.mean && errors.mean <= errors.range[1]
            };
            assert!(check.errors.is_some_and(is_small), "{check:?}");
            assert!(check.left_out.is_some_and(|errors| errors.most < 0.005), "{check:?}");
        }
    }

    #[test]
    fn a_wrong_exponent_is_found_and_the_errors_are_those_of_the_closed_form() {
        let sheet = Sheet::new(0.9, &mut Rng::with_seed(2));
        let pressures_kpa = [25.0, 50.0, 100.0, 200.0, 400.0];
        let calibration =
            Calibration::of(&sheet.plateaus(&[&[0.0][..], &pressures_kpa].concat())).expect("a calibration");
        // The gain makes the mean logarithmic error 0, so the error is that relative to the geometric mean, 100 kPa.
        for check in &calibration.checks {
            let expected = (check.pressure_kpa / 100.0f64).powf(0.9 / 0.8 - 1.0) - 1.0;
            let mean = check.errors.expect("errors").mean;
            assert!((mean - expected).abs() < 0.002, "{} kPa: {mean:.4}, not {expected:.4}", check.pressure_kpa);
        }
        // The plateau of 400 kPa is left out: the geometric mean of the others is 100 / sqrt(2) kPa.
        let left_out = calibration.checks[4].left_out.expect("errors").mean;
        assert!((left_out - ((4.0 * 2.0f64.sqrt()).powf(0.125) - 1.0)).abs() < 0.002, "{left_out:.4}");
        let law = calibration.law.expect("a law");
        assert!((law.exponent - 0.9).abs() < 0.002 && law.is_needed, "{law:?}");
        assert!(calibration.checks.iter().all(|check| check.fitted_law_mean.is_some_and(|mean| mean.abs() < 0.002)));
        // With the fitted law in the firmware, no other law is needed, and the gains are those of the sheet.
        let firmware = SensorLaw { full_kpa: law.full_kpa as f32, exponent: law.exponent as f32 };
        let mut again = sheet.plateaus(&[&[0.0][..], &pressures_kpa].concat());
        again.law = firmware;
        let calibration = Calibration::of(&again).expect("a calibration");
        assert!(!calibration.law.expect("a law").is_needed);
        let scale = law.full_kpa / f64::from(LAW.full_kpa);
        for (cell, gain) in calibration.cells.iter().map(|cell| f64::from(cell.gain)).zip(&sheet.gains) {
            assert!((cell * scale / gain - 1.0).abs() < 0.004, "{cell:.4} of {gain:.4}");
        }
    }

    #[test]
    fn the_interval_of_the_exponent_contains_the_true_one_in_95_percent_of_the_calibrations() {
        let rng = &mut Rng::with_seed(3);
        let sheet = Sheet::new(0.85, rng);
        let trials = 400;
        let contained = (0..trials).filter(|_| {
            // The applied pressure deviates from the stated one by a normal variate with a standard deviation of 2 %: the sum of
            // 12 uniform variates has the variance 1.
            let pressures = [25.0, 50.0, 100.0, 200.0, 300.0, 400.0];
            let deviations = pressures.map(|_| 0.02 * ((0..12).map(|_| rng.f64()).sum::<f64>() - 6.0));
            let loaded =
                pressures.iter().zip(deviations).map(|(kpa, deviation)| sheet.plateau(*kpa, kpa * deviation.exp()));
            let all = std::iter::once(sheet.plateau(0.0, 0.0)).chain(loaded);
            let law = Calibration::of(&sheet.with(all)).expect("a calibration").law.expect("a law");
            (law.interval[0]..=law.interval[1]).contains(&0.85)
        });
        // 380 of 400 are expected, with a standard deviation of 4.4.
        let contained = contained.count();
        assert!((362..=396).contains(&contained), "{contained} of {trials}");
    }

    #[test]
    fn hysteresis_creep_and_a_moving_zero_are_reported() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(4));
        let steps =
            [(0.0, 0.0), (50.0, 50.0), (100.0, 100.0), (200.0, 200.0), (100.0, 106.0), (50.0, 51.0), (0.0, 0.1)];
        let mut plateaus = sheet.with(steps.iter().map(|(stated, acts)| sheet.plateau(*stated, *acts)));
        let frame = |kpa: f64| (0..CELLS).map(|cell| sheet.code(cell, kpa)).collect::<Vec<_>>();
        plateaus.plateaus[3] = Plateau::of(200.0, &[198.0, 200.0, 202.0].map(frame)).expect("three frames");
        let calibration = Calibration::of(&plateaus).expect("a calibration");
        let (pressure_kpa, difference) = calibration.hysteresis.expect("two pairs");
        assert_eq!(pressure_kpa, 100.0);
        assert!((difference - 0.06).abs() < 0.001, "{difference:.4}");
        assert!((calibration.checks[2].change - 0.02).abs() < 0.001, "{:.4}", calibration.checks[2].change);
        // 0.1 kPa is 41 codes at a gain of 1.
        assert!(
            calibration.zero_change.is_some_and(|codes| (35.0..50.0).contains(&codes)),
            "{:?}",
            calibration.zero_change
        );
    }

    #[test]
    fn cells_that_fail_are_named_and_do_not_change_the_others() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(5));
        let whole = sheet.plateaus(&[0.0, 50.0, 100.0, 200.0]);
        let mut damaged = whole.clone();
        for plateau in &mut damaged.plateaus {
            plateau.codes[3] = 5950.0;
            plateau.codes[7] = FULL_CODE.into();
            // A cell with twelve times the pressure of the law.
            plateau.codes[9] = sheet.zeros[9] as f32
                + (plateau.codes[9] - sheet.zeros[9] as f32) * (sheet.gains[9] / 12.0).powf(0.8) as f32;
        }
        let (whole, damaged) = (Calibration::of(&whole).expect("whole"), Calibration::of(&damaged).expect("damaged"));
        let [(3, Failure::NoResponse), (7, Failure::Shorted), (9, Failure::Gain(gain))] = damaged.failing[..] else {
            panic!("{:?}", damaged.failing)
        };
        assert!((gain - 12.0).abs() < 0.1, "{gain:.3}");
        assert_eq!(damaged.cells[7], CellCalibration { offset: 0, gain: 1.0 });
        for (cell, (one, other)) in whole.cells.iter().zip(&damaged.cells).enumerate() {
            assert!([3, 7, 9].contains(&cell) || one == other, "cell {cell}");
        }
    }

    #[test]
    fn a_plateau_at_which_cells_saturate_is_not_used() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(6));
        let calibration = Calibration::of(&sheet.plateaus(&[0.0, 50.0, 100.0, 1000.0])).expect("a calibration");
        let last = calibration.checks.last().expect("three checks");
        assert!(last.saturated > 100 && last.errors.is_none() && last.left_out.is_none(), "{last:?}");
        assert_eq!(
            calibration.cells,
            Calibration::of(&sheet.plateaus(&[0.0, 50.0, 100.0])).expect("a calibration").cells
        );
    }

    #[test]
    fn plateaus_that_do_not_suffice_are_refused_with_the_remedy() {
        let sheet = Sheet::new(0.8, &mut Rng::with_seed(7));
        let error = |pressures_kpa: &[f64]| Calibration::of(&sheet.plateaus(pressures_kpa)).expect_err("refused");
        assert_eq!(error(&[50.0, 100.0]), CalibrationError::NoZero);
        assert_eq!(error(&[0.0]), CalibrationError::TooFewPressures(0));
        assert_eq!(error(&[0.0, 100.0, 100.0]), CalibrationError::TooFewPressures(1));
        let mut outside = sheet.plateaus(&[0.0, 50.0, 100.0]);
        let zeros = outside.plateaus[0].codes.clone();
        outside.plateaus.iter_mut().for_each(|plateau| plateau.codes[..30].copy_from_slice(&zeros[..30]));
        let error = Calibration::of(&outside).expect_err("refused").to_string();
        assert!(error.contains("30 of 240 cells fail") && error.contains("whole insole"), "{error}");
    }
}
