"""Uploads of lines, one command each; atomic: the end with a checksum makes them valid."""

from .settings import checksum

LINES_MAX = 400
BYTES_MAX = 16_000


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
        if self._bytes > BYTES_MAX or len(self._lines) >= LINES_MAX:
            self.forget()
            raise ValueError(
                "a %s has at most %d lines of %d bytes in all; this one is dropped"
                % (self._what, LINES_MAX, BYTES_MAX)
            )
        self._lines.append(line)
        return {"lines": len(self._lines)}
