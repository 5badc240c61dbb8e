"""Settings of all tests, and the browser that pages are tried in."""

from __future__ import annotations

import shutil

import pytest
from hypothesis import settings

# Examples have no time limit, for the machine may be busy.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(scope="module")
def browser():
    """Chromium; tests are skipped where there is none on the path."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium on the path")
    driver = pytest.importorskip("playwright.sync_api")
    with driver.sync_playwright() as running:
        started = running.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield started
        started.close()
