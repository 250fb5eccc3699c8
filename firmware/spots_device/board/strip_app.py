"""A strip of a board: its sensor, settings, calibration, layout and keys.

Each strip has its own of these, and its own files. Those of strip 0 have the same names as on a
board with one strip.
"""

import gc

from .. import const
from ..reading.calibration import CalibrationSlot
from ..reading.strip import Strip
from ..sensor.exposure import DONE, TOO_DARK
from .command import Replies, Upload
from .outputs import Outputs, check_layout
from .reconnect import Reconnect
from .settings import BoardSettings, checksum

_BOOT_MAX = const(224)  # characters of all faults at the start, so that the reply fits a frame


class StripApp:
    """Creates all objects of one strip, and changes them together; `app.Board` runs the loop.

    Parameters
    ----------
    board : app.Board
        The board.
    index : int
        Number of the sensor, from 0.
    config : object
        Configuration of the strip, see `settings.BoardSettings`.
    sensor : as7341.AS7341
        Sensor, not started yet.
    """

    def __init__(self, board, index, config, sensor):
        self.board = board
        self.index = index
        # A calibration belongs to its strip, so each strip has an id.
        self._uid = "%s-%d" % (board.uid, index) if index else board.uid
        self.sensor = sensor
        self.pacing = sensor.pacing
        self.poll = sensor.poll
        self.settings = BoardSettings(config)
        self.replies = Replies(board.framer, board.time, index if board.sensors > 1 else None)
        self.calibration = CalibrationSlot()
        self.unused = []  # sentences about stored parts that are invalid
        layout_lines = self._load()
        self.outputs = Outputs(
            index, self.settings, board.framer, board.time, board.interfaces, layout_lines
        )
        self.strip = Strip(
            index,
            self._uid,
            sensor,
            board.framer,
            board.time,
            board.clock,
            self.settings,
            self.outputs,
        )
        self.take = self.strip.take
        self.reconnect = Reconnect(
            self.strip, board.clock, self.replies, self.use_stored, self._sensor_lost
        )
        self.uploads = {
            "cal": Upload(
                "cal", "calibration", self.use_calibration, lambda: self.calibration.lines
            ),
            "layout": Upload(
                "layout", "layout", self.use_layout, lambda: self.outputs.layout_lines
            ),
        }
        self._sum()

    def restart(self):
        """Restart the sensor with the present settings."""
        self.abandon("the sensor was restarted")
        self.reconnect.restart()

    def abandon(self, why):
        """Cancel a requested dark frame or search for settings; its error reply contains `why`."""
        self.strip.forget_requests()
        self.replies.abandon(why)

    def dark_done(self):
        """Reply to the command ``dark``, after its dark frame was taken."""
        if self.settings.values["led"] == "always":
            self.apply_calibration()  # without a dark frame, the calibration was not used
        self.replies.finish("dark", {"dark": self.strip.dark_frame()})

    def search_done(self, outcome):
        """Reply to the command ``autoexpose``; `outcome` is that of `search.Search.step`."""
        notes = self.apply_calibration()
        error = "too bright at the least gain and LED current; shade the sensor"
        reply = {"error": error, "why": "too_bright"}
        if outcome == DONE:
            reply = self.settings.reply()
            reply.update(notes)
        elif outcome == TOO_DARK:
            reply["error"] = "too dark at full gain and LED current; press harder, check the LED"
            reply["why"] = "too_dark"
        self.replies.finish("autoexpose", reply)

    def use_calibration(self, lines):
        """Store a new calibration and use it.

        Parameters
        ----------
        lines : list of str
            Lines of a calibration; an empty list removes the calibration.

        Returns
        -------
        dict
            As from `apply_calibration`.

        Raises
        ------
        ValueError
            If the lines are invalid. Nothing is changed then.
        """
        self.calibration.use(lines)
        self._sum()
        return self.apply_calibration()

    def use_layout(self, lines):
        """Store a new layout of keys and use it, as `use_calibration` does with a calibration.

        An empty list restores the default layout.
        """
        if lines:
            check_layout(lines)
        self.outputs.use_layout(lines)
        self._sum()
        return self.apply_calibration()

    def _sum(self):
        # A checksum takes 0.2 ms for each line on a Pico, so the reply to ``hello`` does not
        # compute it.
        self._sums = checksum(self.calibration.lines), checksum(self.outputs.layout_lines)

    def apply_calibration(self):
        """Use the calibration if it is valid at the present settings; update keys and gamepad.

        Returns
        -------
        dict
            What to add to the reply: ``note``, why the calibration is not used, or why keys or
            gamepad do not work although they are switched on; and ``why``, if ``save`` and
            ``reboot`` are all that it takes. Empty if everything works.
        """
        self.board.time.update()
        self.outputs.release()  # before `use_stored`, because its calls nest deeply
        why_not = self.use_stored()
        note, reboots = self.outputs.note(self.strip.decode.calibration)
        gc.collect()  # frees the garbage of parsing
        note = "; ".join(filter(None, (why_not, note)))
        found = {"note": note} if note else {}
        if reboots:
            found["why"] = "needs_reboot"
        return found

    def use_stored(self):
        """Use the stored calibration if it is valid for the settings.

        Returns
        -------
        str or None
            Why the stored calibration is not used; None if it is used, or if there is none. The
            missing dark frame of an LED that is always on is reported even without a calibration.
        """
        if self.reconnect.lost:
            found = why_not = None
            if self.calibration.lines:
                why_not = "the calibration is not in use until the sensor answers"
                if self.reconnect.fault:
                    why_not += ": " + self.reconnect.fault
        else:
            found, why_not = self.calibration.choose(
                self.strip.conditions, self.settings.values["strain_ppm"]
            )
            if not self.strip.lit_flags:
                from .light import NO_DARK

                found, why_not = None, NO_DARK
        self.strip.use_calibration(found)
        self.board.time.update()
        self.outputs.apply(found)
        self.strip.configure()
        self.board.show_state()
        return why_not

    def _sensor_lost(self):
        self.board.searches = True
        self.release_keys()
        self.abandon("the sensor was lost")

    def identity(self):
        """Return name, id, settings and checksums of board and strip: the reply to ``hello``."""
        reply = self.settings.reply()
        reply["board"] = self.board.name
        reply["runtime"] = self.board.runtime
        reply["id"] = self._uid
        reply["sensors"] = self.board.sensors
        calibration = self.strip.decode.calibration
        reply["calibration"] = calibration and self._sums[0]
        reply["length_um"] = calibration and calibration.length_um
        reply["decay"] = calibration and calibration.decay
        reply["cross"] = calibration and calibration.cross
        reply["relative_force"] = calibration and calibration.relative_force
        reply["presser"] = calibration and calibration.presser
        reply["layout"] = self._sums[1] if self.outputs.layout_lines else None
        reply["boot"] = self.boot_faults()
        return reply

    def boot_faults(self):
        """Return what went wrong at the start: sentences of 224 ASCII characters in total (list).

        Nobody reads the log at the start, so the reply to ``hello`` contains these sentences. A
        save makes those about stored files obsolete.
        """
        left = _BOOT_MAX
        faults = []
        found = [self.board.store.fault] + self.unused
        found += [self.board.interfaces.fault, self.outputs.memory_fault]
        if self.board.radio is not None:
            found.append(self.board.radio.fault)
        for fault in found:
            if fault and left:
                # In JSON, other characters need more than one byte.
                fault = "".join([c if " " <= c <= "~" and c not in '"\\' else "?" for c in fault])
                faults.append(fault[:left])
                left -= len(faults[-1])
        return faults

    def state(self):
        """Return settings, counters and faults: the reply to ``get`` (dict)."""
        reply = self.settings.reply()
        self.strip.report(reply)
        self.reconnect.report(reply)
        reply["dropped"] = self.board.framer.dropped
        reply["dropped_reports"] = self.board.interfaces.dropped()
        reply["saturation"] = None if self.reconnect.lost else self.strip.saturation()
        return reply

    def release_keys(self):
        """Release all keys of the strip; called before a pause of the readings."""
        self.board.time.update()
        self.outputs.release()

    def stored(self):
        """Return name and lines of each part that ``save`` stores: a list of tuples."""
        return [
            (self._name("settings"), self.settings.lines()),
            (self._name("calibration"), self.calibration.lines),
            (self._name("layout"), self.outputs.layout_lines),
        ]

    def _load(self):
        """Load saved settings, calibration and layout; return the lines of the layout."""
        self._load_lines("settings", self.settings.change)
        self._load_lines("calibration", self.calibration.use)
        return self._load_lines("layout", check_layout)

    def _load_lines(self, part, check):
        try:
            lines = self.board.store.load(self._name(part))
            if lines:
                check(lines)
                gc.collect()  # the parser and its garbage, before modules that stay are loaded
            return lines
        except ValueError as error:
            self.unused.append("stored %s not used: %s" % (part, error))
            return []

    def _name(self, part):
        return part + (str(self.index) if self.index else "")
