"""Sends readings as OSC over UDP, to programs for sound and light."""

import errno
import math

from pythonosc import osc_bundle_builder, osc_message_builder, udp_client

from spots.common.reports import REPORTS
from spots.errors import RequirementError
from spots.link.board import Board
from spots.link.frames import Contact, Key, Reading, Touch

from .sending import host_and_port

_DEFAULT = "127.0.0.1", 9000
# Nobody listens yet, or the system's buffer is full.
_PASSING = errno.ECONNREFUSED, errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOBUFS


class Osc:
    """Sends each reading as an OSC bundle.

    The time tag is "immediately", or the time of the measurement with `time_tags`: a receiver whose
    clock is behind then plays late by the difference.

    ``/spots/SENSOR/touching`` is 1 while a finger touches. ``/spots/SENSOR/position_um`` and
    ``/spots/SENSOR/force_mN`` are sent while the reading is trusted. ``/spots/SENSOR/contact`` has
    a finger's number, state, position and force (0 if unknown); ``/spots/SENSOR/key`` has page,
    usage, modifiers, and 1 for a press. Spectra are not sent. The address is the receiver's
    ``HOST:PORT``; RequirementError if there is no such host.
    """

    def __init__(self, board: Board, address: str = "", time_tags: bool = False):
        host, port = host_and_port(address, _DEFAULT, "OSC")
        try:
            self._client = udp_client.UDPClient(host, port, allow_broadcast=True)
        except OSError as error:
            raise RequirementError(
                f"cannot send OSC to {host}: {error.strerror}; give the receiver as osc=HOST:PORT"
            ) from None
        self._time_tags = time_tags
        self.place = f"OSC over UDP to {f'[{host}]' if ':' in host else host}:{port}"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Send a frame; a frame that the system's buffer does not take is lost."""
        messages = [*_messages(frame)]
        if not messages:
            return
        tag = utc_s if self._time_tags else osc_bundle_builder.IMMEDIATELY
        bundle = osc_bundle_builder.OscBundleBuilder(tag)
        for name, *arguments in messages:
            message = osc_message_builder.OscMessageBuilder(f"/spots/{frame.sensor}/{name}")
            for one in arguments:
                message.add_arg(one, "f" if isinstance(one, float) else "i")
            bundle.add_content(message.build())  # type: ignore[arg-type]
        try:
            self._client.send(bundle.build())
        except OSError as error:
            if error.errno not in _PASSING:
                REPORTS.say(
                    (self.place, error.errno),
                    f"cannot send {self.place}: {error.strerror}; check address and network",
                )

    def turn(self) -> None:
        """Do nothing: every frame was sent at once."""

    def close(self) -> None:
        """Close the socket."""
        self._client.close()


def _messages(frame: Reading):
    if isinstance(frame, Touch):
        yield "touching", int(frame.touching)
        if frame.trusted:
            yield "position_um", float(frame.position_um)
            if not math.isnan(frame.force_mN):
                yield "force_mN", float(frame.force_mN)
    elif isinstance(frame, Contact):
        force = 0.0 if math.isnan(frame.force_mN) else float(frame.force_mN)
        yield "contact", frame.id, frame.state, float(frame.position_um), force
    elif isinstance(frame, Key):
        yield "key", frame.page, frame.usage, frame.modifiers, int(frame.pressed)
