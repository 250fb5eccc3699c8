"""Text commands from the host: one ASCII line each; the reply is one JSON object.

docs/extend/commands.md describes the commands. An invalid line changes no settings, calibration or
layout; the reply to it contains an error sentence, and the code of the reason as ``why``. A
ValueError has this code as its second argument, or gets it from `Commands.handle`. Commands
allocate memory, which is acceptable because they are rare.
"""

import gc
import json

from .. import PROTOCOL, __version__
from ..reading.frame import TEXT_MAX
from .settings import LIMITS, checksum

LINE_MAX = 255
_LINES_MAX = 400  # lines of an upload
_BYTES_MAX = 16_000
_PART_MAX = TEXT_MAX - 60  # characters of the lines in a reply, with quotes and commas
NAME_MAX = 20  # characters of an unknown name that the reply repeats
_PREFIX = "sensor="
_FIRST = ["begin"], ["clear"]  # words of the first line of an upload
_NO_MEMORY = "no memory is left for this command: reboot and try again"


class LineReader:
    """Assembles lines from single bytes in a buffer of fixed size."""

    def __init__(self):
        self._line = bytearray(LINE_MAX)
        self._size = 0

    def feed(self, byte):
        """Add a byte; return True if it ends a line that is not empty. Allocates nothing."""
        if byte == 10 or byte == 13:
            return self._size > 0
        if self._size < LINE_MAX:
            self._line[self._size] = byte
        self._size = min(self._size + 1, LINE_MAX + 1)
        return False

    def line(self):
        """Return the complete line as str and start the next line.

        Raises
        ------
        ValueError
            If the line is too long or not printable ASCII.
        """
        size, self._size = self._size, 0
        if size > LINE_MAX:
            raise ValueError("a line must have at most %d characters" % LINE_MAX)
        line = bytes(memoryview(self._line)[:size])
        if min(line) < 32 or max(line) > 126:
            raise ValueError("the line must be printable ASCII")
        return line.decode()


class Replies:
    """Sends the replies to commands: immediately, or when the work of a long command is done.

    Parameters
    ----------
    framer : frame.Framer
        Sends each reply as a TEXT frame.
    time : frame.Time32
        Board time; updated before each reply.
    sensor : int or None
        Number of the strip, for its replies; None on a board with one strip.
    """

    def __init__(self, framer, time, sensor):
        self._framer = framer
        self._time = time
        self._sensor = sensor
        self._claimed = None

    def log(self, level, text):
        """Send the log line `text`; `level` is ``"info"`` or ``"error"``."""
        self.send(self.of_strip({"log": level, "text": text}))

    def of_strip(self, reply):
        """Add the number of the strip to a reply (dict) if the board has several; return it."""
        if self._sensor is not None:
            reply["sensor"] = self._sensor
        return reply

    def send(self, reply):
        """Send a reply (dict); if it is too long or memory is short, send an error instead."""
        self._time.update()
        try:
            data = json.dumps(reply).encode()
            error = "the reply is too long" if len(data) > TEXT_MAX else None
        except MemoryError:
            error = _NO_MEMORY
        if error:
            reply = {"re": reply.get("re"), "error": error, "why": "no_memory"}
            data = json.dumps(reply).encode()
        self._framer.text(data)

    def check_unclaimed(self):
        """Raise ValueError if the reply to an earlier command is still pending."""
        if self._claimed:
            raise ValueError("'%s' still runs: wait for its reply" % self._claimed, "busy")

    def claim(self, name):
        """Record that the reply to the command `name` is sent later, with `finish`."""
        self._claimed = name

    def finish(self, name, reply):
        """Send the delayed reply (dict) to the command `name`."""
        self._claimed = None
        reply["re"] = name
        self.send(self.of_strip(reply))

    def abandon(self, why):
        """If a reply is pending, send an error instead; `why` is the reason."""
        if self._claimed:
            error = why + " before the command ended"
            self.finish(self._claimed, {"error": error, "why": "canceled"})


