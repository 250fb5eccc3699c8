"""Readings to the state of a gamepad. No I/O; all times are arguments.

An axis follows the finger, and springs back when it lifts. While readings are untrusted or missing,
the last good state is held for a set time; then everything goes to rest.
"""

from __future__ import annotations

import math
from collections import deque

from spots_device import decode

from ..link.frames import Touch
from ..outputs.devices import AXIS_MAX, REST, State
from .controller_settings import ControllerSettings, ForceAxis, PositionAxis, Pressed, Tapped
from .one_euro import OneEuro
from .shaping import deflection, shaped

# Neither a touch nor the end of one.
_BLIND = decode.SATURATED | decode.MISFIT | decode.LED_OFF | decode.NOT_CALIBRATED
_TURN_US = 1 << 32  # the board's clock wraps
_FORGET_S = 1.0  # readings further apart than this are not of one movement
_WAITING_MAX = 16


class Controller:
    """Takes readings, gives states to send.

    Parameters
    ----------
    settings : controller_settings.ControllerSettings
    length_um : float
        Of the strip.

    Attributes
    ----------
    length_um : float
    state : State
        The state after the last reading, sent or not.
    held : bool
        Whether `state` is held because readings are untrusted or missing.
    """

    def __init__(self, settings: ControllerSettings, length_um: float):
        self.length_um = length_um
        self._hold_s = settings.hold_ms / 1000
        self._release_s = settings.release_ms / 1000
        self._sender = _Sender(settings.rate_hz)
        axes = {"x": settings.x, "y": settings.y, "z": settings.z}
        self._axes = {name: _Axis(one, length_um) for name, one in axes.items() if one is not None}
        made = [_BUTTONS[type(one)](one, length_um / 100) for one in settings.button]
        self._pressed = [one for one in made if isinstance(one, _PressedButton)]
        self._tapped = [one for one in made if isinstance(one, _TappedButton)]
        self.state = REST
        self.held = False
        self._touched = False
        self._whole = False  # this touch was seen from its beginning: it pushes buttons
        self._lifted = False  # a finger was seen to be away since the last good reading
        self._began_us = self._last_us = 0
        self._began_um = 0
        self._until_s = -math.inf

    def take(self, touch: Touch, now_s: float) -> State | None:
        """Take a reading.

        Parameters
        ----------
        touch : Touch
            Its own time `t_us` is the board's, and only used for the time between readings.
        now_s : float
            When it came, by the clock of `tick`.

        Returns
        -------
        State or None
            The state to send now, if any.
        """
        self._expire(now_s)
        if touch.trusted:
            self._feel(touch, now_s)
        elif touch.touching or touch.flags & _BLIND:
            self.held = self._touched
        elif self._touched:
            self._lifted = True
            since_s = (touch.t_us - self._last_us) % _TURN_US * 1e-6
            if touch.flags & decode.TOO_DARK and since_s < self._release_s:
                self.held = True  # so looks a lift, and so does a failed reading
            else:
                self._until_s = now_s
        else:
            self._lifted = True
        return self.tick(now_s)

    def tick(self, now_s: float) -> State | None:
        """Let time pass, also when no reading comes; return as `take`."""
        self._expire(now_s)
        for button in self._tapped:
            button.pass_time(now_s)
        self._show()
        return self._sender.due(now_s)

    def release(self) -> None:
        """Go to rest and drop all that is pending.

        A finger that is still there moves the axes, and pushes no button until it was lifted.
        """
        self._touched = self._lifted = self.held = False
        for axis in self._axes.values():
            axis.end()
        for button in (*self._pressed, *self._tapped):
            button.down = False
        self.state = REST
        self._sender.clear()

    def _expire(self, now_s: float) -> None:
        if self._touched and now_s >= self._until_s:
            self._end(now_s)

    def _feel(self, touch: Touch, now_s: float) -> None:
        if not self._touched:
            self._touched = True
            self._whole = self._lifted
            self._began_us, self._began_um = touch.t_us, touch.position_um
            for axis in self._axes.values():
                axis.begin()
            for button in self._pressed:
                button.begin(self._whole and button.has(touch.position_um))
            dt_s = 0.0
        else:
            dt_s = (touch.t_us - self._last_us) % _TURN_US * 1e-6
        self._last_us = touch.t_us
        self._until_s = now_s + self._hold_s
        self._lifted = self.held = False
        for axis in self._axes.values():
            axis.take(touch, dt_s)
        for button in self._pressed:
            button.take(touch.force_mN)

    def _end(self, now_s: float) -> None:
        self._touched = self.held = False
        for axis in self._axes.values():
            axis.end()
        for button in self._pressed:
            button.down = False
        in_time = now_s - self._until_s < _FORGET_S  # a tap is stale if the process was frozen
        if self._whole and self._lifted and in_time:
            lasted_ms = (self._last_us - self._began_us) % _TURN_US / 1000
            for button in self._tapped:
                if button.has(self._began_um) and lasted_ms <= button.longest_ms:
                    button.push(now_s)

    def _show(self) -> None:
        buttons = 0
        for button in (*self._pressed, *self._tapped):
            buttons |= button.bit if button.down else 0
        values = {name: axis.value for name, axis in self._axes.items()}
        self.state = REST._replace(buttons=buttons, **values)
        self._sender.put(self.state)


