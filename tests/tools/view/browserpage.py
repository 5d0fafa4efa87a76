"""The plate's page in a browser: its elements, and what a person does there."""

from __future__ import annotations

from collections.abc import Callable

from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver import ActionChains, Chrome, Keys
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select, WebDriverWait

PATIENCE_S = 60.0


class Page:
    """Elements and actions of the page."""

    def __init__(self, browser: Chrome) -> None:
        self.browser = browser

    def __getitem__(self, name: str) -> WebElement:
        return self.browser.find_element(By.ID, name)

    def until(self, condition: Callable[[], object]) -> None:
        WebDriverWait(self.browser, PATIENCE_S, poll_frequency=0.05).until(lambda _: condition())

    def choose(self, menu: str, text: str) -> None:
        """Choose from a menu, which the page rebuilds for another plate."""

        def is_chosen() -> bool:
            try:
                Select(self[menu]).select_by_visible_text(text)
            except StaleElementReferenceException:
                return False
            return True

        self.until(is_chosen)

    def fingers(self) -> list[str]:
        """The text of each row."""
        return list(
            self.browser.execute_script("return [...document.querySelectorAll('.finger')].map((row) => row.innerText)")
        )

    def picture(self) -> str:
        return str(self.browser.execute_script("return document.getElementById('plate').toDataURL()"))

    def brightness(self) -> float:
        """Of the plate's picture on average: a still plate is dark."""
        return self.average("green")

    def average(self, of_pixel: str, of: str = "plate") -> float:
        return float(
            self.browser.execute_script(
                f"const plate = document.getElementById('{of}');"
                "const { data } = plate.getContext('2d').getImageData(0, 0, plate.width, plate.height);"
                "let sum = 0;"
                "for (let i = 0; i < data.length; i += 4) {"
                f"  const [red, green, blue] = data.subarray(i, i + 3); sum += {of_pixel};"
                "}"
                "return sum / data.length * 4"
            )
        )

    def complaints(self) -> list[str]:
        return [entry["message"] for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE"]

    def press_until(self, key: str, text: str) -> None:
        """Press a key until a finger's row shows the text: on a stalled host the finger may have changed."""

        def pressed() -> bool:
            self.keys(key)
            return any(text in row for row in self.fingers())

        self.until(pressed)

    def keys(self, *keys: str) -> None:
        for key in keys:
            ActionChains(self.browser).send_keys(key).perform()


def drag(page: Page, steps: int) -> None:
    """The mouse goes down left of the plate's centre and moves to the right; there it stays down."""
    moves = ActionChains(page.browser, duration=16).move_to_element_with_offset(page["plate"], -120, -30)
    moves.click_and_hold()
    for step in range(steps):
        moves.move_by_offset(4, step % 2)
    moves.perform()


def lay_down(page: Page, right: int, down: int) -> None:
    """A finger that stays there, so many pixels from the plate's centre."""
    hold = ActionChains(page.browser).key_down(Keys.SHIFT).move_to_element_with_offset(page["plate"], right, down)
    hold.click().key_up(Keys.SHIFT).perform()
