"""Takes docs/session.png, the page of a sample session: `python docs/make_picture.py` (playwright and Chromium)."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
SESSION = ROOT / "sample_data" / "pmdi_press_late.csv.gz"
PICTURE = ROOT / "docs" / "session.png"

with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
    page_file = Path(folder) / "session.html"
    command = [sys.executable, "-m", "inhalemon", "report", SESSION, "--out", page_file]
    subprocess.run(command, cwd=ROOT, check=True)
    chromium = playwright.chromium.launch(
        executable_path=shutil.which("chromium"),
        args=["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"],
    )
    page = chromium.new_page(viewport={"width": 1200, "height": 1000}, color_scheme="light")
    page.goto(page_file.as_uri())
    page.screenshot(path=PICTURE)
    chromium.close()
