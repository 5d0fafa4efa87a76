"""`hapticd first-light --sim --view` in a real Chromium: a mistake is named and mended, a sound rig is driven."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.support.ui import WebDriverWait

from hapticd.tools.first_light import commission

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]
WINDOWS = {"laptop": (1280, 800), "telephone": (390, 844)}
PATIENCE_S = 60.0
READ = """
return {
  heading: document.getElementById('heading').textContent,
  buttons: [...document.querySelectorAll('#buttons button')].map((button) => button.dataset.button),
  verdict: document.getElementById('result').hidden ? '' : document.getElementById('verdict').textContent,
  notes: document.getElementById('notes').textContent,
  passed: document.querySelectorAll('#steps .passed').length,
  wide: document.documentElement.scrollWidth > innerWidth,
  lowest: document.getElementById('buttons').getBoundingClientRect().bottom,
}"""
PRESS = "document.querySelector(`[data-button=${arguments[0]}]`)?.click()"


class FirstLightPage:
    """The page in a window of this size."""

    def __init__(self, browser: Chrome, address: str, window: str) -> None:
        self.browser = browser
        self.width, self.height = WINDOWS[window]
        metrics = {"width": self.width, "height": self.height, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        browser.get_log("browser")
        browser.get(address)

    def read(self) -> dict[str, Any]:
        return dict(self.browser.execute_script(READ))

    def until(self, *buttons: str, note: str = "") -> dict[str, Any]:
        """Wait for one of these buttons, and for a note."""

        def is_shown(_: Chrome) -> dict[str, Any] | None:
            seen = self.read()
            is_there = not buttons or set(buttons) & set(seen["buttons"])
            return seen if is_there and note in seen["notes"] else None

        found = WebDriverWait(self.browser, PATIENCE_S, poll_frequency=0.05).until(is_shown)
        assert not found["wide"]
        assert found["lowest"] <= self.height  # what is to be pressed is in the window
        return dict(found)

    def press(self, button: str) -> None:
        self.browser.execute_script(PRESS, button)

    def walk(self, until: str) -> list[dict[str, Any]]:
        """Press what leads on until a step's heading begins so, and return all verdicts."""
        verdicts = []
        while True:
            seen = self.until("begin", "next", "look", "finish")
            if seen["heading"].startswith(until):
                return verdicts
            name = seen["buttons"][0]
            if name != "begin":
                verdicts.append(seen)
            self.press(name)
            WebDriverWait(self.browser, PATIENCE_S, poll_frequency=0.02).until(
                lambda _, name=name: name not in self.read()["buttons"]
            )


@contextmanager
def first_light(out: Path, *arguments: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    command = [sys.executable, "-m", "hapticd", "first-light", "--sim", "--view", "--page-port", "0", "--no-browser"]
    with subprocess.Popen([*command, "--out", str(out), *arguments], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().partition(": ")[2].strip(), process
        finally:
            process.terminate()


def test_a_mistake_is_named_mended_by_a_press_and_the_rig_is_driven_to_the_first_touch(
    browser: Chrome, tmp_path: Path
) -> None:
    with first_light(tmp_path, "--seed", "10", "--mistakes", "1") as (address, process):
        page = FirstLightPage(browser, address, "laptop")
        verdicts = page.walk("15 of 15")
        assert [one["verdict"] for one in verdicts if "look" in one["buttons"]] == [
            "Sensor 0 is inverted: turn over its two leads, or look at its poling dot."
        ]
        page.until("begin")
        page.press("begin")
        assert "the loop holds its amplitude" in page.until("finish")["verdict"]
        page.press("finish")
        assert page.until(note="All steps have passed: hapticd run --config")["passed"] == 15
        assert process.wait(PATIENCE_S) == 0
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    browser.get("about:blank")


def test_a_sound_rig_on_a_telephone_whose_page_is_closed_meanwhile_goes_on_where_it_was(
    browser: Chrome, tmp_path: Path
) -> None:
    with first_light(tmp_path, "--mistakes", "0") as (address, _):
        page = FirstLightPage(browser, address, "telephone")
        page.walk("2 of 15")
        page.until("begin")
        browser.execute_script(f"{PRESS}; setTimeout(() => location.replace('about:blank'), 50)", "begin")
        WebDriverWait(browser, PATIENCE_S).until(lambda it: it.current_url == "about:blank")
        page = FirstLightPage(browser, address, "telephone")
        seen = page.until("begin", note=commission.GONE)
        assert (seen["heading"], seen["passed"]) == ("2 of 15: Sensors at rest", 1)
        page.walk("4 of 15")
        browser.get("about:blank")
    with first_light(tmp_path) as (address, _):
        page = FirstLightPage(browser, address, "telephone")
        assert page.until("begin")["heading"] == "4 of 15: Polarity"
        assert all("PASS" not in one["verdict"] for one in page.walk("13 of 15"))
        browser.get("about:blank")
