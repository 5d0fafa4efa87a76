"""The page of `hapticd view --sim` in a real Chromium: its layout and its flags."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browserpage import Page
from selenium.webdriver import Chrome
from viewprocess import View

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
FINGERTIP = "fingertip plate, 4 modes, contacts of 5 mm"
WINDOWS = {"laptop": (1280, 800), "telephone": (390, 844)}


@pytest.fixture(scope="module")
def view(browser: Chrome, tmp_path_factory: pytest.TempPathFactory) -> Iterator[View]:
    running = View("--sim", scratch=tmp_path_factory.mktemp("v"))
    yield running
    browser.get("about:blank")
    assert running.end() == 0


def page_of(browser: Chrome, view: View, window: str) -> Page:
    width, height = WINDOWS[window]
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get(view.address)
    return Page(browser)


@pytest.mark.parametrize("window", WINDOWS)
def test_the_whole_toolbar_is_in_view(browser: Chrome, view: View, window: str) -> None:
    page = page_of(browser, view, window)
    page.until(lambda: page["what"].text == FINGERTIP)
    for name in ("tool", "content", "erase", "record", "help"):
        assert page[name].is_displayed()
        place = page[name].rect
        assert 0 <= place["x"] < place["x"] + place["width"] <= WINDOWS[window][0]
    assert page["plate"].rect["y"] + page["plate"].rect["height"] <= WINDOWS[window][1]


FLAG = """
const [isReady, fingers, failed, done] = arguments;
import('/flags.js').then(({ Flags }) => {
  const list = document.createElement('ul'), flags = new Flags(list, () => {});
  for (const count of [3, 4])
    flags.show({ fingers }, { board: { ready: isReady, deadman_trips: count }, missed_ticks: count,
      failed_passes: failed }, true);
  const lit = [...list.children].filter((item) => !item.hidden);
  done(Object.fromEntries(lit.map((item) => [item.firstChild.textContent, item.firstChild.className.split(' ')[1]])));
})
"""


@pytest.mark.parametrize(
    ("is_ready", "fingers", "failed", "lit"),
    [
        (True, [{}], 0, {"dead-man 4": "warn", "skipped 4": "warn"}),
        (False, [{}], 0, {"board silent": "bad", "dead-man 4": "bad", "skipped 4": "warn"}),
        (True, [], 0, {"OK": "ok"}),
        (False, [], 0, {"board silent": "bad"}),
        (True, [], 2, {"passes fail": "bad"}),
    ],
    ids=["touched", "silent board", "untouched", "untouched silent board", "failed passes"],
)
def test_only_what_stands_out_has_a_flag_and_late_frames_only_while_touched(
    browser: Chrome, view: View, is_ready: bool, fingers: list[object], failed: int, lit: dict[str, str]
) -> None:
    page_of(browser, view, "laptop")
    assert browser.execute_async_script(FLAG, is_ready, fingers, failed) == lit


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
