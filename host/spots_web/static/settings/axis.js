// Computes the signal of an axis as the controller does: shaping, one_euro and gamepad_engine of the room
// controller. A test compares both.

// Returns the deflection of a value, -1 to 1: 0 at rest, -1 at the low end, 1 at the high end.
export function deflection(value, rest, low, high) {
  const share = value >= rest ? (value - rest) / (high - rest) : (value - rest) / (rest - low);
  return Math.max(-1, Math.min(share, 1));
}

// Applies deadband, expo (a curve that is finer near 0) and inversion to a deflection.
export function shaped(u, { deadband, expo, invert }) {
  let out = Math.abs(u) <= deadband ? 0 : (u > 0 ? u - deadband : u + deadband) / (1 - deadband);
  out -= expo * (out - out ** 3);
  return invert ? -out : out;
}

// Returns the name of the reading's value that an axis follows, and the rest and bounds of this value.
export function range(axis, length_um) {
  if (axis.from === "force") return { name: "force_mN", rest: axis.rest_mN, low: -Infinity, high: axis.max_mN };
  const [rest, low, high] = [axis.rest_percent, axis.min_percent, axis.max_percent].map((one) => (one * length_um) / 100);
  return { name: "position_um", rest, low, high };
}

// Returns a One Euro filter: a low-pass filter whose cutoff frequency grows with the speed of the signal.
export function oneEuro() {
  let value = null, perS = 0;
  const alpha = (hz, dt_s) => 1 / (1 + 1 / (2 * Math.PI * hz * dt_s));
  return {
    reset: () => { value = null; perS = 0; },
    take: (next, dt_s, { min_cutoff_hz, beta, derivative_cutoff_hz }) => {
      if (value === null) value = next;
      else if (dt_s > 0) {
        perS += alpha(derivative_cutoff_hz, dt_s) * ((next - value) / dt_s - perS);
        value += alpha(min_cutoff_hz + beta * Math.abs(perS), dt_s) * (next - value);
      }
      return value;
    },
  };
}
