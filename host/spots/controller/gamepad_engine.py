"""Computes the state of a gamepad from readings. No I/O; the caller passes all times.

An axis follows the finger, and returns to 0 when the finger lifts. If the first finger touches in
the zone of an `Anchored` button, this finger is the anchor, and position axes follow a second
finger. While readings are untrusted or missing, the last valid state is kept for `hold_ms`; then
all axes are 0 and all buttons are released.
"""

import math
from collections import deque
from collections.abc import Sequence

from spots_device.reading import decode

from ..advice.contact_finder import ContactFinder
from ..link.frames import DOUBTFUL, Contact, Touch
from ..outputs.devices import AXIS_MAX, REST, State
from .controller_settings import (
    Anchored,
    ControllerSettings,
    ForceAxis,
    PositionAxis,
    Pressed,
    Tapped,
)
from .one_euro import OneEuro
from .shaping import deflection, shaped

# A reading with one of these flags shows neither a touch nor the end of a touch.
_BLIND = decode.SATURATED | decode.MISFIT | decode.LED_OFF | decode.NOT_CALIBRATED
_TURN_US = 1 << 32  # after this time, the board's clock begins again at 0
_FORGET_S = 1.0  # after a longer pause a movement or a tap is stale
_WAITING_MAX = 16  # largest number of states that wait to be sent
_SIGMA_UM = 3_000  # a second finger with a larger uncertainty moves no axis


