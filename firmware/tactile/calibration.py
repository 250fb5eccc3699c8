"""A calibration as the board holds it: lines of integers, checked before they are believed.

One statement a line, in any order, each once except the knots::

    board 4552a1f0             the board it was made on
    plan F3 F4 F5 F6 F7 F8     diodes of ADC 0 to 5
    made 9 9999 20             gain code, exposure in us, LED current in mA
    touch 300 200              force in mN at which a touch begins and ends
    position 1 -2 ...          six weights w, Q13, sum 0
    force 1 -2 ...             six weights v, Q13, sum 8192
    fit 1 -2 ...               six weights u, Q13, sum 0
    x -123456 85000 77         knot: contrast (Q20) -> position in um, expected fit (Q20)
    f 123456 1000 900          knot: brightness (Q20) -> force in mN, tolerance of the fit (Q12)
"""

from .smux import CHANNELS, PIXELS

ONE_Q13 = 1 << 13
# Keeps every sum of decode.dot inside 31 bits.
WEIGHT_SUM_MAX = 8 * ONE_Q13
KNOTS_MAX = 128
_SMALL = 1 << 30

# name: how many integers follow
_FIELDS = {"made": 3, "touch": 2, "position": 6, "force": 6, "fit": 6}


class CalibrationError(ValueError):
    """A calibration that must not be used; the text says why."""


class Calibration:
    """A checked calibration; attributes are named as the lines of the module's text.

    Parameters
    ----------
    lines : iterable of str
        The statements.

    Raises
    ------
    CalibrationError
        If a statement is missing, twice there, unknown or out of range.
    """

    def __init__(self, lines):
        self.board = self.plan = None
        x_knots = []
        f_knots = []
        seen = {}
        for line in lines:
            words = line.split()
            if not words:
                continue
            name = words[0]
            if name == "x":
                x_knots.append(_integers(line, 3))
            elif name == "f":
                f_knots.append(_integers(line, 3))
            elif name in seen:
                raise CalibrationError("'%s' is there twice" % name)
            elif name == "board" and len(words) == 2:
                self.board = seen[name] = words[1]
            elif name == "plan":
                self.plan = seen[name] = tuple(words[1:])
            elif name in _FIELDS:
                seen[name] = _integers(line, _FIELDS[name])
            else:
                raise CalibrationError("'%s' is no line of a calibration" % line[:40])
        for name in ("board", "plan") + tuple(_FIELDS):
            if name not in seen:
                raise CalibrationError("the line '%s' is missing" % name)
        if len(set(self.plan)) != CHANNELS or any(d not in PIXELS for d in self.plan):
            raise CalibrationError("'plan' needs six different diodes")
        self.gain, self.exposure_us, self.led_mA = seen["made"]
        self.touch_on_mN, self.touch_off_mN = seen["touch"]
        if not 0 < self.touch_off_mN <= self.touch_on_mN:
            raise CalibrationError("'touch' needs 0 < end <= begin")
        self.position = _weights("position", seen["position"], 0)
        self.force = _weights("force", seen["force"], ONE_Q13)
        self.fit = _weights("fit", seen["fit"], 0)
        self.contrasts, self.positions_um, self.fits = _table("x", x_knots)
        self.brightnesses, self.forces_mN, self.tolerances = _table("f", f_knots)

    def mismatch(self, board, plan, gain, exposure_us, led_mA):
        """Return why this calibration does not hold for such readings, or None."""
        if board != self.board:
            return "the calibration was made on board %s, this is %s" % (self.board, board)
        if tuple(plan) != self.plan:
            return "the calibration was made with channels " + " ".join(self.plan)
        made = (self.gain, self.exposure_us, self.led_mA)
        if (gain, exposure_us, led_mA) != made:
            return (
                "the calibration was made at gain=%d exposure_us=%d led_mA=%d; "
                "set these, or calibrate anew" % made
            )
        return None


def _integers(line, count):
    words = line.split()[1:]
    try:
        values = tuple(int(word) for word in words)
    except ValueError:
        values = ()
    if len(values) != count or any(not -_SMALL <= v < _SMALL for v in values):
        raise CalibrationError("'%s' needs %d integers of 31 bits" % (line[:40], count))
    return values


def _weights(name, weights, total):
    if sum(weights) != total:
        raise CalibrationError("the weights of '%s' must add up to %d" % (name, total))
    if sum(abs(w) for w in weights) > WEIGHT_SUM_MAX:
        raise CalibrationError("the weights of '%s' are too large" % name)
    return weights


def _table(name, knots):
    if not 2 <= len(knots) <= KNOTS_MAX:
        raise CalibrationError("'%s' needs 2 to %d knots" % (name, KNOTS_MAX))
    for a, b in zip(knots, knots[1:]):
        step = b[0] - a[0]
        if step <= 0:
            raise CalibrationError("the knots of '%s' must ascend" % name)
        if any(step * (abs(b[i] - a[i]) + 1) >= _SMALL for i in (1, 2)):
            raise CalibrationError("the knots of '%s' lie too far apart" % name)
    rising = [b[1] > a[1] for a, b in zip(knots, knots[1:])]
    if any(r != rising[0] for r in rising) or any(a[1] == b[1] for a, b in zip(knots, knots[1:])):
        raise CalibrationError("the table of '%s' is not monotone" % name)
    return tuple(tuple(knot[i] for knot in knots) for i in range(3))