class Upload:
    """Receives a text line by line, for one of the commands ``cal`` and ``layout``.

    The host sends ``begin``, the lines, and ``end`` with a checksum; or ``clear``. ``lines N``
    reads the stored text from its line N on, counted from 0.

    Parameters
    ----------
    command : str
        Name of the command, such as ``cal``.
    what : str
        Name of the text in messages, such as ``calibration``.
    use : callable
        ``use(lines) -> dict`` uses the lines; an empty list removes the stored text. The result
        becomes a part of the reply. It raises ValueError if the lines are invalid.
    stored : callable
        ``stored()`` returns the lines in use.
    """

    def __init__(self, command, what, use, stored):
        self._command = command
        self.what = what
        self._use = use
        self._stored = stored
        self.forget()

    def forget(self):
        """Drop the received lines; the next upload must begin with ``begin``."""
        self._lines = None
        self._bytes = 0

    def take(self, words):
        """Process one command of an upload; return the reply (dict).

        Parameters
        ----------
        words : list of str
            Words after the name of the command: ``begin``, ``clear``, ``end`` and the checksum, or
            one line of the text.

        Raises
        ------
        ValueError
            If the command is invalid; the message says why.
        """
        verb = words[0] if words else ""
        if verb == "begin":
            self.forget()
            self._lines = []
            return {}
        if verb == "clear":
            self.forget()
            return self._use([])
        if verb == "lines" and self._lines is None:
            return self._lines_from(words)
        if self._lines is None:
            raise ValueError("send '%s begin' first" % self._command)
        if verb != "end":
            return self._keep(" ".join(words))
        lines = self._lines
        self.forget()
        if words[1:] != [checksum(lines)]:
            raise ValueError("the checksum differs: send the %s again" % self.what)
        reply = {self.what: words[1]}
        reply.update(self._use(lines))
        return reply

    def _lines_from(self, words):
        # As many lines as fit into a reply. With their quotes, commas and the rest of the reply,
        # they have at most `TEXT_MAX` characters.
        lines = self._stored()
        first = int(words[1]) if words[1:] and words[1].isdigit() else 0
        last = first
        room = _PART_MAX
        while last < len(lines) and room >= len(lines[last]):
            room -= len(lines[last]) + 4
            last += 1
        return {"lines": lines[first:last], "of": len(lines)}

    def _keep(self, line):
        if not line:
            raise ValueError("'%s' needs a line of the %s after it" % (self._command, self.what))
        self._bytes += len(line) + 1
        if self._bytes > _BYTES_MAX or len(self._lines) >= _LINES_MAX:
            self.forget()
            raise ValueError(
                "the %s is too large: send at most %d lines and %d bytes"
                % (self.what, _LINES_MAX, _BYTES_MAX)
            )
        self._lines.append(line)
        gc.collect()  # keeps the lines together, so that the heap has large free pieces
        return {"lines": len(self._lines)}