class Controller:
    """Computes the states of a gamepad from the readings of a strip.

    Parameters
    ----------
    settings : controller_settings.ControllerSettings
        Axes, buttons and timeouts.
    length_um : float
        Length of the strip, in um.
    decay : int, optional
        Decay of the light by the dye in log2 units per um, times 2**24, from the board's reply to
        the command ``hello``; used to find a second finger. A typical value if not given.
    cross : sequence of int, optional
        Cross-sensitivity of the strip, from this reply.

    Attributes
    ----------
    length_um : float
        Length of the strip, in um.
    state : State
        State after the last reading or `tick`, even if this state has not been sent.
    held : bool
        Whether the last valid `state` is kept because readings are untrusted or missing.
    """

    # A controller detects no objects that are not fingers, see `advice.calibrated.run_engine`.
    objects = 0

    def __init__(
        self,
        settings: ControllerSettings,
        length_um: float,
        decay: int | None = None,
        cross: Sequence[int] | None = None,
    ):
        self.length_um = length_um
        self._hold_s = settings.hold_ms / 1000
        self._release_s = settings.release_ms / 1000
        self._sender = _Sender(settings.rate_hz)
        axes = {"x": settings.x, "y": settings.y, "z": settings.z}
        self._axes = {name: _Axis(one, length_um) for name, one in axes.items() if one is not None}
        self._buttons = [_BUTTONS[type(one)](one, length_um / 100) for one in settings.button]
        anchored = any(isinstance(one, Anchored) for one in settings.button)
        self._finder = ContactFinder(round(length_um), decay, cross) if anchored else None
        self._began_us = self._last_us = self._located_us = 0
        self._until_s = -math.inf
        self._reset()

    def take(self, touch: Touch, now_s: float) -> State | None:
        """Update the state with a reading.

        Parameters
        ----------
        touch : Touch
            The next reading. Its `t_us` is used only to compute times between readings.
        now_s : float
            Time at which the reading arrived, in seconds, by the same clock as in `tick`.

        Returns
        -------
        State or None
            State to send now; None if there is nothing to send.
        """
        self._expire(now_s)
        contacts = self._finder.take(touch) if self._finder else []
        if self._anchored and not self._stays(contacts):
            self._end(now_s)
        if usable(touch) or (self._anchored and self._anchor_id is not None and touch.touching):
            self._feel(touch, contacts, now_s)
        elif touch.touching or touch.flags & _BLIND:
            self.held = self._touched
        else:
            self._lifted = True
            if self._touched:
                since_s = (touch.t_us - self._last_us) % _TURN_US * 1e-6
                if touch.flags & decode.TOO_DARK and since_s < self._release_s:
                    self.held = True  # a lift and a failed reading look the same at first
                else:
                    self._until_s = now_s
        return self.tick(now_s)

    def tick(self, now_s: float) -> State | None:
        """Update the timeouts, and return the state to send now, as `take` does.

        Call `tick` regularly, even if no readings arrive.
        """
        self._expire(now_s)
        buttons = 0
        for button in self._buttons:
            button.tick(now_s)
            buttons |= button.bit if button.down else 0
        values = {name: axis.value for name, axis in self._axes.items()}
        self.state = REST._replace(buttons=buttons, **values)
        self._sender.put(self.state)
        return self._sender.due(now_s)

    def release(self) -> None:
        """Set all axes to 0, release all buttons, and drop all states that were not sent yet.

        A finger that is still on the strip moves the axes, but presses no button until it is
        lifted.
        """
        if self._finder:
            self._finder.release()
        self._reset()

    def _reset(self) -> None:
        self._touched = self.held = False
        self._lifted = False  # whether a reading without a touch followed the last valid touch
        self._anchored = False  # whether the touch began in the zone of an `Anchored` button
        self._anchor_id: int | None = None
        for axis in self._axes.values():
            axis.end()
        for button in self._buttons:
            button.down = False
        self.state = REST
        self._sender.clear()

    def _expire(self, now_s: float) -> None:
        if self._touched and now_s >= self._until_s:
            self._end(now_s)

    def _stays(self, contacts: list[Contact]) -> bool:
        """Return whether the anchor still rests; `contacts` are the fingers in the latest reading.

        The anchor is the first finger, if it touched in the zone of an `Anchored` button.
        """
        if self._anchor_id is None:
            self._anchor_id = next((one.id for one in contacts if not one.ended), None)
            return True
        return any(one.id == self._anchor_id and not one.ended for one in contacts)

    def _feel(self, touch: Touch, contacts: list[Contact], now_s: float) -> None:
        if not self._touched:
            self._touched = True
            self._began_us = self._last_us = self._located_us = touch.t_us
            # Only a touch that follows a reading without a touch can press a button.
            hit = [one for one in self._buttons if self._lifted and one.has(touch.position_um)]
            anchors = [one for one in hit if isinstance(one, _AnchoredButton)]
            self._anchored = bool(anchors)
            for button in self._buttons:
                button.mine = button in (anchors or hit)
        dt_s = (touch.t_us - self._last_us) % _TURN_US * 1e-6
        self._last_us = touch.t_us
        self._until_s = now_s + self._hold_s
        self._lifted = self.held = False
        if self._anchored:
            self._follow(touch, contacts, dt_s)
        else:
            for axis in self._axes.values():
                axis.take(touch, dt_s)
        for button in self._buttons:
            button.take(touch.force_mN)

    def _follow(self, touch: Touch, contacts: list[Contact], dt_s: float) -> None:
        second = next((one for one in contacts if one.id != self._anchor_id), None)
        if second and not second.ended and second.sigma_um <= _SIGMA_UM:
            self._located_us = touch.t_us
            for axis in self._axes.values():
                if axis.field == "position_um":  # the force of one of two fingers is unknown
                    axis.take(second, dt_s)
            return
        lost_s = (touch.t_us - self._located_us) % _TURN_US * 1e-6
        if second is None or second.ended or lost_s > self._hold_s:
            for axis in self._axes.values():
                axis.end()

    def _end(self, now_s: float) -> None:
        self._touched = self._anchored = self.held = False
        self._anchor_id = None
        for axis in self._axes.values():
            axis.end()
        # A tap needs a measured and recent lift: the process may have been stopped since the touch.
        tapped = self._lifted and now_s - self._until_s < _FORGET_S
        lasted_ms = (self._last_us - self._began_us) % _TURN_US / 1000 if tapped else math.inf
        for button in self._buttons:
            button.end(lasted_ms, now_s)


