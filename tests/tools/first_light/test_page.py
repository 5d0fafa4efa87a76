"""First light in the browser without one: presses, questions, stops, and who may come in."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from hapticd.__main__ import main
from hapticd.board_values import BoardState
from hapticd.design.commissioning.findings import Diagnosis, Judgement
from hapticd.errors import CalibrationError
from hapticd.sim.commissioning.rig import FaultyRig
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.virtual_time import in_virtual_time
from hapticd.tools.first_light import commission, measure, server
from hapticd.tools.first_light.bench import Bench
from hapticd.tools.first_light.front import Front
from hapticd.tools.first_light.page_front import PageFront, Press
from hapticd.tools.first_light.person import SUPPLIES, AtTheBench
from hapticd.tools.first_light.shown import ShownTechnician
from hapticd.tools.first_light.state import Commissioning
from hapticd.tools.first_light.step import PageResult, StepPage
from hapticd.tools.first_light.walk import STEPS
from hapticd.tools.web.serving import bound

SOUND = PageResult(Judgement("All is well.", (), (("sensor 0", "1.65 V"),)), "a chart")


def test_a_page_that_a_shell_started_behind_an_ampersand_ends_by_sigterm(tmp_path: Path) -> None:
    """Such a shell has its children ignore SIGINT."""
    command = [sys.executable, "-m", "hapticd", "first-light", "--sim", "--view", "--page-port", "0", "--no-browser"]
    behind = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *command, "--out", str(tmp_path)]
    with subprocess.Popen(behind, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "http://" in process.stdout.readline()
        process.terminate()
        try:
            assert process.wait(60.0) == 130
        finally:
            process.kill()


class Documents(list[dict[str, Any]]):
    """What a page was sent; `front` gets the presses on the newest."""

    front: PageFront
    pressed = 0  # documents before the last press

    def __init__(self) -> None:
        super().__init__()
        self.came = asyncio.Event()

    def publish(self, text: str) -> None:
        self.append(json.loads(text))
        self.came.set()

    async def shows(self, button: str) -> None:
        """Wait for a document with this button after the one that was pressed last."""
        while self.pressed == len(self) or button not in self[-1]["buttons"]:
            self.came = asyncio.Event()
            await self.came.wait()

    async def press(self, button: str, text: str = "") -> None:
        """Press a button as soon as it is shown."""
        await self.shows(button)
        self.pressed = len(self)
        self.front.press(Press(self[-1]["number"], button, text))


def shown() -> Documents:
    page = Documents()
    page.front = PageFront(STEPS, {}, page.publish, is_simulated=False)
    return page


async def pressing(page: Documents, what: Coroutine[Any, Any, Any], *presses: tuple[str, ...]) -> Any:
    going = asyncio.ensure_future(what)
    for press in presses:
        await page.press(*press)
    return await going


def test_a_step_begins_by_its_press_alone_and_shows_what_the_terminal_shows() -> None:
    page = shown()
    asyncio.run(pressing(page, page.front.ready(STEPS[1]), ("begin",)))
    first, last = page[0], page[-1]
    assert (first["heading"], first["todo"], first["picture"]) == (
        f"2 of {len(STEPS)}: {STEPS[1].title}",
        STEPS[1].todo,
        STEPS[1].picture,
    )
    assert (first["isRunning"], list(first["buttons"])) == (False, ["begin"])
    assert (last["isRunning"], list(last["buttons"])) == (True, ["stop"])


def test_a_second_click_and_a_button_that_is_not_shown_do_nothing() -> None:
    page = shown()

    async def clicks() -> None:
        going = asyncio.ensure_future(page.front.ready(STEPS[0]))
        await asyncio.sleep(0)
        number = page[-1]["number"]
        for press in (Press(number - 1, "begin"), Press(number, "next"), Press(0), Press(number, "begin")):
            assert not going.done()
            page.front.press(press)
        page.front.press(Press(number, "begin"))
        await going
        page.front.press(Press(page[-1]["number"], "begin"))

    asyncio.run(clicks())


@pytest.mark.parametrize(("button", "is_again"), [("next", False), ("repeat", True)])
def test_after_a_pass_one_goes_on_or_measures_again(button: str, is_again: bool) -> None:
    page = shown()
    assert asyncio.run(pressing(page, page.front.ended(STEPS[0], SOUND), (button,))) is is_again
    assert page[0]["result"] == {
        "passed": True,
        "sentences": ["All is well."],
        "figures": [["sensor 0", "1.65 V"]],
        "chart": "a chart",
    }


def test_the_last_step_is_finished() -> None:
    page = shown()
    asyncio.run(pressing(page, page.front.ready(STEPS[-1]), ("begin",)))
    assert asyncio.run(pressing(page, page.front.ended(STEPS[-1], SOUND), ("finish",))) is False


def test_what_failed_is_mended_at_the_same_page() -> None:
    page = shown()
    person = AtTheBench(page.front)
    failed = PageResult(Judgement("", (Diagnosis("Sensor 0 is off."), Diagnosis("So is 1."))))

    async def fails() -> bool:
        assert await page.front.ended(STEPS[0], failed) is False
        return await person.mend(failed.judgement.findings)

    assert asyncio.run(pressing(page, fails(), ("done",))) is True
    assert page[0]["result"]["sentences"] == ["Sensor 0 is off.", "So is 1."]
    assert page[0]["question"] == "Mend it with the amplifiers' supply off to measure again."


def test_readings_are_typed_and_nonsense_is_asked_for_again() -> None:
    page = shown()
    person = AtTheBench(page.front)
    assert asyncio.run(pressing(page, person.read_supply(0), ("enter", "abc"), ("enter", "3,31"))) == 3.31
    assert page[-1]["notes"] == ["'abc' is no number of volts, such as 1.65."]
    assert page[0]["question"] == f"{SUPPLIES[0]}, V"
    assert asyncio.run(pressing(page, person.read_supply(0), ("none", "3.3"))) is None
    assert asyncio.run(pressing(page, person.read_supply(0), ("enter", " "))) is None


# --- stopped -------------------------------------------------------------------------------------------------------


class AtTheScope(ShownTechnician):
    """Reads an output for ever."""

    has_begun: asyncio.Event

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        del amplifier, asked_v
        self.has_begun.set()
        await asyncio.sleep(3600.0)
        return None


@asynccontextmanager
async def running(what: Coroutine[Any, Any, Any]) -> AsyncIterator[None]:
    task = asyncio.ensure_future(what)
    yield
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


@pytest.mark.long
@pytest.mark.parametrize("is_pressed", [True, False], ids=["stop", "closed"])
def test_a_stop_and_a_closed_page_end_in_silence_and_the_step_begins_again(tmp_path: Path, is_pressed: bool) -> None:
    rig = FaultyRig(PlateSettings.of("reference"), (), 1)
    names = [step.name for step in STEPS]
    state = Commissioning(True, dict.fromkeys(names[: names.index("answers")], "Right."))
    benches: list[Bench] = []

    async def stops() -> tuple[dict[str, Any], BoardState]:
        page, has_begun = Documents(), asyncio.Event()
        walking = commission.PageCommissioning(commission.Kept(state, tmp_path), asyncio.get_running_loop())

        def new_bench(front: Front) -> Bench:
            assert isinstance(front, PageFront)
            page.front = front
            technician = AtTheScope(rig, 1, front, lambda _: None)
            technician.has_begun = has_begun
            benches.append(Bench(technician, technician.new_link, "the rig", tmp_path, True))
            return benches[0]

        async with running(walking.run(new_bench, page.publish)):
            await page.press("begin")
            await has_begun.wait()  # an output is read while its amplifier has a volt
            if is_pressed:
                walking.on_press(Press(0, "stop"))
            else:
                walking.on_gone()
            await page.shows("begin")
        async with benches[0].board() as board:
            return page[-1], (await measure.status(board)).state

    asked, after = in_virtual_time(stops())
    assert after is BoardState.QUIET
    assert asked["notes"] == [commission.STOPPED if is_pressed else commission.GONE]
    assert asked["heading"].startswith("3 of")


def test_a_step_that_breaks_is_shown_again_with_its_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tries: list[int] = []

    async def breaks_once(bench: Bench) -> PageResult:
        del bench
        tries.append(1)
        if len(tries) == 1:
            raise CalibrationError("There is no scan.")
        return SOUND

    step = StepPage("supply", "Supply", "Look.", "", breaks_once)
    monkeypatch.setattr(commission, "STEPS", (step,))

    async def walks() -> Documents:
        page = Documents()
        walking = commission.PageCommissioning(
            commission.Kept(Commissioning(False), tmp_path), asyncio.get_running_loop()
        )

        def new_bench(front: Front) -> Bench:
            assert isinstance(front, PageFront)
            page.front = front
            return Bench(AtTheBench(front), None, "nowhere", tmp_path, False)  # type: ignore[arg-type]

        await pressing(page, walking.run(new_bench, page.publish), ("begin",), ("begin",), ("finish",))
        return page

    page = asyncio.run(walks())
    assert ["There is no scan."] in [one["notes"] for one in page]
    assert page[-1]["isOver"]
    assert page[-1]["notes"][-1].startswith("All steps have passed: hapticd run --config ")


# --- the server ----------------------------------------------------------------------------------------------------


class Served:
    """A page's server; `gone` is set once a page is gone."""

    def __init__(self) -> None:
        self.presses: list[Press] = []
        self.gone = threading.Event()
        self.server = server.PageServer(bound("127.0.0.1", 0), self.presses.append, self.gone.set)
        self.base, _, self.key = self.server.address.partition("/?key=")

    def run(self, what: Callable[[aiohttp.ClientSession], Coroutine[Any, Any, Any]]) -> Any:
        async def session() -> Any:
            async with aiohttp.ClientSession(self.base) as client:
                return await what(client)

        with self.server:
            return asyncio.run(session())

    def page(self, client: aiohttp.ClientSession, key: str | None = None, **headers: str) -> Any:
        return client.ws_connect(
            f"/socket?key={self.key if key is None else key}", headers={"Origin": self.base} | headers
        )


