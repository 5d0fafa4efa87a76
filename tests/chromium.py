"""A real Chromium without a screen, for the tests of pages."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)


@pytest.fixture(scope="module")
def browser(chromium: webdriver.Chrome) -> Iterator[webdriver.Chrome]:
    yield chromium
    chromium.get("about:blank")  # a page that stays paints on, and takes half a core from all tests that follow


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    """Chromium with a profile and temporary files of its own, which it keeps while tests come and go."""
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("chromium and chromium-driver are not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    own = tmp_path_factory.mktemp("chromium")
    small = "--force-device-scale-factor=0.5"  # without a GPU painting takes most of the time, by the pixel
    for flag in (*FLAGS, f"--user-data-dir={own}/profile", "--window-size=1280,1200", small):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    service = Service(DRIVER, log_output=subprocess.DEVNULL, env={**os.environ, "TMPDIR": str(own)})
    driver = webdriver.Chrome(options=options, service=service)
    yield driver
    driver.quit()
