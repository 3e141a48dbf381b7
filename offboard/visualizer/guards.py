"""What may reach the page's server, and what a browser may do with its answers: middlewares, and judging addresses."""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

PAGE = Path(__file__).with_name("page")
_INLINE = re.search(r"<script>(.*?)</script>", (PAGE / "index.html").read_text(encoding="utf-8"), re.DOTALL)
assert _INLINE is not None
_INLINE_HASH = b64encode(sha256(_INLINE[1].encode()).digest()).decode()
# A browser that obeys it sends no request to any other server
_POLICY = (
    f"default-src 'self'; script-src 'self' 'sha256-{_INLINE_HASH}'; img-src 'self' data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class PolicyHeaders:
    """The policy on every answer, and nothing kept: after an update no browser shows half of the old page."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = _POLICY + _own_socket(scope)
                headers["X-Content-Type-Options"] = "nosniff"
                headers["Referrer-Policy"] = "no-referrer"
                headers.setdefault("Cache-Control", "no-cache")
            await send(message)

        await self._app(scope, receive, with_headers)


class KnownHosts(TrustedHostMiddleware):
    """Accepts only requests for a name of this machine. A page of the internet could resolve its own name to this
    machine's address (DNS rebinding).

    A bare IP address cannot be rebound like that, so every address is accepted.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket") and _is_address(Headers(scope=scope).get("host", "")):
            await self.app(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)


def is_of_host(origin: str | None, host: str) -> bool:
    """Browsers send the origin of the requesting page; other programs need not."""
    return origin is None or urlsplit(origin).netloc == host


def is_own(address: str) -> bool:
    """Whether a browser at that address runs on this machine."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return False


def _own_socket(scope: Scope) -> str:
    """Not every browser counts a WebSocket of the same host as 'self'."""
    host = dict(scope["headers"]).get(b"host", b"").decode("latin-1")
    return f"; connect-src 'self' ws://{host}" if re.fullmatch(r"[\w.:\[\]-]+", host) else ""


def _is_address(host: str) -> bool:
    """Whether a Host header names an address, with or without a port."""
    try:
        ip_address(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return False
    return True
