/** The insole's Bluetooth service. All of it has one base; bits 96 to 103 tell what it is. */
const uuid = (short: string) => `dca8c3${short}-cb96-463f-8bec-f2094e1ccf7b`;

/** The service itself. */
export const SERVICE = uuid("00");
/** Requests are written here; hello, status and refusals come back as indications. */
export const CONTROL = uuid("01");
/** Live frames, notified. */
export const LIVE = uuid("02");
/** Steps, notified. */
export const STEPS = uuid("03");
/** The wearer's parameters; the page has no use for them. */
export const PARAMETERS = uuid("04");

export const BATTERY_SERVICE = 0x180f;
export const BATTERY_LEVEL = 0x2a19;
