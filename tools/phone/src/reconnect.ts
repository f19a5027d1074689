/** When to try a lost connection again: the one policy of all transports and sessions. */

/** Time between two attempts to open a link that broke. */
export const RETRY_MS = 1000;
/** Longest time without a message of a live stream. After it, the insole may have restarted and waits for a hello. */
export const SILENCE_MS = 2000;
/** Time between two requests for a hello. */
export const HELLO_MS = 500;

/** Opens a link again, as often as necessary. */
export class Reconnect {
  private timer: ReturnType<typeof setTimeout> | undefined;
  private is_stopped = false;

  /** `open` throws or rejects where it fails. */
  constructor(private readonly open: () => unknown) {}

  /** Call this when the link broke. */
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
