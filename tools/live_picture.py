"""The picture of the live page in the documents: `python -m tools.live_picture docs/live.png`.

Needs Debian's `chromium` and `pip install playwright`.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import expect, sync_playwright

FLEET = [sys.executable, "-m", "fleet"]
AT_S, SIZE = r"^[67]\d\.", {"width": 1280, "height": 1180}


def main(picture: str) -> None:
    """Fly four_way under loss, and go to the middle of the encounter in its log."""
    with tempfile.TemporaryDirectory() as folder:
        log = str(Path(folder) / "four_way.mcap")
        flown = [*FLEET, "run", "four_way", "--loss", "20%", "--latency", "300ms", "--out", log]
        subprocess.run(flown, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 (ours)
        shown = [*FLEET, "live", log]
        server = subprocess.Popen(shown, stderr=subprocess.PIPE, text=True)  # noqa: S603 (ours)
        assert server.stderr is not None
        address = re.search(r"http://\S+", server.stderr.readline())
        assert address is not None
        with sync_playwright() as playwright:
            command = shutil.which("chromium")
            browser = playwright.chromium.launch(executable_path=command, args=["--no-sandbox"])
            page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type, unused-ignore]
            page.goto(address[0])
            state = page.locator("#state")
            expect(state).to_contain_text(" of ")
            page.locator("#when").fill("10")
            page.locator("#speed").select_option("20")
            expect(state).to_contain_text(re.compile(AT_S), timeout=30_000)
            page.locator("#pause").click()
            expect(state).to_contain_text("paused")
            page.screenshot(path=picture)
            browser.close()
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main(sys.argv[1])
