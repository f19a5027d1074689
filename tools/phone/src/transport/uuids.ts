/** The insole's Bluetooth service. All of it has one base; bits 96 to 111 tell what it is. */
const uuid = (short: string) => `7b1e${short}-6c1f-4b0a-9d35-2f8c51a7e604`;

/** The service itself. */
export const SERVICE = uuid("0001");
/** Requests are written here; hello, status and refusals come back as indications. */
export const CONTROL = uuid("0002");
/** Live frames, notified. */
export const LIVE = uuid("0003");
/** Steps, notified. */
export const STEPS = uuid("0004");
/** The wearer's parameters; the page has no use for them. */
export const PARAMETERS = uuid("0005");

export const BATTERY_SERVICE = 0x180f;
export const BATTERY_LEVEL = 0x2a19;
