"""Draw a log of two or more UAVs as SVG: `python -m tools.picture LOG SVG`."""

from __future__ import annotations

import sys
from pathlib import Path

from tools.picture.plots import picture
from tools.picture.run import pictured_run

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m tools.picture LOG SVG")
    Path(sys.argv[2]).write_text(picture(pictured_run(Path(sys.argv[1]))), encoding="utf-8")
