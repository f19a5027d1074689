//! A load record: a step, a load bout or an alert. The insole stores it until a host has acknowledged it; without room, it drops
//! records and counts them. Load records are numbered in the order in which the insole completes them: a step once its toe off is
//! confirmed, a load bout some seconds after its end, an alert when it is raised.

use super::{Alert, Bout, Step, ToHost};
use serde::{Deserialize, Serialize};

/// A step, a load bout or an alert.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "most records are steps")]
pub enum LoadRecord {
    /// A step.
    Step(Step),
    /// A load bout.
    Bout(Bout),
    /// An alert.
    Alert(Alert),
}

impl LoadRecord {
    /// The record in this message; `None` if it contains none.
    pub fn of(message: &ToHost) -> Option<Self> {
        match message {
            ToHost::Step(step) => Some(Self::Step(*step)),
            ToHost::Bout(bout) => Some(Self::Bout(*bout)),
            ToHost::Alert(alert) => Some(Self::Alert(*alert)),
            _ => None,
        }
    }

    /// The step; `None` for another record.
    pub fn step(&self) -> Option<&Step> {
        match self {
            Self::Step(step) => Some(step),
            Self::Bout(_) | Self::Alert(_) => None,
        }
    }

    /// The load bout; `None` for another record.
    pub fn bout(&self) -> Option<&Bout> {
        match self {
            Self::Bout(bout) => Some(bout),
            Self::Step(_) | Self::Alert(_) => None,
        }
    }

    /// The alert; `None` for another record.
    pub fn alert(&self) -> Option<&Alert> {
        match self {
            Self::Alert(alert) => Some(alert),
            Self::Step(_) | Self::Bout(_) => None,
        }
    }

    /// The number of the record.
    pub fn number(&self) -> u32 {
        match self {
            Self::Step(step) => step.step,
            Self::Bout(bout) => bout.number,
            Self::Alert(alert) => alert.number,
        }
    }

    /// Start of the record: the number of boots since the one that recorded it, the time since the first scan of that boot, us,
    /// and the time on the wall clock, us since 1970, if the clock was set.
    pub fn start(&self) -> (u32, u64, Option<u64>) {
        match self {
            Self::Step(step) => (step.boots_since, step.start_us, step.start_unix_us),
            Self::Bout(bout) => (bout.boots_since, bout.start_us, bout.start_unix_us),
            Self::Alert(alert) => (alert.boots_since, alert.start_us, alert.start_unix_us),
        }
    }

    /// The same record with another [`boots_since`](Step::boots_since).
    #[must_use]
    pub fn with_boots_since(self, boots_since: u32) -> Self {
        match self {
            Self::Step(step) => Self::Step(Step { boots_since, ..step }),
            Self::Bout(bout) => Self::Bout(Bout { boots_since, ..bout }),
            Self::Alert(alert) => Self::Alert(Alert { boots_since, ..alert }),
        }
    }

    /// True if both are the same record, even if the insole restarted between them.
    ///
    /// Records that are equal but for [`boots_since`](Step::boots_since) are the same. The number alone does not identify a
    /// record: an insole with a new flash chip numbers its records from 0 again.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        self.with_boots_since(0) == other.with_boots_since(0)
    }
}

impl From<Step> for LoadRecord {
    fn from(step: Step) -> Self {
        Self::Step(step)
    }
}

impl From<Bout> for LoadRecord {
    fn from(bout: Bout) -> Self {
        Self::Bout(bout)
    }
}

impl From<Alert> for LoadRecord {
    fn from(alert: Alert) -> Self {
        Self::Alert(alert)
    }
}

impl From<&LoadRecord> for LoadRecord {
    fn from(record: &LoadRecord) -> Self {
        *record
    }
}

impl From<LoadRecord> for ToHost {
    fn from(record: LoadRecord) -> Self {
        match record {
            LoadRecord::Step(step) => Self::Step(step),
            LoadRecord::Bout(bout) => Self::Bout(bout),
            LoadRecord::Alert(alert) => Self::Alert(alert),
        }
    }
}
