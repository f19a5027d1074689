/** Speech, tones and vibration, for a wearer who does not look at the page. */

import type { Cues } from "./identify_session";

/** Time after its request until which a tone may begin. */
const LATEST_TONE_MS = 1000;

/** Cues by the browser's speech and sound and the phone's vibration, where they exist. */
export class PhoneCues implements Cues {
  private audio: AudioContext | undefined;

  say(text: string): void {
    if (!("speechSynthesis" in window)) return;
    // Only the latest cue applies, so it also replaces one that is being spoken.
    speechSynthesis.cancel();
    const utterance = new SpeechSynthesisUtterance(text);
    utterance.lang = "en";
    speechSynthesis.speak(utterance);
  }

  /** False if the wearer has not touched the page since it was loaded: until then, browsers allow no sound. */
  get is_sound_allowed(): boolean {
    // A browser without this property is given the benefit of the doubt.
    return this.audio?.state === "running" || (navigator.userActivation?.hasBeenActive ?? true);
  }

  /** Sounds tones one after the other, by default those of an alert, unless the browser allows no sound now. */
  tone(frequencies_hz: readonly number[] = [660, 880]): void {
    const audio = (this.audio ??= new AudioContext());
    const requested_ms = performance.now();
    // The browser may resume only at a touch much later. The tones that were requested until then must not sound all at once.
    void audio.resume().then(() => performance.now() - requested_ms < LATEST_TONE_MS && this.play(audio, frequencies_hz));
  }

  private play(audio: AudioContext, frequencies_hz: readonly number[]): void {
    for (const [i, frequency_hz] of frequencies_hz.entries()) {
      const start_s = 0.35 * i;
      const oscillator = new OscillatorNode(audio, { frequency: frequency_hz });
      const gain = new GainNode(audio, { gain: 0.2 });
      oscillator.connect(gain).connect(audio.destination);
      oscillator.start(audio.currentTime + start_s);
      oscillator.stop(audio.currentTime + start_s + 0.25);
    }
  }

  vibrate(pattern_ms: number[]): void {
    // Safari has no vibration.
    if ("vibrate" in navigator) navigator.vibrate(pattern_ms);
  }
}

/** Time after a failed request until the next one. */
const RETRY_MS = 2000;

/** Keeps the screen on from `hold` to `release`. Browsers without this function switch the screen off as usual. */
export class ScreenWakeLock {
  private lock: WakeLockSentinel | undefined;
  private is_held = false;
  private is_requested = false;

  /**
   * To be called a few times a second while the screen must stay on: a browser ends the lock when the page is hidden, and can
   * refuse it, for example while the battery is low.
   */
  hold(): void {
    this.is_held = true;
    if (!("wakeLock" in navigator) || document.hidden || this.is_requested || this.lock?.released === false) return;
    this.is_requested = true;
    void navigator.wakeLock
      .request("screen")
      .then(
        (lock) => {
          this.lock = lock;
          // `release` may have been called before the browser answered.
          if (!this.is_held) this.release();
        },
        () => new Promise((resolve) => setTimeout(resolve, RETRY_MS)),
      )
      .then(() => (this.is_requested = false));
  }

  /** Allows the browser to switch the screen off again. */
  release(): void {
    this.is_held = false;
    void this.lock?.release();
    this.lock = undefined;
  }
}
