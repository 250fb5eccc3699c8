// Fingers on the simulated strip: where they press, and how hard over time.

const TOUCH_MN = 2000, TOUCH_US = 25_000;  // a finger without a pressure sensor: its force after the first milliseconds
const GROWS_MN_S = 1500, MOST_MN = 8000;  // then it grows while it is held
const FULL_MN = 8000;  // at full pressure of a pen or touch screen
const LIFT_US = 15_000, SLEW_US = 12_000;  // duration of a lift, and of a change of the pressure

// A finger is {xMm, fromMN, toMN, sinceUs, overUs, grows}: its force changes from one value to another
// over a time, and then perhaps grows.
export function heldMN({ fromMN, toMN, sinceUs, overUs, grows }, timeUs) {
  const afterUs = timeUs - sinceUs;
  if (afterUs <= 0) return fromMN;
  if (afterUs < overUs) return fromMN + (toMN - fromMN) * afterUs / overUs;
  return grows ? Math.min(toMN + GROWS_MN_S * (afterUs - overUs) * 1e-6, MOST_MN) : toMN;
}

// Applies an event of a pointer to the fingers, a map by id. `event` is {id, xMm, pressure, down}; without a
// pressure the force grows while the finger is held.
export function move(fingers, { id, xMm, pressure, down }, timeUs) {
  const before = fingers.get(id), held = before ? heldMN(before, timeUs) : 0;
  if (!down) {
    if (before) fingers.set(id, { ...before, fromMN: held, toMN: 0, sinceUs: timeUs, overUs: LIFT_US, grows: false });
  } else if (before && before.grows && !pressure) {
    fingers.set(id, { ...before, xMm });
  } else {
    if (!before) hold(fingers, timeUs);
    const [toMN, overUs] = pressure ? [pressure * FULL_MN, SLEW_US] : [TOUCH_MN, TOUCH_US];
    fingers.set(id, { xMm, fromMN: held, toMN, sinceUs: timeUs, overUs, grows: !pressure });
  }
}

// Lets no finger grow any more: with several fingers, people hold their force.
function hold(fingers, timeUs) {
  for (const [id, one] of fingers) if (one.grows) fingers.set(id, { ...one, fromMN: heldMN(one, timeUs), toMN: heldMN(one, timeUs), sinceUs: timeUs, overUs: 0, grows: false });
}

// Removes the fingers that have left the strip.
export function lifted(fingers, timeUs) {
  for (const [id, one] of fingers) if (!one.toMN && timeUs - one.sinceUs > LIFT_US) fingers.delete(id);
}
