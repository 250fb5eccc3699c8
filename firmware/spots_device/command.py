"""Text commands, host to board: one ASCII line in, one JSON object out. See docs/protocol.md.

A bad line changes nothing and is answered with a sentence. Commands allocate; they are rare.
"""

import json

from . import PROTOCOL, __version__
from .calibration import Calibration
from .exposure import DONE, TOO_DARK
from .frame import TEXT_MAX
from .settings import checksum
from .uses import check_layout

LINE_MAX = 255
_LINES_MAX = 400  # of an upload
_BYTES_MAX = 16_000
NAME_MAX = 20  # so much of an unknown name is repeated in the reply
_NO_MEMORY = "no memory left for this; reboot and try again"


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
        if min(line) < 32 or max(line) > 126:
            raise ValueError("a line is printable ASCII")
        return line.decode()


class Replies:
    """Sends replies, and remembers the one that will follow when its work is done.

    Parameters
    ----------
    framer : frame.Framer
    time : frame.Time32
    """

    def __init__(self, framer, time):
        self._framer = framer
        self._time = time
        self._claimed = None

    def log(self, level, text):
        """Send a log line."""
        self.send({"log": level, "text": text})

    def send(self, reply):
        """Send a reply, or an error in its place if it is too long or memory does not suffice."""
        self._time.update()
        try:
            data = json.dumps(reply).encode()
            error = "the reply is too long" if len(data) > TEXT_MAX else None
        except MemoryError:
            error = _NO_MEMORY
        if error:
            data = json.dumps({"re": reply.get("re"), "error": error}).encode()
        self._framer.text(data)

    def check_unclaimed(self):
        """Raise ValueError while a reply is still to follow."""
        if self._claimed:
            raise ValueError("wait for '%s' to end" % self._claimed)

    def claim(self, name):
        """Record that the reply to a command will follow."""
        self._claimed = name

    def finish(self, name, reply):
        """Send the reply that was claimed."""
        self._claimed = None
        reply["re"] = name
        self.send(reply)

    def abandon(self, why):
        """Answer a request that will not end."""
        if self._claimed:
            self.finish(self._claimed, {"error": why + " before this ended"})


class Upload:
    """What ``cal`` and ``layout`` share: begin, lines, end with a checksum; or clear.

    Parameters
    ----------
    command, what : str
        The command, and what its lines are.
    check : callable
        Raises ValueError if lines must not be used.
    use : callable
        Takes lines that were checked, or none; returns what keeps them from working, or None.
    """

    def __init__(self, command, what, check, use):
        self._command = command
        self._what = what
        self._check = check
        self._use = use
        self.forget()

    def forget(self):
        """Drop the lines received so far."""
        self._lines = None
        self._bytes = 0

    def take(self, words):
        """Carry a command out and return its reply; ValueError if it is refused."""
        verb = words[0] if words else ""
        if verb == "begin":
            self.forget()
            self._lines = []
            return {}
        if verb == "clear":
            self.forget()
            return self._reply({}, self._use([]))
        if self._lines is None:
            raise ValueError("begin with '%s begin'" % self._command)
        if verb != "end":
            return self._keep(" ".join(words))
        lines = self._lines
        self.forget()
        if words[1:] != [checksum(lines)]:
            raise ValueError("the checksum differs; send the %s again" % self._what)
        self._check(lines)
        return self._reply({self._what: checksum(lines)}, self._use(lines))

    def _reply(self, reply, note):
        if note:
            reply["note"] = note
        return reply

    def _keep(self, line):
        if not line:
            raise ValueError("say a line of the %s after '%s'" % (self._what, self._command))
        self._bytes += len(line) + 1
        if self._bytes > _BYTES_MAX or len(self._lines) >= _LINES_MAX:
            self.forget()
            raise ValueError(
                "a %s has at most %d lines of %d bytes in all; this one is dropped"
                % (self._what, _LINES_MAX, _BYTES_MAX)
            )
        self._lines.append(line)
        return {"lines": len(self._lines)}


class Commands:
    """What each command does to the application; `spots command --help` shows this list.

    commands of the board:
      hello               board, firmware, id, settings, calibration
      get                 settings, dark frame, faults and what was missed
      set NAME=VALUE ...  exposure_us, gain, led_mA, average, plan, strain_ppm,
                          baseline, dark_every, mains_hz, keys, gamepad, watchdog
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
        self._uploads = {
            "cal": Upload("cal", "calibration", Calibration, app.use_calibration),
            "layout": Upload("layout", "layout", check_layout, app.use_layout),
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
        if name not in self._TABLE:
            known = ", ".join(sorted(self._TABLE))
            return {"re": name[:NAME_MAX], "error": "no such command; there are " + known}
        try:
            reply = self._TABLE[name](self, words)
        except (ValueError, OSError) as error:
            reply = {"error": str(error)}
        except MemoryError:
            for upload in self._uploads.values():
                upload.forget()
            reply = {"error": _NO_MEMORY}
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
        if len(words) == 1:
            raise ValueError("say what to set, as in: set exposure_us=10000 gain=9")
        app = self._app
        if app.settings.change(words[1:]):
            app.restart()
        reply = app.settings.reply()
        reply["rate_mHz"] = app.rate_mHz()
        note = app.apply_calibration()
        if note:
            reply["note"] = note
        return reply

    def _stream(self, words):
        kinds = set(words[1:])
        if not kinds or kinds - {"touch", "spectrum", "off"} or len(kinds) > 2:
            raise ValueError("stream takes touch, spectrum, both, or off")
        if "off" in kinds and len(kinds) > 1:
            raise ValueError("stream takes off alone")
        self._app.strip.stream(kinds)
        self._app.measure()
        return {"stream": sorted(kinds)}

    def _switch(self, words):
        name = words[0]
        if words[1:] not in (["on"], ["off"]):
            raise ValueError("%s takes on or off" % name)
        app = self._app
        app.settings.change(["%s=%d" % (name, words[1] == "on")])
        note = app.apply_calibration()
        reply = {name: words[1]}
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

    def _upload(self, words):
        return self._uploads[words[0]].take(words[1:])

    # What they take are the words of the line, the name too.
    _TABLE = {
        "hello": _hello,
        "get": _get,
        "set": _set,
        "stream": _stream,
        "keys": _switch,
        "gamepad": _switch,
        "dark": _dark,
        "rest": _rest,
        "auto": _auto,
        "cal": _upload,
        "layout": _upload,
        "save": _save,
        "sync": _sync,
        "reboot": _reboot,
    }
