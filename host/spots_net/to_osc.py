"""Sends readings as OSC over UDP, to programs for sound and light."""

import math
from contextlib import suppress

from pythonosc import osc_bundle_builder, osc_message_builder, udp_client

from spots.errors import RequirementError
from spots.link.board import Board
from spots.link.frames import Contact, Key, Reading, Touch

from .outlet import host_and_port

_DEFAULT = "127.0.0.1", 9000


class Osc:
    """Sends each reading as an OSC bundle, whose time tag is the time of the measurement.

    ``/spots/SENSOR/touching`` is 1 while a finger touches. ``/spots/SENSOR/position_um`` and
    ``/spots/SENSOR/force_mN`` are sent while the reading is trusted. ``/spots/SENSOR/contact`` has
    a finger's number, state, position and force (0 if unknown); ``/spots/SENSOR/key`` has page,
    usage, modifiers, and 1 for a press. Spectra are not sent. The address is the receiver's
    ``HOST:PORT``; RequirementError if there is no such host.
    """

    def __init__(self, board: Board, address: str = ""):
        host, port = host_and_port(address, _DEFAULT, "OSC")
        try:
            self._client = udp_client.UDPClient(host, port)
        except OSError as error:
            raise RequirementError(
                f"cannot send OSC to {host}: {error.strerror}; give the receiver as osc=HOST:PORT"
            ) from None
        self.place = f"OSC over UDP to {host}:{port}"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Send a frame; a frame that the system's buffer does not take is lost."""
        messages = [*_messages(frame)]
        if not messages:
            return
        bundle = osc_bundle_builder.OscBundleBuilder(utc_s)
        for name, *arguments in messages:
            message = osc_message_builder.OscMessageBuilder(f"/spots/{frame.sensor}/{name}")
            for one in arguments:
                message.add_arg(one, "f" if isinstance(one, float) else "i")
            bundle.add_content(message.build())  # type: ignore[arg-type]
        with suppress(OSError):  # nobody listens, or the buffer is full
            self._client.send(bundle.build())

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
