"""Whoever ends is noticed by all, in one line, while they do something else."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from tests.conftest import REPOSITORY
from urbanjax.io.runs.line import SIGNALS, ProcessLine
from urbanjax.io.runs.meeting import Wire
from urbanjax.types import ProcessError

LONG = 30.0  # s, that nobody waits for


@pytest.fixture
def others():
    """The far ends of wires to processes 1 and 2, and the near ones by number."""
    pairs = [socket.socketpair() for _ in range(2)]
    far, near = zip(*((Wire(one), Wire(two)) for one, two in pairs), strict=True)
    yield far, {1: near[0], 2: near[1]}
    for wire in (*far, *near):
        wire.close()


def ends(line, wires, act):
    """What is raised while the line is watched and something is done to it in another thread."""
    before = [signal.getsignal(number) for number in SIGNALS]
    threading.Timer(0.1, act).start()
    with pytest.raises(ProcessError) as raised, line.signals(), line.watched(wires):
        time.sleep(LONG)
    assert [signal.getsignal(number) for number in SIGNALS] == before
    return str(raised.value)


def test_who_ends_without_a_word_ends_all(others):
    far, near = others
    line = ProcessLine(0)
    line.remedy = "see there"
    began = time.monotonic()
    assert ends(line, near, far[0].close) == "process 1 has ended without a word: see there"
    assert time.monotonic() - began < LONG / 2
    assert far[1].first(1.0) == ("lost", "process 1 has ended without a word")
    with pytest.raises(ProcessError, match="process 1 has ended without a word: see there"):
        line.check()


def test_who_says_why_is_quoted(others):
    far, near = others
    why = "process 1 has failed: ConfigError: why"
    assert ends(ProcessLine(0), near, lambda: far[0].send("lost", why)) == f"{why}: start all processes again"


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_it_in_one_line_and_the_others_are_told(others, number):
    far, near = others
    reason = f"process 0 was told to end ({number.name})"
    assert ends(ProcessLine(0), near, lambda: os.kill(os.getpid(), number)) == f"{reason}: start all processes again"
    assert [wire.first(1.0) for wire in far] == [("lost", reason)] * 2


def test_what_fails_here_is_told(others):
    far, near = others
    line = ProcessLine(0)
    with pytest.raises(ZeroDivisionError), line.signals(), line.watched(near):
        raise ZeroDivisionError("by\nnought")
    assert [wire.first(1.0) for wire in far] == [("lost", "process 0 has failed: ZeroDivisionError: by nought")] * 2
    assert not line.reason
    line.check()


def test_it_is_done_when_all_are(others):
    far, near = others
    line, times = ProcessLine(0), []

    def act():
        far[0].send("done")
        far[0].close()  # has done what it had to
        far[1].send("told", "begun")
        time.sleep(0.5)
        times.append(time.monotonic())
        far[1].send("done")

    threading.Timer(0.1, act).start()
    with line.signals(), line.watched(near):
        assert line.hear() == "begun"
        line.tell("go")
    assert time.monotonic() >= times[0]
    said = far[1].receive(1.0)
    assert said == [("told", "go"), ("done", "")]
    assert not line.reason


def test_what_cannot_be_interrupted_is_ended():
    """Blocked signals stand for a program of XLA, from which the main thread does not come back."""
    code = f"""
import signal, socket, time
from urbanjax.io.runs import line, meeting
far, near = socket.socketpair()
one = line.ProcessLine(1)
one.limit, one.remedy = 0.5, "see there"
with one.signals(), one.watched({{0: meeting.Wire(near)}}):
    signal.pthread_sigmask(signal.SIG_BLOCK, line.SIGNALS)
    far.close()
    time.sleep({LONG})
"""
    began = time.monotonic()
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, timeout=LONG)
    assert time.monotonic() - began < LONG / 2
    assert ended.returncode == 2
    assert ended.stderr == "error: process 0 has ended without a word: see there\n"
