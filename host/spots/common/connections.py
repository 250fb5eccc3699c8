"""Limits the number and the duration of connections to the server."""

import asyncio
from collections.abc import Callable

# Together with WebSockets and open files this stays below the 256 file handles of macOS.
CONNECTIONS_MAX = 128
# Longest duration in s of a request with its answer, even if the client is slow.
CONNECTION_S = 30.0


class Connections:
    """Limits the number and the duration of connections that are not WebSockets.

    A connection is closed after `CONNECTION_S` seconds. A new connection beyond `CONNECTIONS_MAX`
    closes the oldest one. So a client that opens many connections and sends nothing cannot block
    browsers: a browser sends its request immediately, and reconnects if its connection is closed.
    """

    def __init__(self, protocol: Callable[[], asyncio.Protocol]):
        self._protocol = protocol
        self._ends: dict[asyncio.BaseTransport, asyncio.TimerHandle] = {}  # oldest first

    def __call__(self) -> asyncio.Protocol:
        return _Counted(self._protocol(), self)

    def opened(self, transport: asyncio.Transport) -> None:
        """Add a new connection, and start its timeout."""
        if len(self._ends) >= CONNECTIONS_MAX:
            oldest = next(iter(self._ends))
            self.release(oldest)
            oldest.abort()
        loop = asyncio.get_running_loop()
        self._ends[transport] = loop.call_later(CONNECTION_S, transport.abort)

    def release(self, transport: asyncio.BaseTransport | None) -> None:
        """Remove a connection that has ended or has become a WebSocket."""
        end = self._ends.pop(transport, None)
        if end is not None:
            end.cancel()


class _Counted(asyncio.Protocol):
    """Delegates to an asyncio protocol; reports start and end of a connection to `Connections`."""

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