class _Axis:
    def __init__(self, settings: PositionAxis | ForceAxis, length_um: float):
        self._settings = settings
        self._field, *self._range = span(settings, length_um)
        smooth = settings.smooth
        self._filter = OneEuro(smooth.min_cutoff_hz, smooth.beta, smooth.derivative_cutoff_hz)
        self.value = 0

    def begin(self) -> None:
        self._filter.reset()

    def take(self, touch: Touch, dt_s: float) -> None:
        if dt_s > _FORGET_S:
            self._filter.reset()
        u = deflection(getattr(touch, self._field), *self._range)
        self.value = axis_value(self._filter.take(u, dt_s), self._settings)

    def end(self) -> None:
        self.value = 0


def axis_value(u: float, settings: PositionAxis | ForceAxis) -> int:
    """Return the value of an axis at a deflection.

    Parameters
    ----------
    u : float
        Deflection, from -1 to 1.
    settings : PositionAxis or ForceAxis
        With deadband, expo and inversion.

    Returns
    -------
    int
        From ``-AXIS_MAX`` to ``AXIS_MAX``.
    """
    return round(AXIS_MAX * shaped(u, settings.deadband, settings.expo, settings.invert))


def span(settings: PositionAxis | ForceAxis, length_um: float) -> tuple[str, float, float, float]:
    """Return which field of a reading an axis follows, and the field at rest, low and high.

    Parameters
    ----------
    settings : PositionAxis or ForceAxis
        Position is in per cent of the strip there, force in mN.
    length_um : float
        Length of the strip, in um.

    Returns
    -------
    field : str
        ``position_um`` or ``force_mN``.
    rest, low, high : float
        In the unit of the field: um or mN. For force, `low` is minus infinity.
    """
    if isinstance(settings, ForceAxis):
        return "force_mN", settings.rest_mN, -math.inf, settings.max_mN
    percent = (settings.rest_percent, settings.min_percent, settings.max_percent)
    return "position_um", *(length_um / 100 * one for one in percent)


class _Button:
    def __init__(self, settings: Pressed | Tapped, percent_um: float):
        self.bit = 1 << settings.number - 1
        self.down = False
        self._from_um = settings.from_percent * percent_um
        self._to_um = settings.to_percent * percent_um

    def has(self, position_um: float) -> bool:
        """Whether a place is in its zone."""
        return self._from_um <= position_um <= self._to_um


class _PressedButton(_Button):
    def __init__(self, settings: Pressed, percent_um: float):
        super().__init__(settings, percent_um)
        self._press_mN, self._release_mN = settings.press_mN, settings.release_mN
        self._mine = False

    def begin(self, mine: bool) -> None:
        self._mine = mine

    def take(self, force_mN: float) -> None:
        least_mN = self._release_mN if self.down else self._press_mN
        self.down = self._mine and force_mN >= least_mN


class _TappedButton(_Button):
    def __init__(self, settings: Tapped, percent_um: float):
        super().__init__(settings, percent_um)
        self.longest_ms = settings.longest_ms
        self._pulse_s = settings.pulse_ms / 1000
        self._up_s = math.inf

    def push(self, now_s: float) -> None:
        self.down, self._up_s = True, now_s + self._pulse_s

    def pass_time(self, now_s: float) -> None:
        if self.down and now_s >= self._up_s:
            self.down = False


_BUTTONS = {Pressed: _PressedButton, Tapped: _TappedButton}


class _Sender:
    """States on change, at a capped rate: each change of a button, of axes the latest value."""

    def __init__(self, rate_hz: float):
        self._every_s = 1 / rate_hz
        self._next_s = -math.inf
        self._sent = REST
        self._waiting: deque[State] = deque()

    def put(self, state: State) -> None:
        waiting = self._waiting
        # With no room, buttons may lose a push, but never the last word.
        if waiting and (state.buttons == waiting[-1].buttons or len(waiting) == _WAITING_MAX):
            waiting[-1] = state
        else:
            waiting.append(state)

    def clear(self) -> None:
        self._waiting.clear()
        self._sent = REST

    def due(self, now_s: float) -> State | None:
        if not self._waiting or now_s < self._next_s:
            return None
        state = self._waiting.popleft()
        if state == self._sent:
            return None
        self._sent, self._next_s = state, now_s + self._every_s
        return state
