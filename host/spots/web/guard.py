"""Who may see the page: checked before anything else is looked at."""

from __future__ import annotations

import hmac
import ipaddress
import re
import socket

from aiohttp import web

_COOKIE = "spots-token-{port}"  # browsers keep the cookies of all ports of an address together
_LOOKING = ("GET", "HEAD")
_ASK = "this needs the token: open the address that 'spots serve' printed"
# What a browser sends as Host: a name, an IPv4 address or an IPv6 one in brackets, and a port.
_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([0-9a-z.-]+))(?::([0-9]{1,5}))?", re.ASCII | re.I)
_PORT = 80  # of HTTP, where the host names none
_PORT_MAX = 65_535


class Guard:
    """Refuses foreign hosts, origins and visitors without the token.

    A page of another site can make a browser send requests here, also under a name of its own
    that it lets point here (DNS rebinding). Such a name is in the ``Host`` header, and such a site
    in ``Origin``; neither can be forged by a page.

    Parameters
    ----------
    address : str
        The IP address that is listened on.
    token : str or None
        Asked of who commands anything, and of everyone unless `address` is a loopback one. Without
        one nobody commands.
    """

    def __init__(self, address: str, token: str | None):
        self._loopback = ipaddress.ip_address(address).is_loopback
        self._token = token
        name = socket.gethostname().lower()
        self._names = {"localhost"} if self._loopback else {"localhost", name, name + ".local"}

    def middleware(self):
        """Return it as aiohttp takes it."""

        @web.middleware
        async def check(request: web.Request, handler):
            if not self._knows(request):
                raise web.HTTPForbidden(text="this name is not mine: use the address printed")
            origins = request.headers.getall("Origin", [])
            if origins not in ([], [f"http://{request.headers['Host']}"]):
                raise web.HTTPForbidden(text="pages of other sites get nothing here")
            if self._is_token(request.query.get("token", "")):
                raise self._let_in(request)
            if not self._loopback and not self.may_command(request):
                raise web.HTTPUnauthorized(text=_ASK)
            if request.method not in _LOOKING and not self.may_command(request):
                raise web.HTTPForbidden(text=_ASK)
            return await handler(request)

        return check

    def may_command(self, request: web.Request) -> bool:
        """Return whether who asks has the token."""
        return self._is_token(request.cookies.get(_cookie(request), ""))

    def _knows(self, request: web.Request) -> bool:
        host = host_of(request)
        if host is None:
            return False
        if host[0] in self._names:
            return True
        try:
            # A name that is an address cannot be made to point anywhere else.
            address = ipaddress.ip_address(host[0])
        except ValueError:
            return False
        return address.is_loopback or not self._loopback

    def _is_token(self, given: str) -> bool:
        if self._token is None:
            return False
        return hmac.compare_digest(given.encode(errors="surrogateescape"), self._token.encode())

    def _let_in(self, request: web.Request) -> web.HTTPSeeOther:
        # The token moves from the address, which is seen and shared, into a cookie.
        answer = web.HTTPSeeOther("/")
        answer.set_cookie(_cookie(request), self._token, httponly=True, samesite="Lax")
        return answer


def host_of(request: web.Request) -> tuple[str, int] | None:
    """Return the host that a request names and its port; None unless it names one, wholly."""
    hosts = request.headers.getall("Host", [])
    match = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
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
