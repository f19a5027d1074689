//! The evidence of faults that a cell collects from its own readings between two reviews. [`crate::faults`] evaluates it.

use super::contact::ContactCell;

/// Number of rows of the matrix, and of columns.
pub(crate) const LINES: usize = 16;
/// Largest deviation of an unloaded cell from its baseline that counts as noise, codes. With the sensor law of the reference
/// insole, it is 0.1 kPa at the zero, and 0.2 kPa at a baseline of 4 kPa.
pub(crate) const NOISE: u16 = 32;
/// Largest [`CellMarks::lowered`]: 2048 codes, 13 kPa with the same law.
pub(crate) const MAX_LOWERED: u8 = 64;

/// The cell responded since the last review: it read more than noise above its baseline.
pub(crate) const RESPONDED: u8 = 1;
/// The cell exceeded the load threshold, [`ContactCell::load_threshold`].
pub(crate) const LOADED: u8 = 2;
/// The cell was saturated while its neighbours read little.
pub(crate) const IMPLAUSIBLE_SATURATION: u8 = 4;
/// The cell was in contact in the last reviewed swing, and its code has not changed since.
pub(crate) const UNCHANGED: u8 = 8;
/// The cell is masked.
pub(crate) const MASKED: u8 = 16;
/// The cell did not respond in a step in which a response was expected.
pub(crate) const NO_RESPONSE: u8 = 32;
/// The cell was found to be stuck.
pub(crate) const STUCK: u8 = 64;
/// The baseline of the cell was found to drift.
pub(crate) const DRIFT: u8 = 128;

/// A quantity that is counted over several steps. The value is the position of its two bits in [`CellMarks::counts`].
#[derive(Clone, Copy)]
pub(crate) enum Count {
    /// The load counter. A step in which the cell exceeds the load threshold increments it; one in which the cell does not
    /// respond decrements it.
    Loaded = 0,
    /// Successive steps in which the cell did not respond although it was surrounded by loaded cells. [`NO_RESPONSE`] has weaker
    /// conditions, so it is also set in steps that do not count here.
    NoResponse = 2,
    /// Successive swings at full scale, or far below the baseline.
    OffScale = 4,
    /// Successive steps with an implausible saturation.
    ImplausibleSaturation = 6,
}

/// The evidence on one cell. It is packed into six bytes, because it exists for every cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CellMarks {
    /// Reading above the baseline in the last reviewed swing, codes.
    pub(crate) swing_reading: i16,
    /// How far the zero is below the calibrated one, in units of [`NOISE`] codes.
    pub(crate) lowered: u8,
    /// Position in the matrix: row times [`LINES`] plus column.
    row_column: u8,
    flags: u8,
    /// Four counts of up to 3, two bits each; see [`Count`].
    counts: u8,
}

impl CellMarks {
    pub(crate) const fn new(row_column: u8) -> Self {
        Self { swing_reading: 0, lowered: 0, row_column, flags: 0, counts: 0 }
    }

    /// Records a code for which [`ContactCell::update`] was called, and requests the next notification.
    pub(crate) fn note(&mut self, code: u32, baseline: u16, contact: &mut ContactCell) {
        self.clear(UNCHANGED);
        if code > u32::from(baseline) + u32::from(NOISE) {
            self.add(if code >= contact.load_threshold(baseline) { RESPONDED | LOADED } else { RESPONDED });
        }
        self.arm_notification(baseline, contact);
    }

    /// Requests a notification by the contact stage for the first code that would add to the evidence.
    fn arm_notification(&self, baseline: u16, contact: &mut ContactCell) {
        if contact.is_loaded() {
            if !self.has(LOADED) {
                contact.notify_at(contact.load_threshold(baseline));
            }
        } else if !self.has(RESPONDED) {
            contact.notify_at(u32::from(baseline) + u32::from(NOISE) + 1);
        }
    }

    /// Discards the evidence of the last step. A masked cell has none.
    pub(crate) fn begin_step(&mut self, baseline: u16, contact: &mut ContactCell) {
        if self.is_masked() {
            return;
        }
        self.clear(RESPONDED | LOADED | IMPLAUSIBLE_SATURATION);
        if contact.is_loaded() {
            self.add(RESPONDED);
        } else {
            self.arm_notification(baseline, contact);
        }
    }

    pub(crate) fn is_masked(&self) -> bool {
        self.has(MASKED)
    }

    /// Marks the cell as masked, and clears all other flags.
    pub(crate) fn set_masked(&mut self) {
        self.flags = MASKED;
    }

    /// True if the cell is not masked, and no swing gave evidence that its code is stuck or off the scale. Other evidence is not
    /// considered.
    pub(crate) fn is_sound(&self) -> bool {
        !self.has(MASKED | STUCK | UNCHANGED) && self.count(Count::OffScale) == 0
    }

    /// True if any of these flags is set.
    pub(crate) fn has(&self, flags: u8) -> bool {
        self.flags & flags != 0
    }

    pub(crate) fn add(&mut self, flags: u8) {
        self.flags |= flags;
    }

    pub(crate) fn clear(&mut self, flags: u8) {
        self.flags &= !flags;
    }

    pub(crate) fn count(&self, count: Count) -> u8 {
        self.counts >> count as u8 & 3
    }

    pub(crate) fn set_count(&mut self, count: Count, value: u8) {
        self.counts = self.counts & !(3 << count as u8) | value.min(3) << count as u8;
    }

    /// Increments the count if `again` is true; resets it otherwise.
    pub(crate) fn count_if(&mut self, count: Count, again: bool) {
        self.set_count(count, if again { self.count(count) + 1 } else { 0 });
    }

    pub(crate) fn row(&self) -> usize {
        usize::from(self.row_column) / LINES
    }

    fn column(&self) -> usize {
        usize::from(self.row_column) % LINES
    }

    /// The two lines of the cell; see [`CellMarks::is_on`].
    pub(crate) fn lines(&self) -> [usize; 2] {
        [self.row(), LINES + self.column()]
    }

    /// True if the cell is on this line. Lines below [`LINES`] are rows, those from [`LINES`] on are columns.
    pub(crate) fn is_on(&self, line: usize) -> bool {
        line == self.row() || line == LINES + self.column()
    }
}
