"""A calibration as the board stores it: text lines with integers, validated before use.

Each line is one statement. A number in Qn is multiplied by 2**n. Weights are in Q13. Contrasts and
brightness, which are weighted sums of log2 of the counts (see decode.py), are in Q20. The lines 'f'
and 'x' are knots: points of a table, between which the board interpolates linearly. The statements,
with examples of their values::

    board 4552a1f0             id of the board with which the calibration was made
    plan F3 F4 F5 F6 F7 F8     diodes of ADC 0 to 5
    made 9 9999 20             gain code, exposure in us, LED current in mA
    touch 300 200              force in mN at which a touch begins and ends
    relative                   forces have no unit, because no weighing scale was used; optional
    presser finger             what the tables are for: 'finger' or 'indenter'; 'no_finger' if
                               an indenter calibrated a strip that a finger will press; optional
    coarse 1 -2 ...            six weights, sum 0: the coarse contrast, which selects the segment
    rest 640 12 ...            light of the untouched strip without the dark frame: six sums of
                               counts over 64 samples; optional
    fit 1 -2 ...               six weights, sum 0: the misfit, which shows how far the spectrum is
                               from that of a single press
    segment 1 -2 ... 3 4 ...   twelve weights of one segment of the strip: six for the position
                               (sum 0), six for the force (sum 8192); one line for each segment
    f 123456 1000 900          knot: brightness, force in mN, tolerance of the misfit (Q12);
                               optional: share of the cross-sensitivity (Q12)
    spectrum 5000 812345 ...   position in um, log2 of the six counts of a firm press there (Q16);
                               only for the host, see spots/common/press_spectra.py; optional
    tint 5000 -65536 12 ...    position in um, brightness minus that of a firm press (Q16), change
                               of log2 of the six counts with the force (Q16); only for the host
    silicone 4200 300 1000 ... compensation of hysteresis and creep: factor of the force (Q12);
                               half widths in mN of three play operators, their three weights
                               (Q12); three time constants in ms, their three shares of the force
                               (Q12); optional
    temperature 21000 9000 ... temperature of the board to which the tables belong, and lowest and
                               highest temperature of the re-zeros, in 0.001 degrees Celsius;
                               optional, with one to three lines 'warm', see warming.py
    warm 8500 1200 -800 ...    position in um, change of log2 of the six counts between the lowest
                               and the highest of these temperatures (Q20)
    strain 0                   strain in ppm for the lines 'from' and 'x' that follow
    from -99999                coarse contrast at which a segment begins; its lines 'x' follow
    x -123456 85000 77 -5      knot of the segment: contrast, position in um, expected misfit of a
                               single press (Q12), correction that is subtracted from the
                               brightness; optional: two sizes of the cross-sensitivity

The spectrum of a press can depend on its force (cross-sensitivity). The share at the force, times
the first size at the position, in um, is added to the position; times the second size, in Q12, it
is added to the expected misfit. Either all lines 'f' and 'x' have these values, or none has.

Strains ascend from 0. All strains have the same number of knots, so that the board can
interpolate linearly between two strains. Segments are in the order of ascending coarse contrast.
"""

from array import array

from ..runtime.modules import drop
from ..sensor.smux import CHANNELS, PIXELS
from .decode import BOUNDS, CROSS, DARK_SAMPLES, FORCES, SEGMENTS, WEIGHTS, columns_of

ONE_Q13 = 1 << 13
# Limit of the sum of absolute weights, so that each weighted sum of `kernel.estimate` fits 31 bits.
WEIGHT_SUM_MAX = 8 * ONE_Q13
KNOTS_MAX = 128
STRAIN_MAX_PPM = 500_000
FORCE_MAX_MN = 65_535
_BASELINE_MAX = 65_535 * DARK_SAMPLES
# Limit of every logarithm and contrast; the difference of two still fits 31 bits.
_LOG_MAX = 1 << 28
_STRAIN_Q = 12
# Limits of the values of the cross-sensitivity, so that their products fit 31 bits.
_SHARE_MAX = 1 << 12
_SIZE_MAX = 1 << 17

