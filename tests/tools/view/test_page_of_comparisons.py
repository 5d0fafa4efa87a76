"""The page of `hapticd calibrate person` in a real Chromium, with a simulated plate and a real service."""

from __future__ import annotations

from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import pytest
from browserpage import PATIENCE_S, Page
from selenium.webdriver import Chrome
from viewprocess import View

from hapticd.__main__ import main
from hapticd.config.person import CALIBRATION, folder_of
from hapticd.design.person import Match
from hapticd.sim.rig.process import RigProcess
from hapticd.tools.calibrate import folder, person
from hapticd.tools.daemon_process import DaemonProcess
from hapticd_client import Client


@pytest.mark.long
@pytest.mark.timeout(300)
def test_keys_and_buttons_answer_and_without_the_page_the_plate_is_quiet(
    browser: Chrome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    links: SimpleQueue[str] = SimpleQueue()
    monkeypatch.setenv("DISPLAY", "a screen")
    monkeypatch.setattr("webbrowser.open", links.put)
    monkeypatch.setattr(person, "STROKED", 5)
    monkeypatch.chdir(tmp_path)
    results = folder_of(CALIBRATION, "anna")
    results.mkdir(parents=True)
    folder.save(results, person.verdict(Match(0.7, 0.02, 0.65, 0.75), Namespace(sim=False)))
    page = Page(browser)
    with (
        ThreadPoolExecutor(1) as pool,
        RigProcess("press", 1, plate="fingertip") as rig,
        DaemonProcess(f'rig_dir = "{rig.directory}"') as service,
        Client(service.runtime_dir, timeout_s=PATIENCE_S) as other,
    ):
        next(state for state in other.states(PATIENCE_S) if state.fingers)
        command = "calibrate person --participant anna --check --browser"
        ending = pool.submit(main, [*command.split(), "--endpoint", str(service.runtime_dir)])
        link = links.get(timeout=PATIENCE_S)
        for done in range(person.design.CHECK_TRIALS):
            if done in (0, 3):
                browser.get("about:blank")
                page.until(lambda: other.surfaces() == [])
                browser.get(link)
            page.until(lambda: page["plate"].is_enabled())
            page.until(lambda: [one["name"] for one in other.surfaces()] == ["even"])
            page.keys("p") if done % 2 else page["reference"].click()
            page.until(lambda: page["progress"].get_attribute("value") == str(done + 1))  # noqa: B023
        page.until(lambda: "confirm the curve" in page["heading"].text)
        assert page["curve"].is_displayed()
        assert ending.result(PATIENCE_S) == 0
        assert other.surfaces() == []
        view = View("--endpoint", str(service.runtime_dir))
        browser.get(view.address)
        page.until(lambda: page["what"].text.startswith("fingertip plate"))
        other.person("anna")
        page.until(lambda: page["what"].text.endswith("for anna"))
        assert page.complaints() == []
        assert view.end() == 0
