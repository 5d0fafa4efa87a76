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
def view(browser: Chrome) -> Iterator[View]:
    running = View("--sim")
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


def test_a_toolbar_that_goes_on_beyond_an_edge_fades_there(browser: Chrome, view: View) -> None:
    page = page_of(browser, view, "telephone")
    page.until(lambda: page["drawn-sideways"].get_attribute("class") == "behind")
    for name in ("record", "help"):  # stay in view, whatever is drawn sideways
        place = page[name].rect
        assert place["x"] + place["width"] <= browser.execute_script("return innerWidth")
    browser.execute_script("document.getElementById('drawn-sideways').scrollLeft = 60")
    page.until(lambda: page["drawn-sideways"].get_attribute("class") == "behind before")
    browser.execute_script("document.getElementById('drawn-sideways').scrollLeft = 10000")
    page.until(lambda: page["drawn-sideways"].get_attribute("class") == "before")
    page = page_of(browser, view, "laptop")
    page.until(lambda: page["what"].text == FINGERTIP)
    assert page["drawn-sideways"].get_attribute("class") == ""


FLAG = """
const [isReady, done] = arguments;
import('/flags.js').then(({ Flags }) => {
  const list = document.createElement('ul'), flags = new Flags(list, () => {});
  for (const count of [3, 4])
    flags.show({}, { board: { ready: isReady, deadman_trips: count }, missed_ticks: count }, true);
  done([5, 7].map((place) => list.children[place].firstChild.className));
})
"""


@pytest.mark.parametrize(("is_ready", "dead_man"), [(True, "flag warn"), (False, "flag bad")])
def test_late_frames_of_a_board_that_goes_on_are_amber_and_of_a_silent_one_red(
    browser: Chrome, view: View, is_ready: bool, dead_man: str
) -> None:
    page_of(browser, view, "laptop")
    assert browser.execute_async_script(FLAG, is_ready) == [dead_man, "flag warn"]


FAULT = """
const [state, done] = arguments;
import('/flags.js').then(({ Flags }) => {
  const list = document.createElement('ul'), pressed = [];
  const flags = new Flags(list, () => pressed.push(place));
  flags.show({ state }, { board: { ready: true, fault_code: 7 } }, true);
  let place = 0;
  for (const item of list.children) { item.firstChild.click(); place++; }
  done(pressed.map((place) => list.children[place].firstChild.textContent));
})
"""


@pytest.mark.parametrize(("state", "clearing"), [("FAULT", ["fault 7"]), ("ACTIVE", [])])
def test_the_flag_of_a_fault_alone_clears_it(browser: Chrome, view: View, state: str, clearing: list[str]) -> None:
    page_of(browser, view, "laptop")
    assert browser.execute_async_script(FAULT, state) == clearing
