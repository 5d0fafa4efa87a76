"""Access control of the page's server."""

from __future__ import annotations

import pytest

from hapticd.tools.web import application

OWN = {"Host": "127.0.0.1:8017"}


@pytest.mark.parametrize(
    ("port", "headers", "is_admitted"),
    [
        *((8017, {"Host": host, "Origin": f"http://{host}"}, True) for host in ("127.0.0.1:8017", "localhost:8017")),
        (80, {"Host": "localhost", "Origin": "http://localhost"}, True),  # which browsers leave out
        *(  # names that were bound to this address
            (8017, {"Host": host, "Origin": "http://127.0.0.1:8017"}, False)
            for host in ("", "127.0.0.1", "127.0.0.1:80", "evil.example:8017", "localhost.evil:8017", "[::1]:8017")
        ),
        *(
            (8017, OWN | {"Origin": origin}, False)
            for origin in ("http://evil.example", "null", "https://127.0.0.1:8017", "http://127.0.0.1:9", "")
        ),
    ],
)
def test_a_request_is_accepted_by_its_host_and_origin(port: int, headers: dict[str, str], is_admitted: bool) -> None:
    for needs_origin in (False, True):
        assert (application.refusal(port, headers, needs_origin=needs_origin) == "") == is_admitted
    assert application.refusal(8017, OWN, needs_origin=False) == ""  # a program, which brings the key
    assert application.refusal(8017, OWN, needs_origin=True)  # a WebSocket of no browser


def test_the_browser_loads_nothing_from_elsewhere() -> None:
    policy = application.headers(8017)["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert "connect-src 'self' ws://127.0.0.1:8017 ws://localhost:8017" in policy
