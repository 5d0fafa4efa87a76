"""Surfaces in a real Chromium: other clients' layers are painted, and a person draws, drags and removes layers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from asynchronous import wait_for
from browserpage import PATIENCE_S, Page, drag, lay_down
from PIL import Image
from selenium.webdriver import ActionChains, Chrome, Keys
from selenium.webdriver.common.by import By
from viewprocess import View, first

from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim.rig.process import RigProcess
from hapticd.tools.daemon_process import DaemonProcess
from hapticd_client import Circle, Client, Grating, Modulation

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
SIZE_MM = 137.5


class Drawn:
    """A page, and another client of the same service."""

    def __init__(self, page: Page, client: Client) -> None:
        self.page = page
        self.client = client

    def layers(self) -> dict[str, dict[str, Any]]:
        """The surfaces in force by name."""
        return {one["name"]: one for one in self.client.surfaces()}

    def stroke(self, *places_mm: tuple[float, float]) -> None:
        """Press the pointer at the first place, move it to the others, and release it."""
        plate = self.page["plate"]
        actions = ActionChains(self.page.browser, duration=50)
        for number, (x_mm, y_mm) in enumerate(places_mm):
            scale = plate.size["width"] / SIZE_MM
            actions.move_to_element_with_offset(plate, round(x_mm * scale), round(-y_mm * scale))
            if number == 0:
                actions.click_and_hold()
        actions.release().perform()

    def use(self, tool: str) -> None:
        self.page.browser.find_element(By.CSS_SELECTOR, f"[data-tool={tool}]").click()


@pytest.fixture
def drawn(browser: Chrome, tmp_path: Path) -> Iterator[Drawn]:
    with RigProcess("hands", 1) as rig, DaemonProcess(f'rig_dir = "{rig.directory}"') as running:
        for process in (rig.process, running.process):
            first(process)
        with Client(running.runtime_dir, name="study", timeout_s=PATIENCE_S) as client:
            viewer = View("--endpoint", str(running.runtime_dir), cwd=tmp_path)
            browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
            browser.get(viewer.address)
            page = Page(browser)
            page.until(lambda: "0 fingers" in page["state"].text)
            yield Drawn(page, client)
            browser.get("about:blank")
            assert viewer.end() == 0
            wait_for(lambda: list(Drawn(page, client).layers()) == ["patch"])  # the page's own ended with it


def test_layers_are_painted_drawn_dragged_and_removed(drawn: Drawn) -> None:
    page, dark = drawn.page, drawn.page.brightness()
    drawn.client.surface("patch", Circle(25.0), grating=Grating(12.0, 1.5), position_mm=(35.0, 35.0))
    page.until(lambda: page["surfaces"].text == "patch (study): grating 12 mm, up to 1.50 µm, z 0")
    page.until(lambda: page.brightness() > dark + 3)

    drawn.use("rectangle")
    drawn.stroke((-50.0, 40.0), (-30.0, 30.0), (-20.0, 20.0))
    page.until(lambda: "drawn 1" in drawn.layers())
    drawn.use("circle")
    drawn.stroke((-30.0, -30.0), (-20.0, -30.0))
    page.until(lambda: "drawn 2" in drawn.layers())
    drawn.use("polygon")
    for corner_mm in ((20.0, -20.0), (40.0, -20.0), (30.0, -45.0)):
        drawn.stroke(corner_mm)
    page["plate"].send_keys(Keys.ENTER)
    page.until(lambda: "drawn 3" in drawn.layers())
    layers = drawn.layers()
    assert layers["drawn 1"]["position_mm"] == pytest.approx([-35.0, 30.0], abs=0.5)
    assert layers["drawn 1"]["polygon_mm"][2] == pytest.approx([15.0, 10.0], abs=0.5)
    assert layers["drawn 2"]["circle_mm"] == pytest.approx(10.0, abs=0.5)
    assert len(layers["drawn 3"]["polygon_mm"]) == 3
    assert [layers[f"drawn {number}"]["friction"] for number in (1, 2, 3)] == [0.2] * 3

    drawn.use("move")
    page.until(lambda: "drawn 3" in page["surfaces"].text)
    drawn.stroke((-35.0, 30.0), (-20.0, 25.0), (-5.0, 10.0))
    drawn.stroke((35.0, 35.0), (0.0, 0.0))  # the other client's: not ours to move
    page.until(lambda: drawn.layers()["drawn 1"]["position_mm"] == pytest.approx([-5.0, 10.0], abs=0.5))
    assert drawn.layers()["patch"]["position_mm"] == [35.0, 35.0]

    drawn.stroke((-30.0, -30.0))
    page.until(lambda: page["erase"].is_enabled())
    page["erase"].click()
    page.until(lambda: "drawn 2" not in drawn.layers())

    drawn.use("touch")
    assert page["new"].get_attribute("value") == "nothing"  # since something lies there to feel
    drag(page, 10)
    page.until(lambda: any(re.search(r"feels \d\.\d\d \(.*\), asked", row) for row in page.fingers()))
    assert "no owner" in page.fingers()[0]  # it feels what lies there
    finger = next(iter(drawn.client.fingers()))
    drawn.client.effect("hum", Modulation(20.0), on=finger)
    page.until(lambda: "hum (study) plays" in page["surfaces"].text)
    drawn.client.stop("hum")
    page.until(lambda: "hum" not in page["surfaces"].text)
    ActionChains(page.browser).release().perform()
    page.until(lambda: page["untouched"].is_displayed())
    page.choose("new", "slippery")
    lay_down(page, 100, 80)
    page.until(lambda: any("of 0.46" in row and "ours" in row for row in page.fingers()))

    page["plate"].send_keys(Keys.ESCAPE)
    assert page.complaints() == []


def test_a_layer_has_a_texture_a_picture_or_an_effect(drawn: Drawn, tmp_path: Path) -> None:
    page = drawn.page
    drawn.client.surface("patch", Circle(5.0), friction=0.5, position_mm=(60.0, 60.0))  # as the other test leaves it
    drawn.use("rectangle")
    page.choose("content", "texture")
    drawn.stroke((-60.0, 60.0), (-50.0, 50.0), (-40.0, 40.0))
    page.until(lambda: "drawn 1" in drawn.layers())
    assert drawn.layers()["drawn 1"]["grating"]["period_mm"] == 6.0

    image = tmp_path / "white.png"
    Image.new("L", (60, 40), 255).save(image)
    page["file-input"].send_keys(str(image))
    page.choose("content", "picture")
    page.until(lambda: page["file"].text == "white.png")
    drawn.stroke((-60.0, 0.0), (-50.0, -10.0), (-40.0, -20.0))
    page.until(lambda: "drawn 2" in drawn.layers())
    assert drawn.layers()["drawn 2"]["map"]["high_um"] == 1.5

    page.choose("content", "hum")
    drawn.stroke((-30.0, 30.0), (0.0, 0.0), (40.0, -40.0))
    page.until(lambda: "drawn 3" in drawn.layers())
    drawn.use("touch")
    drag(page, 10)
    page.until(lambda: re.search(r"drawn 3 \(view-\w+\) plays on finger", page["surfaces"].text))
    page["plate"].send_keys(Keys.ESCAPE)
    ActionChains(page.browser).release().perform()
    assert page.complaints() == []


def test_the_record_button_writes_a_recording_where_the_viewer_runs(drawn: Drawn, tmp_path: Path) -> None:
    page = drawn.page
    drawn.client.surface("patch", Circle(5.0), friction=0.5)
    page["record"].click()
    page.until(lambda: page["record"].get_attribute("aria-pressed") == "true")
    page.until(lambda: re.fullmatch(r"0:0[2-9]|0:[1-9]\d", page["record"].text.strip()))
    page["record"].click()
    page.until(lambda: page["notice"].text.startswith(f"{tmp_path}/plate-"))
    assert "mild" in page["notice"].get_attribute("class").split()  # it is news, no alarm
    assert "It began while the service ran" in page["notice"].text
    (file,) = tmp_path.glob("plate-*.mcap")
    records = {record.kind for record in open_recording(file).records()}
    assert "pass" in records
