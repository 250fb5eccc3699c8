"""Text commands, host to board: one ASCII line in, one JSON object out. See docs/protocol.md.

A bad line changes nothing and is answered with a sentence. Commands allocate; they are rare.
"""

from . import PROTOCOL, __version__
from .exposure import DONE, TOO_DARK
from .replies import NO_MEMORY
from .upload import Upload
from .uses import check_layout

LINE_MAX = 255
NAME_MAX = 20  # so much of an unknown name is repeated in the reply


class LineReader:
    """Assembles lines from single bytes in a buffer that never grows."""

    def __init__(self):
        self._line = bytearray(LINE_MAX)
        self._size = 0

    def feed(self, byte):
        """Take a byte; True once it ends a line. Allocates nothing."""
        if byte == 10 or byte == 13:
            return self._size > 0
        if self._size < LINE_MAX:
            self._line[self._size] = byte
        self._size = min(self._size + 1, LINE_MAX + 1)
        return False

    def line(self):
        """Return the line that just ended as str and begin the next one.

        Raises
        ------
        ValueError
            If it was too long or not printable ASCII.
        """
        size, self._size = self._size, 0
        if size > LINE_MAX:
            raise ValueError("a line holds at most %d characters" % LINE_MAX)
        line = bytes(memoryview(self._line)[:size])
        if any(not 32 <= byte < 127 for byte in line):
            raise ValueError("a line is printable ASCII")
        return line.decode()


class Commands:
    """What each command does to the application; `spots command --help` shows this list.

    commands of the board:
      hello               board, firmware, id, settings, calibration
      get                 settings, dark frame, faults and what was missed
      set NAME=VALUE ...  exposure_us, gain, led_mA, average, plan, strain_ppm,
                          baseline, dark_every, keys, gamepad, watchdog
      auto                search gain and LED current while you press firmly
      dark                take a dark frame
      rest                take the present light as the baseline
      stream KIND ...     what each sample sends: touch, spectrum, both, off
      keys on|off         touches press keys
      gamepad on|off      touches move a gamepad
      layout, cal         upload a layout or a calibration, line by line
      save                store settings, layout and calibration
      sync                the board's time, and what it streams
      reboot              restart the firmware

    Parameters
    ----------
    app : app.BoardApp
    """

    def __init__(self, app):
        self._app = app
        self._replies = app.replies
        self._cal = Upload("cal", "calibration", app.calibration.check, app.use_calibration)
        self._layout = Upload("layout", "layout", check_layout, app.use_layout)
        self._table = {
            "hello": self._hello,
            "get": self._get,
            "set": self._set,
            "stream": self._stream,
            "keys": self._keys,
            "gamepad": self._gamepad,
            "dark": self._dark,
            "rest": self._rest,
            "auto": self._auto,
            "cal": self._cal.take,
            "layout": self._layout.take,
            "save": self._save,
            "sync": self._sync,
            "reboot": self._reboot,
        }

    def handle(self, line):
        """Carry out a line.

        Returns
        -------
        dict or None
            The reply; None if it follows when the work is done.
        """
        words = line.split()
        if not words:
            return {"re": "", "error": "an empty line is no command"}
        name = words[0]
        if name not in self._table:
            known = ", ".join(sorted(self._table))
            return {"re": name[:NAME_MAX], "error": "no such command; there are " + known}
        try:
            reply = self._table[name](words[1:])
        except (ValueError, OSError) as error:
            reply = {"error": str(error)}
        except MemoryError:
            self._cal.forget()
            self._layout.forget()
            reply = {"error": NO_MEMORY}
        if reply is not None:
            reply["re"] = name
        return reply

    def _hello(self, words):
        reply = self._app.identity()
        reply["protocol"] = PROTOCOL
        reply["firmware"] = __version__
        return reply

    def _get(self, words):
        return self._app.state()

    def _set(self, words):
        if not words:
            raise ValueError("say what to set, as in: set exposure_us=10000 gain=9")
        app = self._app
        if app.settings.change(words):
            app.restart()
        reply = app.settings.reply()
        reply["rate_mHz"] = app.rate_mHz()
        note = app.apply_calibration()
        if note:
            reply["note"] = note
        return reply

    def _stream(self, words):
        kinds = set(words)
        if not kinds or kinds - {"touch", "spectrum", "off"} or len(kinds) > 2:
            raise ValueError("stream takes touch, spectrum, both, or off")
        if "off" in kinds and len(kinds) > 1:
            raise ValueError("stream takes off alone")
        self._app.strip.stream(kinds)
        self._app.measure()
        return {"stream": sorted(kinds)}

    def _keys(self, words):
        return self._switch("keys", words)

    def _gamepad(self, words):
        return self._switch("gamepad", words)

    def _switch(self, name, words):
        if words not in (["on"], ["off"]):
            raise ValueError("%s takes on or off" % name)
        app = self._app
        app.settings.change(["%s=%d" % (name, words == ["on"])])
        note = app.apply_calibration()
        reply = {name: words[0]}
        if note:
            reply["note"] = note
        return reply

    def _dark(self, words):
        self._replies.check_unclaimed()
        self._app.strip.request_dark(self._dark_done)
        self._replies.claim("dark")
        return None

    def _dark_done(self):
        self._replies.finish("dark", {"dark": self._app.strip.dark_frame()})

    def _rest(self, words):
        if not self._app.settings.values["baseline"]:
            raise ValueError("the untouched strip is not followed: set baseline=1")
        self._app.strip.request_rest()
        return {}

    def _auto(self, words):
        self._replies.check_unclaimed()
        self._app.release_keys()
        self._app.strip.request_search(self._auto_done)
        self._replies.claim("auto")
        return None

    def _auto_done(self, outcome):
        app = self._app
        if outcome == DONE:
            reply = app.settings.reply()
        elif outcome == TOO_DARK:
            reply = {"error": "too dark at full gain and LED current; press harder, check the LED"}
        else:
            reply = {"error": "too bright at the least gain and LED current; shade the sensor"}
        note = app.apply_calibration()
        if note and outcome == DONE:
            reply["note"] = note
        self._replies.finish("auto", reply)

    def _save(self, words):
        self._app.save()
        return {}

    def _sync(self, words):
        # A host detects by the streams that the board has restarted.
        return {"t_us": self._app.time_us(), "stream": self._app.strip.streams()}

    def _reboot(self, words):
        self._app.abandon("the board was rebooted")
        self._app.reboot = True
        return {}
