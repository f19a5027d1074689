/** The identification, as WebAssembly: collects the steps in the insoles' messages, and fits the parameters of the tissue. */

import type { Side } from "./generated/quantities";
import type { Insole } from "./transport/transport";

/** The exports of tools/phone/identify, where they are described. */
interface Exports {
  memory: WebAssembly.Memory;
  resize_buffer(length: number): number;
  result(): number;
  clear(): void;
  add(insole: number): number;
  collected(): number;
  identify(insole: number, size: number): number;
}

/** The steps of one insole so far. */
export interface Collected {
  side: Side;
  /** Frame rate: 1 divided by the smallest time between two live frames; 0 before the second frame. */
  rate_hz: number;
  /** Number of steps that a fit can use. */
  good: number;
  /** The insole seems to lie under the wrong foot. */
  mirrored: boolean;
  /** Number of steps that a fit cannot use, by reason. */
  excluded: {
    /** Too many successive frames of the step are missing, or its frames do not agree with its record. */
    broken: number;
    /** The peak force is below 60 % of the median peak force of the steps. */
    partial: number;
    /** Recorded before this session or before a restart of the insole. */
    before: number;
  };
}

/** The 95 % interval of a parameter. */
interface Interval {
  /** The lower and the upper end of the interval, computed from the Jacobian of the fit; `null` for an infinite end. */
  jacobian: [number | null, number | null];
  /** The value is at a bound of the search. */
  at_bound: boolean;
  /** The parameter is identifiable: the measured forces determine it. False for `m` if the damping is 0, and for a parameter that
   * remains nearly as uncertain as it is among people. */
  is_identifiable: boolean;
}

/** The result of one region; `reason` states why a region could not be fitted. */
export type RegionResult =
  | { fitted: false; reason: string }
  | {
      fitted: true;
      identified: Record<Parameter, number>;
      uncertainty: { intervals_95: Record<Parameter, Interval> };
      /** The parameters of the ellipsoid. The names contain the units. */
      ellipsoid: Record<string, number>;
      /**
       * NRMSE. `fitted`: of the fit; `predicted`: mean over steps, each with the parameters of the other steps
       * (cross-validation), null for a single step; `floor`: of the best non-decreasing function of area, chosen for each step.
       */
      nrmse_percent: { fitted: number; predicted: number | null; floor: number };
      /** A phrase that states how well the model predicts the force, and what limits it. */
      verdict: string;
      warnings: string[];
    };

/** The parameters that the measured force determines. docs/identification.md describes them. */
export type Parameter = "ab_m2" | "stiffness_pa" | "damping_pa_s" | "n" | "m";

/**
 * The result of one foot: the JSON of `plantar fit`, with the additional keys `fitted`, `message`, `tissue_id` and
 * `parameters`.
 */
export interface FootResult {
  /** Number of fitted regions. */
  fitted: number;
  /** The steps that the fit uses. */
  steps: unknown[];
  /** The regions by name. */
  regions: Record<string, RegionResult>;
  /** The bytes of the request that sends the parameters to the insole. */
  message: number[];
  /** The insole confirms the parameters with this number. */
  tissue_id: number;
  /** The text of the parameter file. */
  parameters: string;
}

/** The WebAssembly module of the identification. It collects the messages of the insoles in its memory. */
export class IdentifyCore {
  private readonly text = new TextDecoder();

  private constructor(private readonly core: Exports) {}

  /** `fitted` is called during {@link identify} with the index of each region when its fit is complete. */
  static async load(module: Response | Promise<Response>, fitted: (region: number) => void): Promise<IdentifyCore> {
    const { instance } = await WebAssembly.instantiateStreaming(module, { page: { region_fitted: fitted } });
    return new IdentifyCore(instance.exports as unknown as Exports);
  }

  /** Removes all messages. */
  clear(): void {
    this.core.clear();
  }

  /** Adds a message of an insole. Returns true if it is a step. */
  add(insole: Insole, message: Uint8Array): boolean {
    const address = this.core.resize_buffer(message.length);
    new Uint8Array(this.core.memory.buffer, address, message.length).set(message);
    return this.core.add(insole) !== 0;
  }

  /** The steps of both insoles so far. */
  collected(): Collected[] {
    return this.read(this.core.collected()) as Collected[];
  }

  /**
   * Fits the parameters of one insole. `size` is the European shoe size. Throws an error with a message for the wearer if the
   * steps of the insole cannot be fitted together.
   */
  identify(insole: Insole, size: number): FootResult {
    const result = this.read(this.core.identify(insole, size)) as FootResult | { error: string };
    if ("error" in result) throw new Error(result.error);
    return result;
  }

  private read(length: number): unknown {
    return JSON.parse(this.text.decode(new Uint8Array(this.core.memory.buffer, this.core.result(), length)));
  }
}
