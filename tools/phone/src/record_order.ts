/** Detects records that were lost on the way. An acknowledgement of a record also covers all earlier ones. */

/** Number of repetitions without a missing record after which the insole is assumed to have dropped it. */
const MOST_REPETITIONS = 8;

/** True if `number` follows `other`. Numbers of records wrap at 2^32. */
const isAfter = (number: number, other: number) => number !== other && (number - other) >>> 0 < 2 ** 31;

/** The order of the records of one insole. */
export class RecordOrder {
  /** True until the insole begins to repeat its records. */
  is_repetition_due = false;
  /** The number after that of the last accepted record; `undefined` if any number can follow. */
  private expected: number | undefined;
  /** The first missing number, for which the insole was asked to repeat its records. */
  private missing: number | undefined;
  private repetitions = 0;

  /**
   * Returns true if the record with this number can be used. Otherwise the insole must first repeat all records that are not
   * acknowledged, because records before this one are missing.
   */
  accepts(number: number): boolean {
    if (this.is_repetition_due) return false;
    if (this.expected !== undefined && isAfter(number, this.expected)) {
      if (this.missing !== this.expected) [this.missing, this.repetitions] = [this.expected, 0];
      this.is_repetition_due = this.repetitions < MOST_REPETITIONS;
      this.repetitions += 1;
      if (this.is_repetition_due) return false;
    }
    this.expected = (number + 1) >>> 0;
    return true;
  }

  /** To be called when a session begins, in which the insole sends all its records that are not acknowledged, oldest first. */
  begin(): void {
    this.is_repetition_due = false;
  }

  /** To be called when another host receives the records. The next one that arrives here can have any number. */
  interrupt(): void {
    this.is_repetition_due = false;
    this.expected = undefined;
  }
}
