"""Access control of the web UI: checks each request before anything else handles it."""

import hmac
import ipaddress
import re
import socket
from collections.abc import Sequence

from aiohttp import web

from spots.errors import SettingError

_COOKIE = "spots-token-{port}"  # with the port, because a browser sends cookies to all ports
_LOOKING = ("GET", "HEAD")  # methods that change nothing
_ASK = "this request needs the token: open the address that the server printed"
# The Host header of a browser: a name, an IPv4 address or an IPv6 address in brackets; then a port.
_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([0-9a-z.-]+))(?::([0-9]{1,5}))?", re.ASCII | re.I)
_PORT = 80  # default port of HTTP
_PORT_MAX = 65_535


class Guard:
    """Refuses requests with a foreign ``Host`` or ``Origin`` header, or without a needed token.

    Another website can make a browser send requests to this server; ``Origin`` then names that
    website. With DNS rebinding, the website's own domain name leads to this server; ``Host`` then
    contains that domain name. A website cannot forge these headers.

    Commands need the token; without one, all commands are refused. If other machines can reach the
    server, because `address` is not a loopback address or `hosts` are given, all requests need the
    token. `hosts` are further ``Host`` headers under which browsers reach this server, for example
    through a proxy: ``spots.example.org`` or ``spots.example.org:8443``; SettingError otherwise.
    """

    def __init__(self, address: str, token: str | None, hosts: Sequence[str] = ()):
        self._loopback = ipaddress.ip_address(address).is_loopback
        self._local = self._loopback and not hosts
        self._token = token
        self._own = socket.gethostname().lower().partition(".")[0]
        self._given = {host.lower() for host in hosts}
        self._names = {"localhost"}
        for host in hosts:
            known = _parsed(host)
            if known is None:
                raise SettingError(
                    f"'{host}' is not a host name: write it as in the browser's address, such as "
                    "spots.example.org, without http://"
                )
            self._names.add(known[0])

    @web.middleware
    async def check(self, request: web.Request, handler):
        """Pass a request to its handler, or refuse the request; a middleware for aiohttp.

        HTTPForbidden if the request comes from another website, names an unknown host, or is a
        command without the token; HTTPUnauthorized if it needs the token for another reason.
        """
        if not self._knows(request):
            raise web.HTTPForbidden(
                text="unknown host name: open the address that the server printed, or start the "
                "server with --host and this name"
            )
        origins = request.headers.getall("Origin", [])
        if origins and (len(origins) > 1 or not self._is_own(origins[0], request)):
            raise web.HTTPForbidden(text="requests from other websites are refused")
        if self._is_token(request.query.get("token", "")):
            # The token moves from the visible address into a cookie.
            answer = web.HTTPSeeOther("/")
            answer.set_cookie(_cookie(request), self._token, httponly=True, samesite="Lax")
            raise answer
        if not self._local and not self.may_command(request):
            raise web.HTTPUnauthorized(text=_ASK)
        if request.method not in _LOOKING and not self.may_command(request):
            raise web.HTTPForbidden(text=_ASK)
        return await handler(request)

    def may_command(self, request: web.Request) -> bool:
        """Return whether a request may send commands: its cookie contains the access token."""
        return self._is_token(request.cookies.get(_cookie(request), ""))

    def _knows(self, request: web.Request) -> bool:
        host = host_of(request)
        if host is None:
            return False
        if host[0] in self._names:
            return True
        # The names that a network gives this machine: NAME, NAME.local, NAME.lan, NAME.ts.net, ...
        # The token protects against DNS rebinding of such a name.
        if not self._loopback and host[0].partition(".")[0] == self._own != "localhost":
            return True
        try:
            # DNS rebinding needs a name; an IP address is safe.
            address = ipaddress.ip_address(host[0])
        except ValueError:
            return False
        return address.is_loopback or not self._loopback

    def _is_own(self, origin: str, request: web.Request) -> bool:
        """Return whether a page of this server sent a request, by its ``Origin`` header."""
        if origin == f"http://{request.headers['Host']}":
            return True
        # A proxy of a given name can add encryption, and can replace the ``Host`` header.
        scheme, _, host = origin.partition("://")
        return scheme in ("http", "https") and host.lower() in self._given

    def _is_token(self, given: str) -> bool:
        if self._token is None:
            return False
        return hmac.compare_digest(given.encode(errors="surrogateescape"), self._token.encode())


def host_of(request: web.Request) -> tuple[str, int] | None:
    """Return host and port from the ``Host`` header of a request; None if the header is invalid."""
    hosts = request.headers.getall("Host", [])
    return _parsed(hosts[0]) if len(hosts) == 1 else None


def _parsed(host: str) -> tuple[str, int] | None:
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


def _cookie(request: web.Request) -> str:
    return _COOKIE.format(port=host_of(request)[1])
