"""Web application that admits only its own page, and the pages and programs that the user allows.

Every page in the browser and every user of the computer can reach a server on localhost. So a request must name this
server as its host (against DNS rebinding), have this page as its origin if it has one, and carry the key that the
program printed.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from functools import partial
from importlib import resources

from aiohttp import web

HOSTS = ("127.0.0.1", "localhost")
TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
SHARED = ("base.css", "icon.svg")  # of all pages

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def application(
    command: str,
    key: str,
    *,
    keyed: Collection[str] | None = None,
    hosts: Sequence[str] = HOSTS,
    origins: Collection[str] = (),
    max_bytes: int = 2**20,
) -> web.Application:
    """Return an application without routes. The paths `keyed` (None: all) need `key`, which `hapticd COMMAND` printed.

    `hosts` are the server's names, and `origins` those of other pages that the user allows.
    """

    @web.middleware
    async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
        port = request.get_extra_info("sockname", ("", 0))[1]  # 0 of a connection that is gone
        needs_origin = request.path == "/socket" or request.method == "POST"
        why = refusal(port, request.headers, needs_origin=needs_origin, hosts=hosts, origins=origins)
        has_key = hmac.compare_digest(request.query.get("key", "").encode(), key.encode())
        if not (why or has_key) and (keyed is None or request.path in keyed):
            why = f"Open the address that `hapticd {command}` printed: it ends with a key."
        if why:
            return web.Response(status=403, text=why + "\n", headers=headers(port))
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(headers(port))
            raise
        if not response.prepared:
            response.headers.update(headers(port))
        return response

    return web.Application(client_max_size=max_bytes, middlewares=[guarded])


def add_page(app: web.Application, package: str) -> None:
    """Serve the files of `package`'s folder `page`, index.html as /, and those that all pages share."""
    names = [entry.name for entry in resources.files(package).joinpath("page").iterdir()]
    for home, name in [*((package, name) for name in names), *((__package__, name) for name in SHARED)]:
        if name.rpartition(".")[2] in TYPES:
            app.router.add_get("/" if name == "index.html" else f"/{name}", partial(_file, home, name))


async def _file(package: str, name: str, _: web.Request) -> web.StreamResponse:
    data = resources.files(package).joinpath("page", name).read_bytes()
    return web.Response(body=data, content_type=TYPES[name.rpartition(".")[2]], charset="utf-8")


def refusal(
    port: int,
    headers: Mapping[str, str],
    *,
    needs_origin: bool,
    hosts: Sequence[str] = HOSTS,
    origins: Collection[str] = (),
) -> str:
    """Return why a request with these headers is refused, "" if it is admitted.

    `needs_origin` holds for websockets and posts of pages; programs, which have none, bring the key only.
    """
    if headers.get("Host", "") not in _hosts(port, hosts):
        return f"This server answers to {' and '.join(hosts)} only."
    origin = headers.get("Origin")
    if origin is None:
        return "This request needs an origin." if needs_origin else ""
    if origin not in origins and origin not in [f"http://{host}" for host in _hosts(port, hosts)]:
        return "Another page may not use this server."
    return ""


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
