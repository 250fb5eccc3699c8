"""Replies and log lines to the host, as TEXT frames of JSON. They allocate; they are rare."""

import json

from .frame import TEXT_MAX

NO_MEMORY = "no memory left for this; reboot and try again"


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
            error = NO_MEMORY
        if error:
            data = json.dumps({"re": reply.get("re"), "error": error}).encode()
        self._framer.text(data)

    @property
    def pending(self):
        """The command whose reply will follow, or None."""
        return self._claimed

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
