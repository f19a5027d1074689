/** Reconnection: its times and its retries, the same for all transports and sessions. */

/** Time between two attempts to open a link that broke. */
export const RETRY_MS = 1000;
/** Longest time without a message in a session. After this time the connection counts as lost. */
export const TIMEOUT_MS = 2000;
/** Time between two connect requests, which the insole answers with a hello. */
export const HELLO_MS = 500;

/** Retries to open a link until it succeeds. */
export class Reconnect {
  private timer: ReturnType<typeof setTimeout> | undefined;
  private is_stopped = false;

  /** `open` throws or rejects if it fails. */
  constructor(private readonly open: () => unknown) {}

  /** Schedules an attempt. To be called when the link breaks. */
  later(): void {
    if (this.is_stopped) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.attempt(), RETRY_MS);
  }

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
