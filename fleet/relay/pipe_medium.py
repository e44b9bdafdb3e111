"""A relay asks over a pipe: it starts the program; a line of JSON each way, on standard streams."""

from __future__ import annotations

import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress

import msgspec

from fleet.errors import ProgramError
from fleet.relay import tied_program
from fleet.relay.medium import LONGEST_ANSWER_BYTES, STOP_S, TOO_LONG, AnswerLimits
from fleet.relay.questions import RelayQuestion
from fleet.transport.zenoh_bus import Bus

LINE_SHOWN = 60
LAST_WORDS_S = 0.5
"""What a program has said before its end may take so long to be read."""


class PipeMedium:
    """The program leads a process group of its own, which is gone when the relay is."""

    def __init__(self, program: Sequence[str]) -> None:
        self._program = program
        self._name = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._ending = False
        self._questions: queue.Queue[bytes | None] = queue.Queue()
        self._answers: queue.Queue[bytes] = queue.Queue()

    def begin(self, bus: Bus, question: RelayQuestion, wait_s: float) -> None:
        """Start the program, and ask the first question."""
        self._name = bus.name
        bus.before_leaving = self._leave
        if shutil.which(self._program[0]) is None:
            raise ProgramError(f"UAV {self._name}: there is no program '{self._program[0]}' here")
        self._process = subprocess.Popen(  # noqa: S603 (the user names it)
            [sys.executable, "-I", tied_program.__file__, str(os.getpid()), *self._program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        talking = threading.Thread(target=self._talk, args=(self._process,), daemon=True)
        talking.start()
        watched = self._process, talking
        threading.Thread(target=self._watch, args=watched, daemon=True).start()
        self.ask(question, AnswerLimits(wait_s))

    def ask(self, question: RelayQuestion, limits: AnswerLimits) -> object:
        """The next line, which is the answer."""
        self._questions.put(msgspec.json.encode(question))
        try:
            line = self._answers.get(timeout=limits.timeout_s)
        except queue.Empty as error:
            raise ProgramError(
                f"UAV {self._name}: its program has not answered for {limits.timeout_s:g} s"
            ) from error
        if not line and self._ending:
            threading.Event().wait()  # another thread ends the relay, and has said why
        if not line:
            raise ProgramError(f"UAV {self._name}: its program has gone: {self._death()}")
        if len(line) >= LONGEST_ANSWER_BYTES:
            raise ProgramError(f"UAV {self._name}: {TOO_LONG}")
        if not line.endswith(b"\n"):
            raise ProgramError(
                f"UAV {self._name}: its program has gone within an answer: {self._death()}"
            )
        try:
            return msgspec.json.decode(line)
        except (ValueError, RecursionError) as error:
            shown = line.decode(errors="replace").rstrip()[:LINE_SHOWN]
            raise ProgramError(
                f"UAV {self._name}: a line on the standard output of its program is no JSON "
                f"({error}): {shown}"
            ) from error

    def end(self, question: RelayQuestion) -> None:
        """Tell it to stop; who does not is killed."""
        process = self._process
        if process is None:
            return
        self._questions.put(msgspec.json.encode(question))
        self._questions.put(None)
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            sys.stderr.write(f"fleet: UAV {self._name}: its program did not end, and was killed\n")
        finally:
            self.kill()

    def abandon(self) -> None:
        """Kill it without a word."""
        self.kill()
        self._process = None

    def _leave(self) -> None:
        """The relay is being ended by another thread: its program goes first."""
        self._ending = True
        self.kill()

    def kill(self) -> None:
        """End the program, and what it has started in its group; returns when that is so."""
        process = self._process
        if process is None:
            return
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def _death(self) -> str:
        """How it ended."""
        assert self._process is not None
        try:
            code = self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            return "it has closed its standard output"
        return f"signal {-code}" if code < 0 else f"exit code {code}"

    def _watch(self, process: subprocess.Popen[bytes], talking: threading.Thread) -> None:
        """Tell of its end, also while what it has started keeps its standard output open."""
        process.wait()
        talking.join(LAST_WORDS_S)
        self._answers.put(b"")

    def _talk(self, process: subprocess.Popen[bytes]) -> None:
        """On a thread of its own, so that a program which takes nothing holds nobody up."""
        asked, told = process.stdin, process.stdout
        assert asked is not None
        assert told is not None
        line = b""
        while (question := self._questions.get()) is not None:
            try:
                asked.write(question + b"\n")
                asked.flush()
                line = told.readline(LONGEST_ANSWER_BYTES)
            except (OSError, ValueError):
                line = b""
            self._answers.put(line)
            if not line:
                return
        with suppress(OSError):
            asked.close()
