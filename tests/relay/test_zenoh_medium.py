"""How a relay asks over zenoh: somebody, nobody, two at once, and what is no answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event

import pytest

from fleet.errors import ProgramError
from fleet.protocol.topics import step_of
from fleet.relay.medium import LONGEST_ANSWER_BYTES, AnswerLimits
from fleet.relay.questions import LastQuestion, StepQuestion
from fleet.relay.zenoh_medium import ZenohMedium
from fleet.transport.zenoh_bus import Bus, open_client_bus, open_router_bus
from tests.support.samples import pack, unpack

STEP = StepQuestion(3, 300, True, (1,), ())
SOON = AnswerLimits(5.0)
Answer = Callable[[bytes], bytes]


class Scene:
    """A router, a relay's bus, and as many programs as a test wants."""

    def __init__(self, folder: Path) -> None:
        self._endpoint = f"unixsock-stream/{folder / 'bus.sock'}"
        self._router, _ = open_router_bus("run", "sim", self._endpoint)
        self.relay = open_client_bus("run", "2", self._endpoint)
        self._programs: list[Bus] = []

    def program(self, answer: Answer) -> Bus:
        """One that answers so."""
        bus = open_client_bus("run", f"program {len(self._programs)}", self._endpoint)
        bus.answer(step_of("2"), lambda payload, reply: reply(answer(payload)))
        self._programs.append(bus)
        return bus

    def close(self) -> None:
        for bus in (*self._programs, self.relay, self._router):
            bus.close()


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    made = Scene(tmp_path)
    yield made
    made.close()


def begun(scene: Scene) -> ZenohMedium:
    medium = ZenohMedium()
    medium.begin(scene.relay, STEP, 5.0)
    return medium


def test_a_question_comes_as_it_is_and_the_answer_of_built_in_types(scene: Scene) -> None:
    asked = []

    def answer(payload: bytes) -> bytes:
        asked.append(unpack(payload))
        return pack([["truth", {"speed_mps": 1.5}]])

    scene.program(answer)
    medium = begun(scene)
    assert medium.ask(STEP, SOON) == [["truth", {"speed_mps": 1.5}]]
    told = {"tick": 3, "t_ns": 300, "broadcast": True, "present": [1], "inbox": []}
    assert asked == [told, told]
    medium.end(LastQuestion())
    assert asked[2:] == [{"stop": True}]


def test_who_comes_later_is_waited_for(scene: Scene, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ProgramError, match=r"no program answers at fleet/run/2/step within 0.1 s"):
        ZenohMedium().begin(scene.relay, STEP, 0.1)
    assert capsys.readouterr().err == "fleet: UAV 2 waits for its program at fleet/run/2/step\n"


def test_two_programs_are_one_too_many(scene: Scene) -> None:
    for _ in range(2):
        scene.program(lambda _: pack([]))

    def asked_until_both_are_known() -> None:
        medium = begun(scene)
        for _ in range(10_000):
            medium.ask(STEP, SOON)

    with pytest.raises(ProgramError, match="its program is there more than once; end all but one"):
        asked_until_both_are_known()


def test_one_that_has_gone_is_told_from_one_that_is_silent(scene: Scene) -> None:
    silent = Event()
    asked: list[bytes] = []

    def answer(payload: bytes) -> bytes:
        asked.append(payload)
        if asked[1:]:
            silent.wait(20.0)
        return pack([])

    program = scene.program(answer)
    medium = begun(scene)
    try:
        with pytest.raises(ProgramError, match=r"its program has not answered for 0.2 s"):
            medium.ask(STEP, AnswerLimits(0.2))
    finally:
        silent.set()
    program.close()
    with pytest.raises(ProgramError, match="its program has gone: nobody answers at fleet/run/2"):
        medium.ask(STEP, SOON)


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"\xc1", "what its program answers is no MessagePack"),
        (b"", "what its program answers is no MessagePack"),
        (pack("x" * LONGEST_ANSWER_BYTES), "its program answers more than 1048576 bytes at once"),
    ],
)
def test_what_is_no_answer_is_named(payload: bytes, why: str, scene: Scene) -> None:
    answers = [pack([]), payload]
    scene.program(lambda _: answers.pop(0))
    with pytest.raises(ProgramError, match=why):
        begun(scene).ask(STEP, SOON)
