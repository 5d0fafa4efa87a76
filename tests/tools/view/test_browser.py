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
    page.until(lambda: any("of 1.00" in row for row in page.fingers()))  # the first is slippery
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


def test_the_keyboard_alone_lands_moves_chooses_and_lifts_a_finger(page: Page) -> None:
    page.browser.execute_script("document.getElementById('plate').focus()")
    page.keys(Keys.ENTER)
    page.until(lambda: any("of 1.00" in row for row in page.fingers()))
    before = page.picture()
    page.keys(*[Keys.ARROW_RIGHT] * 5, *[Keys.ARROW_UP] * 3)
    page.until(lambda: page.picture() != before)
    page.press_until("3", "of 0.60")
    page.press_until("0", "of 0.00")
    page.press_until("r", "no owner")
    page.keys(Keys.ENTER)
    page.until(lambda: page["untouched"].is_displayed())


def test_a_finger_that_stays_presses_harder_and_so_do_all_while_p_is_held(page: Page, service: DaemonProcess) -> None:
    with Client(service.runtime_dir, timeout_s=PATIENCE_S) as client:

        def until_pressed(pressure_frac: float) -> None:
            states = client.states(PATIENCE_S)
            next(s for s in states if [round(finger.pressure_frac, 1) for finger in s.fingers] == [pressure_frac])

        ActionChains(page.browser).move_to_element(page["plate"]).click_and_hold().perform()
        until_pressed(0.6)
        ActionChains(page.browser).move_by_offset(40, 0).perform()
        until_pressed(0.1)
        ActionChains(page.browser).release().perform()
        page.until(lambda: page["untouched"].is_displayed())
        page.browser.execute_script("document.getElementById('plate').focus()")
        page.keys(Keys.ENTER)
        until_pressed(0.1)
        ActionChains(page.browser).key_down("p").perform()
        until_pressed(0.6)
        ActionChains(page.browser).key_up("p").perform()
        until_pressed(0.1)
    page.keys(Keys.ENTER)
    page.until(lambda: page["untouched"].is_displayed())


def test_a_layer_shows_where_another_finger_could_reach_its_target(page: Page) -> None:
    page.lay("could be sticky")
    page.until(lambda: "No finger is slippery" in page["layer-text"].text)
    lay_down(page, 150, 80)
    page.until(lambda: any("of 1.00" in row for row in page.fingers()))
    page.until(lambda: "Light: where one more finger could be sticky" in page["layer-text"].text)
    page.until(lambda: page.colourfulness() < 30)
    page.until(lambda: page["scale-text"].text == "share of the target that is reached")
    assert page.average("Math.max(red, green, blue) - Math.min(red, green, blue)", of="scale") < 5
    page.lay("none")
    page.until(lambda: not page["layer-text"].is_displayed())
    page.until(lambda: page.colourfulness() > 60)
    page.until(lambda: page["scale-text"].text == "vibration, µm peak to peak")
    assert page.average("Math.max(red, green, blue) - Math.min(red, green, blue)", of="scale") > 20
    page.lay("could be sticky")
    lay_down(page, -120, -30)
    page.until(lambda: "2 fingers" in page["state"].text)
    page.press_until("0", "of 0.00")
    read: list[str] = []  # once: a moment later another finger's lift may be shown
    page.until(lambda: read.append(page["layer-text"].text) or "where finger" in read[-1])
    assert 5 < int(read[-1].split()[-5]) < 98
    page.lay("could be slippery")
    page.until(lambda: "could be slippery" in page["layer-text"].text)
    page.lay("none")
    page["plate"].send_keys(Keys.ESCAPE)
    page.until(lambda: page["untouched"].is_displayed())
    assert page.complaints() == []


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
    page["when"].send_keys(*[Keys.ARROW_LEFT] * 40)
    page.until(earlier)  # what was there before the pause still is


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
    page.until(lambda: any("of 1.00" in row for row in page.fingers()))
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
        asked = re.compile(r"feels 0\.\d\d \(.*\), asked 0\.19")
        page.until(lambda: page.fingers() and all(asked.search(row) for row in page.fingers()))
        assert page.complaints() == []
    finally:
        browser.get("about:blank")
        assert running.end() == 0
