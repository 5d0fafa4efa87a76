"""Access control of the servers of view, study and gateway: only their own page, or a page that the user allows.

Every page in the browser and every user of the computer can reach a server on localhost. So a request must name this
server as its host (against DNS rebinding), have this page as its origin if it has one, and carry the key that the
program printed.
"""

from __future__ import annotations

import hmac
from collections.abc import Collection, Mapping, Sequence

HOSTS = ("127.0.0.1", "localhost")


def refusal(
    port: int,
    headers: Mapping[str, str],
    *,
    needs_origin: bool,
    hosts: Sequence[str] = HOSTS,
    origins: Collection[str] = (),
) -> str:
    """Return why a request with these headers is refused, "" if it is admitted.

    `needs_origin` holds for websockets and posts of pages; programs, which have none, bring the key only. `hosts` are
    this server's names, and `origins` those of other pages that the user allows.
    """
    if headers.get("Host", "") not in _hosts(port, hosts):
        return f"This server answers to {' and '.join(hosts)} only."
    origin = headers.get("Origin")
    if origin is None:
        return "This request needs an origin." if needs_origin else ""
    if origin not in origins and origin not in [f"http://{host}" for host in _hosts(port, hosts)]:
        return "Another page may not use this server."
    return ""


def has_key(given: str, key: str) -> bool:
    """Compare the keys in constant time."""
    return hmac.compare_digest(given.encode(), key.encode())


def headers(port: int) -> dict[str, str]:
    """Return the headers of each response: no foreign content, no frames, no cache."""
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


def _hosts(port: int, hosts: Sequence[str] = HOSTS) -> list[str]:
    """Return host names as browsers send them: without the port 80."""
    return [f"{host}:{port}" for host in hosts] + (list(hosts) if port == 80 else [])
