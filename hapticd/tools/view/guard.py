"""Who may speak to the page's server: a browser on this computer that shows this page, opened with its key.

A server on localhost is within reach of every page that the browser shows and of every user of the computer. So a
request must name this server as its host (else a foreign name was bound to this address: DNS rebinding), come from
its own page where it says where it comes from, and bring the key that the program printed.
"""

from __future__ import annotations

import hmac
from collections.abc import Mapping

HOSTS = ("127.0.0.1", "localhost")


def refusal(port: int, headers: Mapping[str, str], *, is_socket: bool) -> str:
    """Why a request with these headers is refused, "" where it is not. A websocket must tell its origin."""
    if headers.get("Host", "") not in _hosts(port):
        return "This server answers to 127.0.0.1 and localhost only."
    origin = headers.get("Origin")
    if origin is None:
        return "A websocket must tell its origin." if is_socket else ""
    if origin not in [f"http://{host}" for host in _hosts(port)]:
        return "Another page may not use this server."
    return ""


def has_key(given: str, key: str) -> bool:
    """In a time that tells nothing of the key."""
    return hmac.compare_digest(given.encode(), key.encode())


def headers(port: int) -> dict[str, str]:
    """What each answer tells the browser: nothing comes from elsewhere, nobody frames or keeps this page."""
    sockets = " ".join(f"ws://{host}" for host in _hosts(port))
    return {
        "Content-Security-Policy": (
            f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self' {sockets}; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        ),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


def _hosts(port: int) -> list[str]:
    """As browsers write them: the port of http itself is left out."""
    return [f"{host}:{port}" for host in HOSTS] + (list(HOSTS) if port == 80 else [])
