"""Who may see the page: checked before anything else is looked at."""

from __future__ import annotations

import hmac
import ipaddress
import socket
from urllib.parse import urlsplit

from aiohttp import web

_COOKIE = "spots-token-{port}"  # browsers keep the cookies of all ports of an address together
_LOOKING = ("GET", "HEAD")
_ASK = "this needs the token: open the address that 'spots serve' printed"


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
            if not self._knows(request.headers.get("Host", "")):
                raise web.HTTPForbidden(text="this name is not mine: use the address printed")
            origin = request.headers.get("Origin")
            if origin is not None and origin != f"http://{request.headers['Host']}":
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

    def _knows(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
            _port(host)  # it is a number, or raises ValueError
            if name in self._names:
                return True
            # A name that is an address cannot be made to point anywhere else.
            address = ipaddress.ip_address(name)
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


def _cookie(request: web.Request) -> str:
    return _COOKIE.format(port=_port(request.headers["Host"]))


def _port(host: str) -> int:
    return urlsplit(f"//{host}").port or 80
