"""Adds the processor time of a slow board to functions of the firmware, in simulated time.

Runs in the interpreter of the virtual board: MicroPython or CPython.
"""

import sys

_COLLECTIONS = "gc.collect"
_TAKEN, _USE = 27, 6  # reading.decode.TAKEN and USE


def _kind_of_contact(tracker, *_):
    return "two" if tracker.two else "one" if tracker.touched else "up"


def _kind_of_command(_, line):
    return (line.split() or [""])[0]


def _kind_of_sample(strip):
    # "sample" while a reading is incomplete; "used" if compensation, keys, contacts or gamepad take
    # readings; "rare" during rare operations, such as a dark window.
    if strip.decode.state[_TAKEN]:
        return "sample"
    if strip._rare:
        return "rare"
    return "reading" if strip._work[_USE] is None else "used"


# By name of a function whose time varies: a function that returns the kind of a call that has
# ended. The kind "" stands for all other kinds.
_KINDS = {
    "reading.strip.Strip.take": _kind_of_sample,
    "fingers.tracker.ContactTracker.take": _kind_of_contact,
    "board.command.Commands.handle": _kind_of_command,
}


class _Collector:
    """Replaces the module `gc` in a module of the firmware."""

    def __init__(self, collect):
        self.collect = collect


def slow_down(package, times_us, spend_us):
    """Make functions of the firmware take additional time at the end of each call.

    Parameters
    ----------
    package : str
        Name of the firmware's package.
    times_us : dict
        Additional time of a call in whole us, by the function's name in the package, such as
        ``board.app.Board.step``. For the functions in `_KINDS`: a dict of times by kind of the
        call.
        The name ``gc.collect`` stands for the garbage collections of all modules.
    spend_us : callable
        ``spend_us(us)`` advances the board's clock by this time.
    """
    for name in times_us:
        time_us = times_us[name]
        if name == _COLLECTIONS:
            continue
        room, module, *inner, function = name.split(".")
        try:
            holder = __import__(package + "." + room + "." + module, None, None, ("*",))
        except ImportError:  # a board with one strip has no module `aligned`
            continue
        for attribute in inner:
            holder = getattr(holder, attribute)
        called = getattr(holder, function)
        if name in _KINDS:
            called = _by_kind(called, time_us, _KINDS[name], spend_us)
        else:
            called = _always(called, time_us, spend_us)
        setattr(holder, function, called)
    # After all imports: MicroPython's dicts have no order.
    if _COLLECTIONS in times_us:
        _slow_collections(package, times_us[_COLLECTIONS], spend_us)


def _slow_collections(package, time_us, spend_us):
    for name in list(sys.modules):
        module = sys.modules[name]
        if name.startswith(package + ".") and hasattr(module, "gc"):
            module.gc = _Collector(_always(module.gc.collect, time_us, spend_us))


def _always(function, time_us, spend_us):
    def call(*arguments):
        result = function(*arguments)
        spend_us(time_us)
        return result

    return call


def _by_kind(function, times_us, kind, spend_us):
    def call(*arguments):
        result = function(*arguments)
        spend_us(times_us.get(kind(*arguments)) or times_us[""])
        return result

    return call