def test_a_page_gets_the_newest_document_and_sends_presses() -> None:
    served = Served()

    async def press(client: aiohttp.ClientSession) -> list[str]:
        served.server.publish("old")
        served.server.publish("new")
        async with served.page(client) as page:
            texts = [await page.receive_str()]
            for text in ("[" * 200, "{}", '{"button": 3}', '{"number": 7, "button": "begin"}'):
                await page.send_str(text)
            while not served.presses:
                await asyncio.sleep(0)
            served.server.publish("newest")
            texts.append(await page.receive_str())
        return texts

    assert served.run(press) == ["new", "newest"]
    assert served.presses == [Press(7, "begin")]
    assert served.gone.is_set()


def test_a_second_window_is_refused_with_its_reason() -> None:
    served = Served()

    async def twice(client: aiohttp.ClientSession) -> tuple[Any, bool]:
        async with served.page(client) as first, served.page(client) as second:
            message = await second.receive()
            return message.extra, first.closed

    assert served.run(twice) == (server.BUSY, False)


def test_a_page_that_is_silent_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "ALIVE_WITHIN_S", 0.01)
    served = Served()

    async def silent(client: aiohttp.ClientSession) -> bool:
        async with served.page(client) as page:
            await page.receive()
            return bool(page.closed)

    assert served.run(silent)
    assert served.gone.is_set()


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/?key={key}", {}, 200),
        ("/base.css", {}, 200),
        ("/first_light.js", {}, 200),
        ("/first_light.py", {}, 404),
        ("/", {}, 403),
        ("/?key=wrong", {}, 403),
        ("/?key={key}", {"Host": "evil.example"}, 403),
        ("/socket?key={key}", {}, 403),
        ("/socket?key={key}", {"Origin": "http://evil.example"}, 403),
    ],
)
def test_only_the_page_that_was_printed_comes_in(path: str, headers: dict[str, str], status: int) -> None:
    served = Served()

    async def asked(client: aiohttp.ClientSession) -> tuple[int, bool]:
        async with client.get(path.format(key=served.key), headers=headers) as response:
            return response.status, "Content-Security-Policy" in response.headers

    assert served.run(asked) == (status, True)
    assert not served.gone.is_set()


# --- the command ---------------------------------------------------------------------------------------------------


def test_view_and_many_rigs_do_not_go_together(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["first-light", "--sim", "--rigs", "2", "--view"]) == 2
    assert "--rigs commissions by itself" in capsys.readouterr().err
