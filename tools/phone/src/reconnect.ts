/** Reconnection: the intervals that transports and sessions use, and the retries of a transport. */

/** Time after a link broke, or after an attempt failed, before the next attempt to open the link. */
export const RETRY_MS = 1000;
/**
 * Longest time without a message. After this time the connection counts as lost, if several requests were not answered in it
 * (`UNANSWERED_REQUESTS` in session.ts).
 */
export const TIMEOUT_MS = 2000;
/** Time between two connect requests. The insole answers a connect request with a hello. */
export const CONNECT_REQUEST_MS = 500;

/** Tries to open a link again until an attempt succeeds. */
export class Reconnect {
  private timer: ReturnType<typeof setTimeout> | undefined;
  private is_stopped = false;

  /** `open` opens the link. If this fails, it throws an error or rejects its promise. */
  constructor(private readonly open: () => unknown) {}

  /** Schedules an attempt. To be called when the link breaks. */
  later(): void {
    if (this.is_stopped) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.attempt(), RETRY_MS);
  }

  /** Stops all further attempts. */
  stop(): void {
    this.is_stopped = true;
    clearTimeout(this.timer);
  }

  private async attempt(): Promise<void> {
    try {
      await this.open();
    } catch {
      this.later();
    }
  }
}