_PRESSERS = "finger", "indenter", "no_finger"
# Name of a statement: number of its integers.
_ONCE = {"made": 3, "touch": 2, "coarse": 6, "fit": 6, "rest": 6, "silicone": 13}
_ONCE["temperature"] = 3
_OPTIONAL = "rest", "silicone", "temperature"
_FOR_HOST = {"spectrum": 7, "tint": 8}
_MANY = {"segment": 12, "f": 3, "warm": 7}
# Further integers of a line, all or none, for the cross-sensitivity.
_CROSS = {"f": 1, "x": 2}


class CalibrationError(ValueError):
    """Error for an invalid calibration; its message says why."""


def fill(made, lines, strain_ppm):
    """Set the attributes of a `calibration.Calibration`; return the values of its `conditions`.

    See there for the other arguments and the error.
    """
    # Parsing leaves only small free pieces of a board's memory, so `tables` is allocated first.
    room = _room(lines)
    seen = {name: [] for name in _MANY}
    strains = []
    for line in lines:
        words = line.split()
        if words:
            _take(line, words, seen, strains)
    for name in ("board", "plan") + tuple(_ONCE):
        if name not in seen and name not in _OPTIONAL:
            raise CalibrationError("the line '%s' is missing" % name)
    made.relative_force = "relative" in seen
    made.presser = seen.get("presser")
    made.touch_on_mN, made.touch_off_mN = seen["touch"]
    if not 0 < made.touch_off_mN <= made.touch_on_mN:
        raise CalibrationError("'touch' needs two forces, 0 < end <= begin")
    _weights("coarse", seen["coarse"], 0)
    _weights("fit", seen["fit"], 0)
    made.baseline = seen.get("rest", ())
    if made.baseline and not 0 <= min(made.baseline) <= max(made.baseline) <= _BASELINE_MAX:
        raise CalibrationError("the sums of 'rest' must be from 0 to %d" % _BASELINE_MAX)
    forces = seen["f"]
    _check_cross(forces, strains)
    check_table("f", forces)
    if not 0 <= forces[0][1] < forces[-1][1] <= FORCE_MAX_MN:
        raise CalibrationError(
            "the forces of 'f' must be from 0 to 65535 mN, the last above the first"
        )
    made.compensation = None
    if "silicone" in seen:
        from .silicone import Compensation  # not every strip needs it

        try:
            made.compensation = Compensation(seen["silicone"])
        except ValueError as error:
            raise CalibrationError(error)
    _check_strains(strains, seen["segment"])
    bounds, knots = _between(strains, strain_ppm)
    for table in knots:
        check_table("x", table)
    made.tables = pack(seen["coarse"] + seen["fit"], bounds, seen["segment"], knots, forces, room)
    made.thermal = None
    if "temperature" in seen:
        from . import warming

        try:
            made.thermal = warming.thermal_of(
                made.tables, seen["temperature"], seen["warm"], check_table
            )
        except ValueError as error:
            raise CalibrationError(error)
        finally:
            drop(warming)
    tables = memoryview(made.tables)
    columns = columns_of(tables, tables[FORCES], 3)
    made.brightnesses, made.forces_mN, made.tolerances = columns
    coarse = sum(map(abs, seen["coarse"])) >> 1
    made.drift_max = (bounds[-1] - bounds[0]) // max(1, coarse)
    made.length_um = max(max(knot[1] for knot in table) for table in knots)
    # For each um, the contrast falls by the decay times half the sum of the absolute weights.
    middle = len(bounds) >> 1
    weights = seen["segment"][middle][:CHANNELS]
    first, last = knots[middle][0], knots[middle][-1]
    fall = (last[0] - first[0] << 7) // (sum(map(abs, weights)) or 1) << 11
    made.decay = min(abs(fall // (last[1] - first[1])), 1000)
    return (seen["board"], seen["plan"]) + seen["made"]


def _room(lines):
    # Return an array for `pack`. Made from a range, it needs one allocation; `pack` overwrites it.
    counts = {"segment": 0, "f": 0, "x": 0, "strain": 0}
    for line in lines:
        name = line.split(" ")[0]
        if name in counts:
            counts[name] += line.count(" ") if name in _CROSS else 1
    size = BOUNDS + 15 * counts["segment"] + 1 + counts["f"]
    return array("i", range(size + counts["x"] // max(1, counts["strain"])))


def pack(weights, bounds, segments, tables, forces, room=()):
    """Return weights and tables of a calibration as one array, see `decode.SEGMENTS`.

    The weights are six for the contrast that selects a segment, and six for the misfit; then twelve
    for each segment, which begins at the contrast in `bounds`. A knot of a segment's table has four
    values, or six with the cross-sensitivity; a knot of the forces three, or four. The array `room`
    is filled and returned if it is long enough; else a new one is allocated.
    """
    ends = BOUNDS + 2 * len(bounds)
    cross = len(forces[0]) - _MANY["f"]
    knots = (4 + cross * _CROSS["x"]) * sum(map(len, tables))
    size = ends + 2 * CHANNELS * len(bounds) + knots + len(tables)
    needed = size + 1 + len(forces[0]) * len(forces)
    packed = room if len(room) >= needed else array("i", range(needed))
    packed[SEGMENTS] = len(bounds)
    packed[FORCES] = size
    packed[CROSS] = cross and (max([knot[1] for table in tables for knot in table]) or 1)
    for i in range(2 * CHANNELS):
        packed[WEIGHTS + i] = weights[i]
    place = ends
    for i in range(len(bounds)):
        packed[BOUNDS + 2 * i] = bounds[i]
        packed[BOUNDS + 2 * i + 1] = place
        for weight in segments[i]:
            packed[place] = weight
            place += 1
        place = _put(packed, place, tables[i])
    _put(packed, place, forces)
    return packed


def _put(packed, place, knots):
    packed[place] = len(knots)
    place += 1
    for column in range(len(knots[0])):
        for knot in knots:
            packed[place] = knot[column]
            place += 1
    return place


def _take(line, words, seen, strains):
    name = words[0]
    if name in _MANY:
        values = _integers(line, _MANY[name], _CROSS.get(name, 0))
        if name == "segment":
            _weights("segment", values[:CHANNELS], 0)
            _weights("segment", values[CHANNELS:], ONE_Q13)
        seen[name].append(values)
    elif name == "strain":
        strains.append((_integers(line, 1)[0], [], []))
    elif name in ("from", "x"):
        if not strains:
            raise CalibrationError("'%s' must follow a line 'strain'" % name)
        _, bounds, tables = strains[-1]
        if name == "from":
            bounds.append(_integers(line, 1)[0])
            tables.append([])
        elif not tables:
            raise CalibrationError("'x' must follow a line 'from'")
        else:
            tables[-1].append(_integers(line, 4, _CROSS[name]))
    elif name in seen:
        raise CalibrationError("the line '%s' appears twice" % name)
    elif len(words) == 2 and (name == "board" or (name == "presser" and words[1] in _PRESSERS)):
        seen[name] = words[1]
    elif name == "plan":
        seen[name] = tuple(words[1:])
        if len(seen[name]) != CHANNELS or len(set(seen[name]) & set(PIXELS)) != CHANNELS:
            raise CalibrationError("'plan' needs six different diodes")
    elif name in _ONCE:
        seen[name] = _integers(line, _ONCE[name])
    elif line == "relative":
        seen[line] = None
    elif name in _FOR_HOST:
        _integers(line, _FOR_HOST[name])
    else:
        raise CalibrationError("'%s' is not a line of a calibration: remove it" % line[:40])


def _integers(line, count, more=0):
    # The line has `count` or `count + more` integers.
    try:
        values = tuple(map(int, line.split()[1:]))
    except ValueError:
        values = ()
    if len(values) not in (count, count + more) or max(map(abs, values)) > _LOG_MAX:
        needed = "%d or %d" % (count, count + more) if more else count
        raise CalibrationError("'%s' needs %s integers up to 2**28" % (line[:40], needed))
    return values


def _weights(name, weights, total):
    if sum(weights) != total:
        raise CalibrationError("the weights of '%s' must add up to %d" % (name, total))
    if sum(map(abs, weights)) > WEIGHT_SUM_MAX:
        raise CalibrationError("the weights of '%s' are too large: calibrate again" % name)
    return weights


def check_table(name, knots):
    """Raise CalibrationError, with the lines' name, if the knots of a table are invalid.

    A knot is a sequence of int: its argument, then its values.
    """
    if not 2 <= len(knots) <= KNOTS_MAX:
        raise CalibrationError("'%s' needs 2 to %d knots" % (name, KNOTS_MAX))
    rises = knots[1][1] > knots[0][1]
    for a, b in zip(knots, knots[1:]):
        step = b[0] - a[0]
        if step <= 0:
            raise CalibrationError("the knots of '%s' must ascend" % name)
        if a[1] == b[1] or (b[1] > a[1]) != rises:
            raise CalibrationError("the table of '%s' is not monotone" % name)
        if any(step * (abs(b[i] - a[i]) + 1) >= 1 << 30 for i in range(1, len(a))):
            raise CalibrationError("the knots of '%s' lie too far apart: add knots" % name)


def _check_cross(forces, strains):
    # Without a list of all knots, for which a board has no memory beside six strains.
    more = len(forces[0]) - _MANY["f"] if forces else 0
    for force in forces:
        _check_values(force, _MANY["f"], more, _SHARE_MAX)
    for _, _, tables in strains:
        for table in tables:
            for knot in table:
                _check_values(knot, 4, more * _CROSS["x"], _SIZE_MAX)


def _check_values(values, first, more, limit):
    if len(values) != first + more:
        raise CalibrationError("all lines 'f' and 'x' need the cross-sensitivity, or none")
    for i in range(first, first + more):
        if abs(values[i]) > limit:
            raise CalibrationError("a value of the cross-sensitivity is above %d" % limit)


def _check_strains(strains, segments):
    ppm = [strain for strain, _, _ in strains]
    if not ppm or ppm[0] != 0 or sorted(set(ppm)) != ppm:
        raise CalibrationError("the values of 'strain' must ascend from 0")
    if ppm[-1] > STRAIN_MAX_PPM:
        raise CalibrationError("'strain' must be at most %d" % STRAIN_MAX_PPM)
    _, _, first = strains[0]
    sizes = list(map(len, first))
    for _, bounds, tables in strains:
        if len(tables) != len(segments) or not segments:
            raise CalibrationError("each 'strain' needs one 'from' for each 'segment'")
        if list(map(len, tables)) != sizes:
            raise CalibrationError("each 'strain' needs the same number of knots")
        if sorted(set(bounds)) != bounds:
            raise CalibrationError("the values of 'from' must ascend")
        for table in tables:
            check_table("x", table)


def _between(strains, strain_ppm):
    """Interpolate bounds of segments and tables of knots linearly between two calibrated strains.

    Each of `strains` is a tuple: strain in ppm, bounds, tables.
    """
    last = len(strains) - 1
    if not 0 <= strain_ppm <= strains[last][0]:
        raise CalibrationError("the calibration needs strain_ppm from 0 to %d" % strains[last][0])
    i = 0
    while i < last and strains[i + 1][0] <= strain_ppm:
        i += 1
    low, bounds_a, tables_a = strains[i]
    if low == strain_ppm:
        return bounds_a, tables_a
    high, bounds_b, tables_b = strains[i + 1]
    share = ((strain_ppm - low) << _STRAIN_Q) // (high - low)

    def mix(a, b):
        return a + (((b - a) * share) >> _STRAIN_Q)

    bounds = list(map(mix, bounds_a, bounds_b))
    tables = [
        [tuple(map(mix, p, q)) for p, q in zip(table_a, table_b)]
        for table_a, table_b in zip(tables_a, tables_b)
    ]
    return bounds, tables
