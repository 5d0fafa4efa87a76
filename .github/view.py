"""Makes view.png of the README of `hapticd view`: a simulated plate after half a minute of two fingers.

    python .github/view.py .github/view.png

The wide plate with eight modes, fingers that move as recorded hands do. Needs chromium and chromedriver.
"""

from __future__ import annotations

import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from chromium import CHROMIUM, DRIVER, FLAGS

SIZE = (1280, 800)
STRIP_S = 36.0  # the strip's 30 s, and the fingers' begin
STEP_S = 0.5
COLOURS = 256
# The first finger is to slip, the second to stick; a finger that lands anew has no target.
ASK = """
for (const [place, row] of [...document.querySelectorAll('.finger')].entries())
  if (row.innerText.includes('no target')) row.querySelectorAll('.choices button')[place % 2 ? 0 : 1].click();
"""
VIEW = ("view", "--sim", "--plate", "wide", "--scenario", "strokes", "--no-browser", "--port", "0")


def main(out: Path) -> None:
    """Write the picture."""
    with subprocess.Popen([sys.executable, "-m", "hapticd", *VIEW], stdout=subprocess.PIPE, text=True) as view:
        try:
            assert view.stdout is not None
            picture = screenshot(view.stdout.readline().partition(": ")[2].strip())
        finally:
            view.terminate()
    Image.open(BytesIO(picture)).convert("RGB").quantize(
        COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    ).save(out, optimize=True)


def screenshot(address: str) -> bytes:
    """Return the page as a PNG."""
    if CHROMIUM is None or DRIVER is None:
        raise SystemExit("view.png needs chromium and chromedriver: install chromium and chromium-driver.")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in FLAGS:
        options.add_argument(flag)
    browser = webdriver.Chrome(options=options, service=Service(DRIVER, log_output=subprocess.DEVNULL))
    try:
        metrics = {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        browser.get(address)
        while not browser.execute_script("return document.querySelectorAll('.finger').length"):
            time.sleep(0.1)
        for _ in range(round(STRIP_S / STEP_S)):
            browser.execute_script(ASK)
            time.sleep(STEP_S)
        return browser.get_screenshot_as_png()
    finally:
        browser.quit()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
