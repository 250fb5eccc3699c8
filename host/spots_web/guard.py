"""Access control of the web UI: checks each request before anything else handles it."""

import hmac
from collections.abc import Sequence

from aiohttp import web

from spots.common import doors
from spots.common.doors import Door

_COOKIE = "spots-token-{port}"  # with the port, because a browser sends cookies to all ports
_LOOKING = ("GET", "HEAD")  # methods that change nothing
_ASK = "this request needs the token: open the address that the server printed"


class Guard:
    """Refuses requests with a foreign ``Host`` or ``Origin`` header, or without a needed token.

    Commands need the token; without one, all commands are refused. If other machines can reach the
    server, because `address` is not a loopback address or `hosts` are given, all requests need the
    token. `hosts` are further ``Host`` headers under which browsers reach this server, for example
    through a proxy: ``spots.example.org`` or ``spots.example.org:8443``; SettingError otherwise.
    """

    def __init__(self, address: str, token: str | None, hosts: Sequence[str] = ()):
        self._door = Door(address, hosts)
        self._local = self._door.is_loopback and not hosts
        self._token = token

    @web.middleware
    async def check(self, request: web.Request, handler):
        """Pass a request to its handler, or refuse the request; a middleware for aiohttp.

        HTTPForbidden if the request comes from another website, names an unknown host, or is a
        command without the token; HTTPUnauthorized if it needs the token for another reason.
        """
        if not self._door.knows_host(request.headers.getall("Host", [])):
            raise web.HTTPForbidden(
                text="unknown host name: open the address that the server printed, or start the "
                "server with --host and this name"
            )
        origins = request.headers.getall("Origin", [])
        if not self._door.knows_origin(origins, request.headers["Host"]):
            raise web.HTTPForbidden(text="requests from other websites are refused")
        if self._is_token(request.query.get("token", "")):
            # The token moves from the visible address into a cookie.
            answer = web.HTTPSeeOther("./")  # relative: a proxy may serve the page below a path
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

    def _is_token(self, given: str) -> bool:
        if self._token is None:
            return False
        return hmac.compare_digest(given.encode(errors="surrogateescape"), self._token.encode())


def host_of(request: web.Request) -> tuple[str, int] | None:
    """Return host and port from the ``Host`` header of a request; None if the header is invalid."""
    return doors.host_of(request.headers.getall("Host", []))


def _cookie(request: web.Request) -> str:
    return _COOKIE.format(port=host_of(request)[1])