class _Axis:
    def __init__(self, settings: PositionAxis | ForceAxis, length_um: float):
        self._settings = settings
        self.field, *self._range = span(settings, length_um)
        smooth = settings.smooth
        self._filter = OneEuro(smooth.min_cutoff_hz, smooth.beta, smooth.derivative_cutoff_hz)
        self.value = 0

    def take(self, finger: Touch | Contact, dt_s: float) -> None:
        """Move the axis to a finger; `dt_s` is the time since the previous usable reading."""
        if dt_s > _FORGET_S:
            self._filter.reset()
        u = deflection(getattr(finger, self.field), *self._range)
        self.value = axis_value(self._filter.take(u, dt_s), self._settings)

    def end(self) -> None:
        self._filter.reset()
        self.value = 0


def usable(touch: Touch) -> bool:
    """Return whether a reading is accurate enough for a controller.

    Such a reading is trusted, or has both flags of `decode.FITS_WITH_DRIFT`: the spectrum fits one
    press well enough, although the strip has drifted or two fingers may touch. See
    docs/calibrate/drift.md.
    """
    return touch.touching and touch.flags & DOUBTFUL in (0, decode.FITS_WITH_DRIFT)


def axis_value(u: float, settings: PositionAxis | ForceAxis) -> int:
    """Return the value of an axis, up to ``AXIS_MAX``, for a deflection from -1 to 1."""
    return round(AXIS_MAX * shaped(u, settings.deadband, settings.expo, settings.invert))


def span(settings: PositionAxis | ForceAxis, length_um: float) -> tuple[str, float, float, float]:
    """Return the field of `Touch` that an axis follows, and its values at rest and at both ends.

    They are in um or mN. For a force, the low end is minus infinity.
    """
    if isinstance(settings, ForceAxis):
        return "force_mN", settings.rest_mN, -math.inf, settings.max_mN
    percent = (settings.rest_percent, settings.min_percent, settings.max_percent)
    return "position_um", *(length_um / 100 * one for one in percent)


class _Button:
    def __init__(self, settings: Pressed | Tapped, percent_um: float):
        self._settings = settings
        self.bit = 1 << settings.number - 1
        # Whether the touch may press this button: it began in the button's zone, after a reading
        # without a touch. A touch that began in the zone of an `Anchored` button presses no other
        # kind of button.
        self.mine = False
        self.down = False
        self._zone_um = settings.from_percent * percent_um, settings.to_percent * percent_um

    def has(self, position_um: float) -> bool:
        """Return whether a position in um is in the button's zone of the strip."""
        return self._zone_um[0] <= position_um <= self._zone_um[1]

    def take(self, force_mN: float) -> None:
        pass

    def tick(self, now_s: float) -> None:
        pass

    def end(self, lasted_ms: float, now_s: float) -> None:
        self.down = False


class _PressedButton(_Button):
    def take(self, force_mN: float) -> None:
        least_mN = self._settings.release_mN if self.down else self._settings.press_mN
        self.down = self.mine and force_mN >= least_mN


class _TappedButton(_Button):
    _up_s = math.inf

    def end(self, lasted_ms: float, now_s: float) -> None:
        if self.mine and lasted_ms <= self._settings.longest_ms:
            self.down, self._up_s = True, now_s + self._settings.pulse_ms / 1000

    def tick(self, now_s: float) -> None:
        if now_s >= self._up_s:
            self.down, self._up_s = False, math.inf


class _AnchoredButton(_Button):
    def take(self, force_mN: float) -> None:
        self.down = self.mine


_BUTTONS = {Pressed: _PressedButton, Tapped: _TappedButton, Anchored: _AnchoredButton}


class _Sender:
    """Limits the rate of states: skips changes of axes, and of buttons only in a full queue."""

    def __init__(self, rate_hz: float):
        self._every_s = 1 / rate_hz
        self._next_s = -math.inf
        self._sent = REST
        self._waiting: deque[State] = deque()

    def put(self, state: State) -> None:
        waiting = self._waiting
        # If the queue is full, a short press of a button may be lost, but never the newest state.
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
