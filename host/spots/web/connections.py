"""How many connections the server has, and for how long."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

# With the pages' WebSockets and this program's own files below the 256 that macOS allows.
CONNECTIONS_MAX = 128
# For a request and its answer, however slowly the other side sends and reads.
CONNECTION_S = 30.0


class Connections:
    """Bounds the connections that are no WebSocket, in number and in time.

    When there are too many, the oldest one is closed, not the new one refused: whoever opens many
    and sends nothing keeps no page out. A browser sends its request at once, and opens another
    connection where one was closed.

    Parameters
    ----------
    protocol : callable
        Returns the protocol of a connection, as aiohttp's server does.
    """

    def __init__(self, protocol: Callable[[], asyncio.Protocol]):
        self._protocol = protocol
        self._ends: dict[asyncio.BaseTransport, asyncio.TimerHandle] = {}  # the oldest first

    def __call__(self) -> asyncio.Protocol:
        """Return the protocol of a new connection."""
        return _Counted(self._protocol(), self)

    def opened(self, transport: asyncio.Transport) -> None:
        """Count a connection from now on."""
        if len(self._ends) >= CONNECTIONS_MAX:
            oldest = next(iter(self._ends))
            self.release(oldest)
            oldest.abort()
        loop = asyncio.get_running_loop()
        self._ends[transport] = loop.call_later(CONNECTION_S, transport.abort)

    def release(self, transport: asyncio.BaseTransport | None) -> None:
        """Stop counting a connection: it has ended, or has become a WebSocket."""
        end = self._ends.pop(transport, None)
        if end is not None:
            end.cancel()


class _Counted(asyncio.Protocol):
    """Delegates to a protocol, and reports when its connection begins and ends."""

    def __init__(self, protocol: asyncio.Protocol, connections: Connections):
        self._connections = connections
        self._begun, self._ended = protocol.connection_made, protocol.connection_lost
        self.data_received, self.eof_received = protocol.data_received, protocol.eof_received
        self.pause_writing, self.resume_writing = protocol.pause_writing, protocol.resume_writing

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport
        self._connections.opened(transport)
        self._begun(transport)

    def connection_lost(self, error: Exception | None) -> None:
        self._connections.release(self._transport)
        self._ended(error)
