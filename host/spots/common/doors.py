"""Who may connect to a server of this computer, by the headers ``Host`` and ``Origin``.

Another website can make a browser send requests to a server; ``Origin`` then names that website.
With DNS rebinding, the website's own domain name leads to the server; ``Host`` then contains that
domain name. A website cannot forge these headers.
"""

import ipaddress
import re
import socket
from collections.abc import Sequence

from ..errors import SettingError

# The Host header of a browser: a name, an IPv4 address or an IPv6 address in brackets; then a port.
_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([0-9a-z.-]+))(?::([0-9]{1,5}))?", re.ASCII | re.I)
_PORT = 80  # default port of HTTP
_PORT_MAX = 65_535


class Door:
    """Knows the hosts and the origins of requests that a server may answer.

    The server listens on the IP address or name `address`. `hosts` are further ``Host`` headers
    under which browsers reach it, for example through a proxy: ``spots.example.org`` or
    ``spots.example.org:8443``; SettingError otherwise. `origins` are websites that may connect,
    such as ``https://example.org``.
    """

    def __init__(self, address: str, hosts: Sequence[str] = (), origins: Sequence[str] = ()):
        self.is_loopback = is_loopback(address)
        self._own = socket.gethostname().lower().partition(".")[0]
        self._given = {host.lower() for host in hosts}
        self._origins = {origin.lower().rstrip("/") for origin in origins}
        self._names = {"localhost"}
        for host in hosts:
            known = parsed(host)
            if known is None:
                raise SettingError(
                    f"'{host}' is not a host name: write it as in the browser's address, such as "
                    "spots.example.org, without http://"
                )
            self._names.add(known[0])

    def knows_host(self, hosts: Sequence[str]) -> bool:
        """Return whether the ``Host`` headers of a request name this server, one time."""
        host = host_of(hosts)
        if host is None:
            return False
        if host[0] in self._names:
            return True
        # The names that a network gives this machine: NAME, NAME.local, NAME.lan, NAME.ts.net, ...
        # DNS rebinding of such a name needs another protection, such as a token.
        if not self.is_loopback and host[0].partition(".")[0] == self._own != "localhost":
            return True
        try:
            # DNS rebinding needs a name; an IP address is safe.
            address = ipaddress.ip_address(host[0])
        except ValueError:
            return False
        return address.is_loopback or not self.is_loopback

    def knows_origin(self, origins: Sequence[str], host: str) -> bool:
        """Return whether a page of this server, or one that may connect, sent a request.

        `origins` are the ``Origin`` headers: a program sends none. `host` is the ``Host`` header.
        """
        if not origins:
            return True
        if len(origins) > 1:
            return False
        (origin,) = origins
        if origin == f"http://{host}" or origin.lower() in self._origins:
            return True
        # A proxy of a given name can add encryption, and can replace the ``Host`` header.
        scheme, _, name = origin.partition("://")
        return scheme in ("http", "https") and name.lower() in self._given


def is_loopback(address: str) -> bool:
    """Return whether only this computer can reach an IP address, or the name ``localhost``."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.lower() == "localhost"


def host_of(hosts: Sequence[str]) -> tuple[str, int] | None:
    """Return host and port from the ``Host`` headers of a request; None if they are invalid."""
    return parsed(hosts[0]) if len(hosts) == 1 else None


def parsed(host: str) -> tuple[str, int] | None:
    """Return host and port from a ``Host`` header; None if it is invalid."""
    match = _HOST.fullmatch(host)
    if match is None:
        return None
    in_brackets, name, port = match.groups()
    if in_brackets is not None:
        try:
            name = str(ipaddress.IPv6Address(in_brackets))
        except ValueError:
            return None
    number = _PORT if port is None else int(port)
    return (name.lower(), number) if number <= _PORT_MAX else None
