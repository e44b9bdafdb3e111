"""The live page, open in Chromium: what it draws, says, asks for and complains of."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest

from fleet.live.view import ViewData

playwright = pytest.importorskip("playwright.sync_api", reason="needs: pip install playwright")
WAIT_MS = 30_000
NOTED_LINES = """
window.lines = {};
window.words = {};
window.bends = {};
let bends = 0;
const begin = CanvasRenderingContext2D.prototype.beginPath;
const on = CanvasRenderingContext2D.prototype.lineTo;
const write = CanvasRenderingContext2D.prototype.fillText;
const stroke = CanvasRenderingContext2D.prototype.stroke;
const clear = CanvasRenderingContext2D.prototype.clearRect;
CanvasRenderingContext2D.prototype.clearRect = function (...where) {
    window.lines[this.canvas.parentElement.id] = [];
    window.words[this.canvas.parentElement.id] = [];
    window.bends[this.canvas.parentElement.id] = [];
    clear.apply(this, where);
};
CanvasRenderingContext2D.prototype.beginPath = function () {
    bends = 0;
    begin.apply(this);
};
CanvasRenderingContext2D.prototype.lineTo = function (...where) {
    bends += 1;
    on.apply(this, where);
};
CanvasRenderingContext2D.prototype.stroke = function () {
    const look = `${this.getLineDash()} ${this.strokeStyle}`;
    window.lines[this.canvas.parentElement.id].push(look);
    window.bends[this.canvas.parentElement.id].push([look, bends]);
    stroke.apply(this);
};
CanvasRenderingContext2D.prototype.fillText = function (text, ...where) {
    const plain = text.replace("\\u2013", "-");
    window.words[this.canvas.parentElement.id].push([plain, this.fillStyle, where[1]]);
    write.call(this, text, ...where);
};
"""
"""How each line was drawn, of how many parts, and each text, of what a canvas shows now."""


class Opened:
    """The page of a run, and all that it asked for and complained of."""

    def __init__(
        self, browser: Any, address: str, size: tuple[int, int], told: Sequence[ViewData] = ()
    ) -> None:
        """`told`: what the page is told, if not what its server would tell."""
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.asked: list[str] = []
        self.problems: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("console", lambda message: self.problems.append(message.text))
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.add_init_script(NOTED_LINES)
        if told:
            messages = [json.dumps(message) for message in told]
            self.page.route_web_socket(
                "**/live", lambda socket: [socket.send(message) for message in messages]
            )
        self.page.goto(address)

    def shows(self, where: str, words: str) -> None:
        """Wait until something says so."""
        playwright.expect(self.page.locator(where)).to_contain_text(words, timeout=WAIT_MS)

    def drawn(self, where: str) -> int:
        """How many pixels of a canvas are not empty."""
        script = """(canvas) => {
            const pen = canvas.getContext("2d");
            const pixels = pen.getImageData(0, 0, canvas.width, canvas.height).data;
            let count = 0;
            for (let k = 3; k < pixels.length; k += 4) count += pixels[k] > 0;
            return count;
        }"""
        return int(self.page.locator(f"{where} canvas").evaluate(script))

    def drawn_round(self, box: tuple[float, float, float, float]) -> None:
        """Drag over the plan view with Shift, from corner to corner in parts of its size."""
        canvas = self.page.locator("#plan canvas").bounding_box()
        left, top, right, bottom = box
        mouse, (x, y, w, h) = self.page.mouse, (canvas[k] for k in ("x", "y", "width", "height"))
        self.page.keyboard.down("Shift")
        mouse.move(x + left * w, y + top * h)
        mouse.down()
        mouse.move(x + right * w, y + bottom * h)
        mouse.up()
        self.page.keyboard.up("Shift")

    def lines(self, where: str, look: str) -> int:
        """How many lines of a look a canvas shows."""
        return int(self.page.evaluate(f"lines.{where}.filter((line) => line === '{look}').length"))

    def parts(self, where: str, look: str) -> list[int]:
        """Of how many parts each line of a look is, on what a canvas shows."""
        drawn = self.page.evaluate(f"bends.{where}")
        return [count for its, count in drawn if its == look]
