"""A page's own files, and who may have them: what the servers of view, first-light and study share."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Collection
from functools import partial
from importlib import resources

from aiohttp import web

from . import connections, guard

TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
SHARED = ("base.css", "icon.svg")  # of all pages

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def application(
    package: str, command: str, key: str, keyed: Collection[str], max_bytes: int = 2**20
) -> web.Application:
    """Return an application that serves the files of `package`'s folder `page`, index.html as /, and those that all
    pages share. The paths `keyed` are admitted with `key` alone, which `hapticd COMMAND` printed."""

    @web.middleware
    async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
        return await _admitted(request, handler, key if request.path in keyed else None, command)

    app = web.Application(client_max_size=max_bytes, middlewares=[guarded])
    app.router.add_get("/", partial(_file, package, "index.html"))
    for entry in resources.files(package).joinpath("page").iterdir():
        if entry.name != "index.html" and entry.name.rpartition(".")[2] in TYPES:
            app.router.add_get(f"/{entry.name}", partial(_file, package, entry.name))
    for name in SHARED:
        app.router.add_get(f"/{name}", partial(_file, __package__, name))
    return app


async def _admitted(request: web.Request, handler: Handler, key: str | None, command: str) -> web.StreamResponse:
    """Return the handler's response to a request that may have one; `key` is None for what needs none."""
    port = request.get_extra_info("sockname", ("", 0))[1]  # 0 of a connection that is gone
    why = guard.refusal(port, request.headers, needs_origin=request.path == "/socket" or request.method == "POST")
    if not why and key is not None:
        is_known = guard.has_key(request.query.get("key", ""), key)
        if is_known:
            connections.know(request)
        why = "" if is_known else f"Open the address that `hapticd {command}` printed: it ends with a key."
    if why:
        return web.Response(status=403, text=why + "\n", headers=guard.headers(port))
    try:
        response = await handler(request)
    except web.HTTPException as error:
        error.headers.update(guard.headers(port))
        raise
    if not response.prepared:
        response.headers.update(guard.headers(port))
    return response


async def _file(package: str, name: str, _: web.Request) -> web.StreamResponse:
    data = resources.files(package).joinpath("page", name).read_bytes()
    return web.Response(body=data, content_type=TYPES[name.rpartition(".")[2]], charset="utf-8")
