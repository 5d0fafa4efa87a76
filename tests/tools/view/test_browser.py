"""The page in a real Chromium, on a simulated plate with a real service."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from browserpage import PATIENCE_S, Page, drag, lay_down
from selenium.webdriver import ActionChains, Chrome, Keys
from selenium.webdriver.common.by import By
from viewprocess import View, first

from hapticd.sim.rig.process import RigProcess
from hapticd.tools.daemon_process import DaemonProcess
from hapticd_client import Client

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]  # a browser with other tests on few cores is slow


@pytest.fixture(scope="module")
def service() -> Iterator[DaemonProcess]:
    with RigProcess("hands", 1) as rig, DaemonProcess(f'rig_dir = "{rig.directory}"') as running:
        for process in (rig.process, running.process):
            first(process)
        yield running


@pytest.fixture(scope="module")
def view(browser: Chrome, service: DaemonProcess) -> Iterator[View]:
    """The viewer of that service; without a browser it is not even started."""
    with Client(service.runtime_dir, timeout_s=PATIENCE_S):
        pass  # it answers
    running = View("--endpoint", str(service.runtime_dir))
    yield running
    browser.get("about:blank")
    assert running.end() == 0


@pytest.fixture
def page(browser: Chrome, view: View) -> Page:
    """A fresh page of an untouched plate."""
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.get(view.address)
    made = Page(browser)
    made.until(lambda: "0 fingers" in made["state"].text)
    return made


def test_the_page_loads_shows_a_plate_at_rest_and_takes_nothing_from_elsewhere(page: Page) -> None:
    assert page.browser.title == "hapticd: the plate"
    page.until(lambda: "29.205 kHz" in page["modes-text"].text)
    page.until(lambda: 0 < page.brightness() < 10)
    page.until(lambda: "truly moves" in page["field-of"].text)
    assert page["what"].text == "reference plate, 2 modes"
    assert page["untouched"].is_displayed()
    assert not page["notice"].is_displayed()
    names = page.browser.execute_script("return performance.getEntriesByType('resource').map((entry) => entry.name)")
    origin = page.browser.execute_script("return location.origin")
    assert len(names) > 8
    assert all(name.startswith(origin) for name in names)
    assert page.complaints() == []


def test_a_dragged_finger_moves_the_field_and_a_second_one_holds_its_place(page: Page) -> None:
    lay_down(page, 150, 80)
    page.until(lambda: any("of 0.46" in row for row in page.fingers()))  # the first is slippery
    page.until(lambda: page.brightness() > 20)
    before = page.picture()
    drag(page, 30)
    page.until(lambda: any("of 0.00" in row for row in page.fingers()))  # the second is sticky
    assert page.picture() != before
    assert "2 fingers" in page["state"].text
    page.until(lambda: "leak" in page["leak"].text)
    ActionChains(page.browser).release().perform()
    page.until(lambda: "1 finger" in page["state"].text)
    page["plate"].send_keys(Keys.ESCAPE)
    page.until(lambda: page["untouched"].is_displayed())
    page.until(lambda: page.brightness() < 10)
    assert page.complaints() == []


def test_the_keyboard_alone_lands_moves_chooses_presses_and_lifts_a_finger(page: Page, service: DaemonProcess) -> None:
    page.browser.execute_script("document.getElementById('plate').focus()")
    page.keys(Keys.ENTER)
    page.until(lambda: any("of 0.46" in row for row in page.fingers()))
    before = page.picture()
    page.keys(*[Keys.ARROW_RIGHT] * 5, *[Keys.ARROW_UP] * 3)
    page.until(lambda: page.picture() != before)
    page.press_until("3", "of 0.60")
    page.press_until("0", "of 0.00")
    page.press_until("r", "no owner")
    with Client(service.runtime_dir, timeout_s=PATIENCE_S) as client:  # a key makes fingers press harder
        for press, pressure_frac in ((lambda keys: keys.key_down("p"), 0.6), (lambda keys: keys.key_up("p"), 0.1)):
            press(ActionChains(page.browser)).perform()
            states = client.states(PATIENCE_S)
            next(s for s in states if [round(finger.pressure_frac, 1) for finger in s.fingers] == [pressure_frac])
    page.keys(Keys.ENTER)
    page.until(lambda: page["untouched"].is_displayed())


# What is written into a canvas from now on.
WRITTEN = """
window.written = [];
const context = document.getElementById(arguments[0]).getContext('2d'), write = context.fillText;
context.fillText = function (text, ...place) { window.written.push(text); write.call(this, text, ...place); };
"""


def written(page: Page) -> list[str]:
    return list(page.browser.execute_script("return window.written"))


def test_time_can_be_stopped_and_looked_back_at(page: Page) -> None:
    drag(page, 25)
    page.until(lambda: "1 finger" in page["state"].text)
    ActionChains(page.browser).release().perform()
    page.until(lambda: "0 fingers" in page["state"].text)
    page.keys(" ")
    page.until(lambda: page["pause"].get_attribute("aria-pressed") == "true")
    still = page.picture()
    slider = page["when"]
    page.browser.execute_script("arguments[0].focus()", slider)

    def earlier() -> bool:
        page.keys(*[Keys.ARROW_LEFT] * 5)
        return "1 finger" in page["state"].text and page.picture() != still

    page.until(earlier)
    assert page["when-text"].text.startswith("-")
    page.browser.execute_script(WRITTEN, "strip")
    page.until(lambda: any(re.fullmatch(r"\d+: \d\.\d\d", text) for text in written(page)))
    page["pause"].click()
    page.until(lambda: page["state"].text.endswith("0 fingers"))
    assert page["when-text"].text == "now"


def test_another_clients_target_shows_with_its_name_and_is_not_ours_to_change(
    page: Page, service: DaemonProcess
) -> None:
    with Client(service.runtime_dir, "study-7", timeout_s=PATIENCE_S) as client:
        client.virtual("post", position_mm=(20.0, 10.0))
        client.set("post", amplitude_um=0.6)
        page.until(lambda: any("of 0.60" in row for row in page.fingers()))
        (row,) = page.fingers()
        assert "post (virtual)" in row
        assert "held by 'study-7'" in row
        page.until(lambda: page.brightness() > 15)
        assert not page.browser.find_element(By.CSS_SELECTOR, ".finger input").is_enabled()
        page.browser.find_element(By.CSS_SELECTOR, ".finger .name").click()
        page.keys("5")
        page.until(lambda: "held by 'study-7'" in page["notice"].text)
    page.until(lambda: page["untouched"].is_displayed())


def test_what_can_be_worked_has_a_name_for_a_screen_reader(page: Page) -> None:
    nameless = page.browser.execute_script(
        "return [...document.querySelectorAll('button, input, select, [tabindex]')].filter((element) =>"
        "!(element.getAttribute('aria-label') || element.getAttribute('aria-labelledby') || element.textContent.trim()"
        "|| element.labels?.length)).map((element) => element.outerHTML)"
    )
    assert nameless == []


def test_a_dead_daemon_and_its_return_are_shown(page: Page, service: DaemonProcess) -> None:
    service.process.kill()
    service.process.communicate()
    page.until(lambda: page["state"].text == "No daemon")
    assert "hapticd" in page["notice"].text
    first(service.__enter__().process)
    page.until(lambda: "0 fingers" in page["state"].text)
    page.until(lambda: not page["notice"].is_displayed())
    drag(page, 10)
    page.until(lambda: any("of 0.46" in row for row in page.fingers()))
    ActionChains(page.browser).release().perform()


def test_whole_contacts_are_shown_on_a_plate_that_has_them(browser: Chrome) -> None:
    running = View("--sim", "--plate", "fingertip", "--scenario", "strokes")
    try:
        browser.get(running.address)
        page = Page(browser)
        page.until(lambda: page["what"].text == "fingertip plate, 4 modes, contacts of 5 mm")
        page.until(lambda: len(page.fingers()) == 2)
        page.until(lambda: any("feels 1.00" in row for row in page.fingers()))
        page.until(lambda: 0 < page.brightness() < 10)
        browser.execute_script(  # at once: a busy machine may lift and land the fingers, which makes new rows
            "for (const choice of document.querySelectorAll('.finger button'))"
            " if (choice.textContent === 'Slippery') choice.click()"
        )
        asked = re.compile(r"feels 0\.\d\d \(.*\), asked 0\.49")
        page.until(lambda: page.fingers() and all(asked.search(row) for row in page.fingers()))
        assert page.complaints() == []
    finally:
        browser.get("about:blank")
        assert running.end() == 0
