"""Ctrl-C ends a run between two records, never inside one."""

from __future__ import annotations

import signal

import pytest

from fleet.run.interrupts import Interrupts


def test_a_signal_outside_interrupts_at_once() -> None:
    interrupts = Interrupts()
    interrupts.install()
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    finally:
        interrupts.restore()


def test_a_signal_inside_waits_for_the_end_of_the_section() -> None:
    interrupts, done = Interrupts(), []
    interrupts.install()
    try:
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012, SIM117 (the section is tested)
            with interrupts:
                signal.raise_signal(signal.SIGINT)
                done.append("whole")
        with interrupts:
            done.append("next")
    finally:
        interrupts.restore()
    assert done == ["whole", "next"]


def test_signals_are_given_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    interrupts = Interrupts()
    interrupts.install()
    assert signal.getsignal(signal.SIGTERM) != before
    interrupts.restore()
    assert signal.getsignal(signal.SIGTERM) == before
