//! Electrical faults of a sensor matrix, applied to the codes of a fault-free matrix.

use crate::{Scan, Walk};
use emulation::COLUMNS;
use plantar::faults::{FaultKind, Place};
use plantar::pipeline::calibrate::FULL_CODE;
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Factor by which the fault `saturate` amplifies the load of a cell (the difference between its code and that of the unloaded
/// cell), so that the loaded cell reaches full scale.
const SATURATING_GAIN: f64 = 100.0;

/// An electrical fault of the sensor matrix, which begins at a certain time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorFault {
    /// Its kind.
    pub kind: FaultKind,
    /// Its place. The cells are wired in the order of a frame, [`COLUMNS`] to a row.
    pub place: Place,
    /// The parameter of the fault. Stuck: the code. Drift: codes per second. Crosstalk: the fraction of the load of the row's
    /// most loaded other cell that each cell of the row reads in addition to its own load. Other kinds: 0.
    pub value: f64,
    /// Time at which the fault begins, s.
    pub from_s: f64,
}

/// The reason why a text does not describe a fault.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{text}: {why}; write for example {FAULT_EXAMPLES}")]
pub struct ParseFaultError {
    text: String,
    why: &'static str,
}

/// An example of each kind.
pub const FAULT_EXAMPLES: &str = "open-cell:17, open-row:3, open-column:5, short-cell:17, short-row:3, short-column:5, \
                                  stuck:17=12000, saturate:17, drift:17=50/s, crosstalk:3=0.1, each with @SECONDS \
                                  if it begins later";

impl FromStr for SensorFault {
    type Err = ParseFaultError;

    fn from_str(text: &str) -> Result<Self, ParseFaultError> {
        let error = |why| ParseFaultError { text: text.into(), why };
        let (fault, from) = text.split_once('@').unwrap_or((text, "0"));
        let from_s: f64 = from.parse().map_err(|_| error("@ is followed by a time in seconds"))?;
        if !(from_s >= 0.0 && from_s.is_finite()) {
            return Err(error("a fault begins at 0 s or later"));
        }
        let (name, at) = fault.split_once(':').ok_or_else(|| error("a fault is KIND:PLACE[=VALUE][@SECONDS]"))?;
        let (number, value) = at.split_once('=').map_or((at, None), |(number, value)| (number, Some(value)));
        let number: u16 = number.parse().map_err(|_| error("cells, rows and columns are numbers from 0"))?;
        let line = || match u8::try_from(number) {
            Ok(line) if usize::from(line) < COLUMNS => Ok(line),
            _ => Err(error("the matrix has rows and columns 0 to 15")),
        };
        let (kind, place) = match name {
            "open-cell" => (FaultKind::Open, Place::Cell(number)),
            "open-row" => (FaultKind::Open, Place::Row(line()?)),
            "open-column" => (FaultKind::Open, Place::Column(line()?)),
            "short-cell" => (FaultKind::Short, Place::Cell(number)),
            "short-row" => (FaultKind::Short, Place::Row(line()?)),
            "short-column" => (FaultKind::Short, Place::Column(line()?)),
            "stuck" => (FaultKind::Stuck, Place::Cell(number)),
            "saturate" => (FaultKind::Saturated, Place::Cell(number)),
            "drift" => (FaultKind::Drift, Place::Cell(number)),
            "crosstalk" => (FaultKind::Crosstalk, Place::Row(line()?)),
            _ => return Err(error("this kind of fault is unknown")),
        };
        let value = match (kind, value) {
            (FaultKind::Open | FaultKind::Short | FaultKind::Saturated, None) => 0.0,
            (FaultKind::Open | FaultKind::Short | FaultKind::Saturated, Some(_)) => {
                return Err(error("this kind takes no value"));
            }
            (_, None) => return Err(error("this kind takes a value after =")),
            (FaultKind::Drift, Some(value)) => {
                let value = value.strip_suffix("/s").unwrap_or(value);
                value.parse().map_err(|_| error("drift takes a number of codes per second"))?
            }
            (_, Some(value)) => value.parse().map_err(|_| error("the value is not a number"))?,
        };
        let (is_in_range, why) = match kind {
            FaultKind::Stuck => ((0.0..=f64::from(FULL_CODE)).contains(&value), "a stuck code is 0 to 65520"),
            FaultKind::Crosstalk => ((0.0..=1.0).contains(&value), "crosstalk is 0 to 1"),
            _ => (value.is_finite(), "drift takes a number of codes per second"),
        };
        if !is_in_range {
            return Err(error(why));
        }
        Ok(Self { kind, place, value, from_s })
    }
}

impl fmt::Display for SensorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} from {:.2} s", self.kind.name(), self.place, self.from_s)
    }
}

impl SensorFault {
    /// The affected cells of a matrix with `count` cells.
    pub fn cells(&self, count: usize) -> impl Iterator<Item = usize> + use<> {
        let place = self.place;
        (0..count).filter(move |&i| match place {
            Place::Cell(cell) => i == usize::from(cell),
            Place::Row(row) => i / COLUMNS == usize::from(row),
            Place::Column(column) => i % COLUMNS == usize::from(column),
        })
    }

    /// Changes the codes of a scan at the time `t_s`, s, to those of the faulty matrix; `zeros` are the codes of the unloaded
    /// cells.
    pub fn apply(&self, t_s: f64, zeros: &[u16], codes: &mut [u16]) {
        if t_s < self.from_s {
            return;
        }
        let full = f64::from(FULL_CODE);
        let load = |codes: &[u16], i: usize| f64::from(codes[i]) - f64::from(zeros[i]);
        let loads: Vec<(usize, f64)> = self.cells(codes.len()).map(|i| (i, load(codes, i))).collect();
        for &(i, load) in &loads {
            let zero = f64::from(zeros[i]);
            let code = match self.kind {
                FaultKind::Open => zero,
                FaultKind::Short => full,
                FaultKind::Stuck => self.value,
                FaultKind::Saturated => zero + load * SATURATING_GAIN,
                FaultKind::Drift => zero + load + self.value * (t_s - self.from_s),
                FaultKind::Crosstalk => {
                    let others = loads.iter().filter(|&&(other, _)| other != i).map(|&(_, load)| load);
                    zero + load + self.value * others.fold(0.0, f64::max)
                }
            };
            codes[i] = code.round().clamp(0.0, full) as u16;
        }
    }
}

/// A walk on a matrix with electrical faults.
pub struct Faulty<W> {
    walk: W,
    faults: Vec<SensorFault>,
    period_s: f64,
    zeros: Vec<u16>,
}

impl<W: Walk> Faulty<W> {
    /// Applies `faults` to `walk`, in their order. `period_us` is the time between scans; `zeros` are the codes of the unloaded
    /// cells.
    pub fn new(walk: W, faults: Vec<SensorFault>, period_us: u32, zeros: Vec<u16>) -> Self {
        Self { walk, faults, period_s: f64::from(period_us) / 1e6, zeros }
    }
}

impl<W: Walk> Walk for Faulty<W> {
    fn scans(&self) -> u32 {
        self.walk.scans()
    }

    fn scan(&mut self, seq: u32, codes: &mut [u16]) -> Scan {
        let scan = self.walk.scan(seq, codes);
        for fault in &self.faults {
            fault.apply(f64::from(seq) * self.period_s, &self.zeros, codes);
        }
        scan
    }
}
