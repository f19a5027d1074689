/** Spoken and felt cues, for a wearer who walks and does not look at the page. */

import type { Cues } from "./identify_session";

/** Cues by the browser's speech and the phone's vibration, where they exist. */
export class PhoneCues implements Cues {
  private audio: AudioContext | undefined;

  say(text: string): void {
    if (!("speechSynthesis" in window)) return;
    // A new cue replaces those that are not spoken yet: they no longer apply.
    speechSynthesis.cancel();
    const utterance = new SpeechSynthesisUtterance(text);
    utterance.lang = "en";
    speechSynthesis.speak(utterance);
  }

  /** Sounds two tones. Browsers allow sound only after the wearer has touched the page. */
  tone(): void {
    this.audio ??= new AudioContext();
    const { audio } = this;
    void audio.resume();
    for (const [start_s, frequency_hz] of [[0, 660], [0.35, 880]] as const) {
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

/** Keeps the screen on while it is held; browsers without this function switch it off as usual. */
export class ScreenLock {
  private lock: Promise<WakeLockSentinel | undefined> | undefined;

  hold(): void {
    if (!("wakeLock" in navigator)) return;
    this.lock ??= navigator.wakeLock.request("screen").catch(() => undefined);
  }

  release(): void {
    void this.lock?.then((lock) => lock?.release());
    this.lock = undefined;
  }
}
