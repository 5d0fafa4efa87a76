"""The page of `hapticd view --sim` in a real Chromium: its first plate, another one, and a layout that stays."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from browserpage import Page, lay_down
from selenium.webdriver import Chrome
from selenium.webdriver.support.ui import Select
from viewprocess import View

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
FINGERTIP, REFERENCE = "fingertip plate, 4 modes, contacts of 5 mm", "reference plate, 2 modes"
WINDOWS = {"laptop": (1280, 800), "telephone": (390, 844)}

# What the page shows in each picture that the browser draws: where things are, and whether anything alarms.
WATCH = """
window.seen = {};
const look = () => {
  const state = document.getElementById('state').textContent;
  const box = (id) => document.querySelector(id).getBoundingClientRect();
  const [plate, time] = [box('#plate'), box('#time-box')];
  const places = [box('header').height, plate.top + scrollY, plate.width, time.top + scrollY];
  const alarms = [!document.getElementById('notice').hidden, document.querySelectorAll('.flag.bad').length > 0];
  const kind = state.startsWith('Starting') ? 'starting' : 'running';
  const known = window.seen[kind] ??= { places: [], alarms: [] };
  for (const [name, value] of Object.entries({ places, alarms })) {
    const text = JSON.stringify(value);
    if (!known[name].includes(text)) known[name].push(text);
  }
  requestAnimationFrame(look);
};
look();
"""


@pytest.fixture(scope="module")
def view(browser: Chrome, tmp_path_factory: pytest.TempPathFactory) -> Iterator[View]:
    running = View("--sim", scratch=tmp_path_factory.mktemp("v"))  # tests switch its plate
    yield running
    browser.get("about:blank")
    assert running.end() == 0


def page_of(browser: Chrome, view: View, window: str) -> Page:
    width, height = WINDOWS[window]
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get(view.address)
    return Page(browser)


def selected(page: Page, menu: str) -> str:
    return Select(page[menu]).first_selected_option.text


def seen(page: Page, kind: str) -> dict[str, list[Any]]:
    found: dict[str, list[str]] = page.browser.execute_script("return window.seen[arguments[0]]", kind)
    return {name: [json.loads(text) for text in texts] for name, texts in found.items()}


@pytest.mark.parametrize("window", WINDOWS)
def test_the_first_plate_is_for_fingertips_and_another_takes_its_own_modes_without_alarm_or_jump(
    browser: Chrome, view: View, window: str
) -> None:
    page = page_of(browser, view, window)
    page.until(lambda: page["what"].text == FINGERTIP)
    page.until(lambda: "0 fingers" in page["state"].text)
    assert [selected(page, f"switch-{menu}") for menu in ("plate", "modes", "radius")] == ["fingertip", "4", "5 mm"]
    page.browser.execute_script(WATCH)
    page.choose("switch-plate", "reference")
    page.until(lambda: page["what"].text == REFERENCE and "0 fingers" in page["state"].text)
    assert [selected(page, f"switch-{menu}") for menu in ("plate", "modes", "radius")] == ["reference", "2", "points"]
    assert not page["switch-radius"].is_enabled()
    page.choose("switch-plate", "fingertip")
    page.until(lambda: page["what"].text == FINGERTIP and "0 fingers" in page["state"].text)
    starting, running = seen(page, "starting"), seen(page, "running")
    assert starting["alarms"] == [[False, False]]
    assert starting["places"] == running["places"]
    assert len(running["places"]) == 1
    assert page.complaints() == []


def test_fingers_that_lie_on_the_plate_lie_on_the_next_one_with_the_same_targets(browser: Chrome, view: View) -> None:
    page = page_of(browser, view, "laptop")
    page.until(lambda: page["what"].text == FINGERTIP and "0 fingers" in page["state"].text)
    lay_down(page, 150, 80)
    page.until(lambda: any("of 1.00" in row for row in page.fingers()))
    lay_down(page, -120, -30)
    page.until(lambda: any("of 0.00" in row for row in page.fingers()))
    page.choose("switch-plate", "reference")
    page.until(lambda: page["what"].text == REFERENCE)
    page.until(lambda: sorted(row.count("of 0.00") for row in page.fingers()) == [0, 1])
    page.choose("switch-plate", "fingertip")
    page.until(lambda: page["what"].text == FINGERTIP and "0 fingers" not in page["state"].text)


@pytest.mark.parametrize("window", WINDOWS)
def test_the_whole_toolbar_is_in_view(browser: Chrome, view: View, window: str) -> None:
    page = page_of(browser, view, window)
    page.until(lambda: page["what"].text == FINGERTIP)
    for name in (
        "tool",
        "content",
        "erase",
        "layer",
        "switch-plate",
        "switch-modes",
        "switch-radius",
        "record",
        "help",
    ):
        assert page[name].is_displayed()
        place = page[name].rect
        assert 0 <= place["x"] < place["x"] + place["width"] <= WINDOWS[window][0]
    assert page["plate"].rect["y"] + page["plate"].rect["height"] <= WINDOWS[window][1]


FLAG = """
const [isReady, fingers, done] = arguments;
import('/flags.js').then(({ Flags }) => {
  const list = document.createElement('ul'), flags = new Flags(list, () => {});
  for (const count of [3, 4])
    flags.show({ fingers }, { board: { ready: isReady, deadman_trips: count }, missed_ticks: count }, true);
  const lit = [...list.children].filter((item) => !item.hidden);
  done(Object.fromEntries(lit.map((item) => [item.firstChild.textContent, item.firstChild.className.split(' ')[1]])));
})
"""


@pytest.mark.parametrize(
    ("is_ready", "fingers", "lit"),
    [
        (True, [{}], {"dead-man 4": "warn", "skipped 4": "warn"}),
        (False, [{}], {"board silent": "bad", "dead-man 4": "bad", "skipped 4": "warn"}),
        (True, [], {"OK": "ok"}),
        (False, [], {"board silent": "bad"}),
    ],
    ids=["touched", "silent board", "untouched", "untouched silent board"],
)
def test_only_what_stands_out_has_a_flag_and_late_frames_only_while_touched(
    browser: Chrome, view: View, is_ready: bool, fingers: list[object], lit: dict[str, str]
) -> None:
    page_of(browser, view, "laptop")
    assert browser.execute_async_script(FLAG, is_ready, fingers) == lit


FAULT = """
const [state, done] = arguments;
import('/flags.js').then(({ Flags }) => {
  const list = document.createElement('ul'), pressed = [];
  const flags = new Flags(list, () => pressed.push(place));
  flags.show({ state, fingers: [] }, { board: { ready: true, fault_code: 7 } }, true);
  let place = 0;
  for (const item of list.children) { item.firstChild.click(); place++; }
  done(pressed.map((place) => list.children[place].firstChild.textContent));
})
"""


@pytest.mark.parametrize(("state", "clearing"), [("FAULT", ["fault 7"]), ("ACTIVE", [])])
def test_the_flag_of_a_fault_alone_clears_it(browser: Chrome, view: View, state: str, clearing: list[str]) -> None:
    page_of(browser, view, "laptop")
    assert browser.execute_async_script(FAULT, state) == clearing
