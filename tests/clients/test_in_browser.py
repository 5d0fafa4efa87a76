"""hapticd.js and its examples in a real Chromium."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from chromium import browser, chromium  # noqa: F401
from fake_daemon import FakeDaemon
from gateway_process import gateway_process, served_files
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from hapticd_client import Client

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
PATIENCE_S = 60.0
HOLD = """
const [address, done] = [arguments[0], arguments[1]];
import("/hapticd.js").then(async (hapticd) => {
  const plate = await hapticd.connect(address, { name: "page", ttlS: 2, timeoutS: 30 });
  await plate.set(1, { friction: 0.2 });
  await plate.set(2, { friction: 1 });
  const numbers = [];
  let held = true;
  await new Promise((resolve) => plate.follow((state) => {
    held &&= state.fingers.every((finger) => finger.target_um !== null);
    if (numbers.push(state.seq) > 600) resolve();
  }, "every"));
  await plate.close();
  done({ held, lost: numbers.at(-1) - numbers[0] + 1 - numbers.length });
}).catch((error) => done({ error: String(error) }));
"""
TRIAL = """
const [address, answer, done] = arguments;
Promise.all([import("/hapticd.js"), import("/examples/jspsych-hapticd.js")]).then(async ([hapticd, plugin]) => {
  const plate = await hapticd.connect(address, { ttlS: 2, timeoutS: 30 });
  const trial = { plate, surfaces: { left: { friction: 0.1 } }, effects: {}, prompt: "Which?", choices: ["a", "b"],
                  marker: "trial 1" };
  const display = document.body.appendChild(document.createElement("div"));
  const shown = setInterval(() => display.querySelectorAll("button")[1] && eval(answer), 20);
  const finished = new Promise((resolve) => new plugin.default({ finishTrial: resolve }).trial(display, trial));
  const data = await finished;
  clearInterval(shown);
  await plate.close();
  done({ response: data.response, whole: data.t_end_ns > data.t_begin_ns && data.rt >= 0 });
}).catch((error) => done({ error: String(error) }));
"""


@pytest.fixture(scope="module")
def origin() -> Iterator[str]:
    with served_files() as served:
        yield served


def ran(browser: Chrome, origin: str, script: str, *given: str) -> object:  # noqa: F811
    browser.set_script_timeout(PATIENCE_S * 2)
    browser.get(f"{origin}/README.md")
    return browser.execute_async_script(script, *given)


def test_a_page_holds_two_fingers_beside_a_python_client_and_misses_no_state(
    browser: Chrome,  # noqa: F811
    origin: str,
    daemon: FakeDaemon,
) -> None:
    daemon.fingers = {1: (0.0, 0.0), 2: (20.0, 0.0), 3: (40.0, 0.0)}
    ended = threading.Event()

    def by_zeromq() -> None:
        with Client(daemon.directory, name="python") as client:
            while not ended.is_set():
                client.set(3, friction=0.5)

    beside = threading.Thread(target=by_zeromq)
    beside.start()
    try:
        with gateway_process(daemon.directory, origin) as address:
            assert ran(browser, origin, HOLD, address) == {"held": True, "lost": 0}
    finally:
        ended.set()
        beside.join()
    assert daemon.refusals == []


def test_a_page_paints_what_fingers_feel(browser: Chrome, origin: str, daemon: FakeDaemon) -> None:  # noqa: F811
    with gateway_process(daemon.directory, origin) as address:
        browser.get("about:blank")
        browser.get(f"{origin}/examples/paint.html#{address}")
        said = browser.find_element(By.ID, "said")
        wait = WebDriverWait(browser, PATIENCE_S)
        wait.until(lambda _: said.text.startswith("connected"))
        canvas = browser.find_element(By.ID, "plate")
        move = ActionChains(browser).move_to_element_with_offset(canvas, -100, 0).click_and_hold()
        move.move_by_offset(200, 0).release().perform()
        wait.until(lambda _: said.text == "1 strips")
        assert daemon.felt_um(0.0) > 0.0
        assert daemon.felt_um(0.0, 40.0) == 0.0
        browser.find_element(By.ID, "clear").click()
        wait.until(lambda _: said.text == "no strips")
        assert daemon.felt_um(0.0) == 0.0


@pytest.mark.parametrize(
    "answer",
    [
        'display.querySelectorAll("button")[1].click()',
        '["x", "3", "2"].forEach((key) => document.dispatchEvent(new KeyboardEvent("keydown", { key })))',
    ],
)
def test_a_jspsych_trial_lays_surfaces_marks_and_has_the_answer(
    browser: Chrome,  # noqa: F811
    origin: str,
    daemon: FakeDaemon,
    answer: str,
) -> None:
    with gateway_process(daemon.directory, origin) as address:
        assert ran(browser, origin, TRIAL, address, answer) == {"response": "b", "whole": True}
    assert [one.text for one in daemon.markers] == ["trial 1 begins", "trial 1 ends: b"]
    assert daemon.felt_um(0.0) == 0.0