class Commands:
    """Executes the commands in this list, which `spots command --help` shows.

    commands of the board:
      hello               board, firmware, id, settings, calibration
      get                 settings, dark frame, faults, counters of missed samples
      set NAME=VALUE ...  exposure_us, gain, led_mA, average, channels,
                          strain_ppm, dark_every, mains_hz, keys, gamepad, watchdog,
                          led, radio
      set keys=1          touches press keys; with 'set gamepad=1', they move a gamepad
      autoexpose          find gain and LED current while you press firmly
      dark                take a dark frame; if led=always, unplug the LED, then send
                          'dark off'
      tare                take the present light as the baseline
      stream KIND ...     select the frames of each sample: touch, spectrum, contact, off
      layout, cal         upload a layout or a calibration, line by line; 'cal lines N'
                          returns the stored lines from line N on
      save                store settings, layout and calibration
      sync                the board's time, and the kinds of frames that it streams
      radio ORDER         hosts by radio: list, pair, forget ADDRESS
      reboot              restart the firmware
      ... sensor=N        the command is for strip N, counted from 0

    Parameters
    ----------
    board : app.Board
        Board that the commands control.
    """

    def __init__(self, board):
        self._board = board
        self._uploads_to = board.strips[0]  # strip of the present upload

    def handle(self, line):
        """Execute the command in a line.

        Parameters
        ----------
        line : str
            Name of the command and its arguments.

        Returns
        -------
        dict or None
            Reply to send; None if the reply is sent later, when the work is done.
        """
        words = line.split() or [""]
        name = words[0]
        strip = self._board.strips[0]
        try:
            strip = self._strip(words)
            if name not in self._TABLE:
                text = "no such command; use one of " + ", ".join(sorted(self._TABLE))
                if name in LIMITS:
                    text = "'%s' is a setting: send 'set %s=VALUE'" % (name, name)
                raise ValueError(text, "no_command")
            if self._board.radio and self._board.radio.refuses(name, words):
                raise ValueError("this command goes by USB only", "by_usb_only")
            reply = self._TABLE[name](self, strip, words)
        except (ValueError, OSError) as error:
            if isinstance(error, OSError):
                reply = {"error": str(error), "why": "no_bus"}
            else:
                what = strip.uploads[name].what if name in strip.uploads else "value"
                text, why = (error.args + ("bad_" + what,))[:2]
                reply = {"error": text, "why": why}
        except MemoryError:
            for upload in strip.uploads.values():
                upload.forget()
            reply = {"error": _NO_MEMORY, "why": "no_memory"}
        if reply is not None:
            reply["re"] = name[:NAME_MAX]
            strip.replies.of_strip(reply)
        return reply

    def _strip(self, words):
        # Return the strip that a command is for, and remove ``sensor=N`` from its words. Of an
        # upload, only the first line needs it.
        strips = self._board.strips
        strip = strips[0]
        uploads = words[0] in strip.uploads and words[1:2] != ["lines"]
        if len(words) > 1 and words[-1].startswith(_PREFIX):
            known = [str(i) for i in range(len(strips))]
            number = words.pop()[len(_PREFIX) :]
            if number not in known:
                raise ValueError("sensor must be " + " or ".join(known), "no_sensor")
            strip = strips[int(number)]
        elif uploads and words[1:] not in _FIRST:
            strip = self._uploads_to
        if uploads:
            self._uploads_to = strip
        return strip

    def _hello(self, strip, words):
        reply = strip.identity()
        reply["protocol"] = PROTOCOL
        reply["firmware"] = __version__
        return reply

    def _get(self, strip, words):
        return strip.state()

    def _set(self, strip, words):
        if len(words) == 1:
            raise ValueError("name a setting, as in: set exposure_us=10000 gain=9")
        if strip.settings.change(words[1:]):
            strip.restart()
        reply = strip.settings.reply()
        reply["rate_mHz"] = strip.settings.rate_mHz()
        reply.update(strip.apply_calibration())
        return reply

    def _stream(self, strip, words):
        kinds = set(words[1:])
        if not kinds or kinds - {"touch", "spectrum", "contact", "off"}:
            raise ValueError("stream takes touch, spectrum, contact, or off")
        if "off" in kinds and len(kinds) > 1:
            raise ValueError("stream off takes no other word")
        reply = {"stream": sorted(kinds)}
        note = strip.strip.stream(kinds)
        if note:
            reply["note"] = note
        return reply

    def _dark(self, strip, words):
        strip.replies.check_unclaimed()
        if strip.settings.values["led"] == "always" and words[1:] != ["off"]:
            if not strip.strip.lit_flags:
                from .light import NO_DARK

                raise ValueError(NO_DARK, "no_dark")
            return {"dark": strip.strip.dark_frame()}
        strip.strip.request_dark(strip.dark_done)
        strip.replies.claim("dark")
        return None

    def _tare(self, strip, words):
        strip.strip.request_tare()
        return {}

    def _autoexpose(self, strip, words):
        strip.replies.check_unclaimed()
        strip.release_keys()
        strip.strip.request_search(strip.search_done)
        strip.replies.claim("autoexpose")
        return None

    def _save(self, strip, words):
        try:
            self._board.save()
        except OSError as error:
            # The numbers are the same on all runtimes; the host has a sentence for each.
            number = error.args[0] if error.args else None
            error = "the flash cannot be written: error %s" % number
            return {"error": error, "errno": number, "why": "no_flash"}
        return {}

    def _sync(self, strip, words):
        # A host detects a restart of the board by an empty list of streams.
        return {"t_us": self._board.time_us(), "stream": strip.strip.streams()}

    def _reboot(self, strip, words):
        for each in self._board.strips:
            each.abandon("the board was rebooted")
        self._board.reboot = True
        return {}

    def _upload(self, strip, words):
        return strip.uploads[words[0]].take(words[1:])

    def _radio(self, strip, words):
        if self._board.radio is None:
            raise ValueError("the radio is off: 'set radio=both', 'save', 'reboot'", "no_radio")
        return self._board.radio.order(words[1:])

    # Each function gets a strip and all words of the line, including the name of the command.
    _TABLE = {
        "hello": _hello,
        "get": _get,
        "set": _set,
        "stream": _stream,
        "dark": _dark,
        "tare": _tare,
        "autoexpose": _autoexpose,
        "cal": _upload,
        "layout": _upload,
        "save": _save,
        "sync": _sync,
        "reboot": _reboot,
        "radio": _radio,
    }
