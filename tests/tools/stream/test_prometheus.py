"""Metrics in Prometheus' format: base units, values of the daemon's status, requested at each scrape."""

from __future__ import annotations

import threading
import urllib.request
from typing import Any

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest
from prometheus_client.parser import text_string_to_metric_families
from tools.stream.daemon_states import FakeDaemon

from hapticd.tools.stream import prometheus


def scraped(answer: Any) -> dict[str, float]:
    """What a scrape gives, as Prometheus' own parser reads it: values by name and labels."""
    registry = CollectorRegistry()
    registry.register(prometheus.StatusCollector(lambda: answer))
    return parsed(generate_latest(registry).decode())


def parsed(text: str) -> dict[str, float]:
    values = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            labels = ",".join(f'{key}="{value}"' for key, value in sorted(sample.labels.items()))
            values[f"{sample.name}{{{labels}}}" if labels else sample.name] = sample.value
    return values


def test_each_number_of_the_status_is_exported_in_base_units(reported: Any) -> None:
    values, board = scraped(reported), reported["board"]
    assert [name for name, value in values.items() if name.startswith("hapticd_state{") and value] == [
        'hapticd_state{hapticd_state="ACTIVE"}'
    ]
    assert (values["hapticd_up"], values["hapticd_fingers"], values["hapticd_board_ready"]) == (1, 2, 1)
    assert values["hapticd_trackpad_silent_seconds"] == pytest.approx(reported["trackpad"]["silent_ms"] * 1e-3)
    assert values["hapticd_touch_solves"] == reported["touch"]["solves"] > 0
    assert values["hapticd_trackpad_reports_frames"] == reported["trackpad"]["reports"]["frames"] > 0
    assert values['hapticd_board_info{firmware="9.9"}'] == 1
    assert values['hapticd_board_w_limit_meters{mode="1"}'] == pytest.approx(board["w_limit_um"][1] * 1e-6)
    d_um, q_um = board["measured_um"][0]
    assert values['hapticd_board_measured_meters{mode="0"}'] == pytest.approx(abs(complex(d_um, q_um)) * 1e-6)
    link = reported["timing"]["histograms"]["link"]
    assert values["hapticd_timing_link_seconds_count"] == sum(count for _, count in link["buckets"]) > 0


def test_without_a_daemon_only_up_is_exported_as_0() -> None:
    assert scraped(None) == {"hapticd_up": 0.0}


def test_the_daemon_is_asked_at_each_scrape_and_only_then(fake_daemon: FakeDaemon) -> None:
    addresses: list[str] = []
    ended, served = threading.Event(), threading.Event()

    def wait() -> None:
        served.set()
        ended.wait()

    def run() -> None:
        prometheus.run(str(fake_daemon.directory), "127.0.0.1", 0, wait, addresses.append)

    stream = threading.Thread(target=run)
    stream.start()
    try:
        assert served.wait(10)
        for fingers in (1, 2):
            page: list[bytes] = []
            scrape = threading.Thread(target=lambda: page.append(urllib.request.urlopen(addresses[0]).read()))  # noqa: B023
            scrape.start()
            assert fake_daemon.answer({"fingers": fingers}) == "status"
            scrape.join()
            assert parsed(page[0].decode())["hapticd_fingers"] == fingers
        assert not fake_daemon.control.poll(0)
    finally:
        ended.set()
        stream.join()
