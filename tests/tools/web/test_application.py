"""Access control of the page's server."""

from __future__ import annotations

import pytest

from hapticd.tools.web import application


@pytest.mark.parametrize("host", ["127.0.0.1:8017", "localhost:8017"])
def test_its_own_page_is_admitted(host: str) -> None:
    assert application.refusal(8017, {"Host": host}, needs_origin=False) == ""
    assert application.refusal(8017, {"Host": host, "Origin": f"http://{host}"}, needs_origin=True) == ""


@pytest.mark.parametrize(
    "host", ["", "127.0.0.1", "127.0.0.1:80", "evil.example:8017", "localhost.evil:8017", "[::1]:8017"]
)
def test_a_name_that_was_bound_to_this_address_is_refused(host: str) -> None:
    assert "127.0.0.1" in application.refusal(8017, {"Host": host}, needs_origin=False)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:8017", "http://127.0.0.1:9", ""])
@pytest.mark.parametrize("needs_origin", [True, False])
def test_another_page_is_refused(origin: str, needs_origin: bool) -> None:
    assert application.refusal(8017, {"Host": "127.0.0.1:8017", "Origin": origin}, needs_origin=needs_origin)


def test_a_websocket_without_an_origin_is_no_browser_s() -> None:
    assert application.refusal(8017, {"Host": "127.0.0.1:8017"}, needs_origin=True)


def test_the_port_of_http_itself_is_left_out_of_names() -> None:
    assert application.refusal(80, {"Host": "localhost", "Origin": "http://localhost"}, needs_origin=True) == ""


def test_the_browser_loads_nothing_from_elsewhere() -> None:
    policy = application.headers(8017)["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert "connect-src 'self' ws://127.0.0.1:8017 ws://localhost:8017" in policy
