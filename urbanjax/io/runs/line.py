"""The line between processes that share a run: they tell how they end, and notice who has ended without a word."""

import contextlib
import os
import queue
import selectors
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from types import FrameType

from urbanjax.io.runs.meeting import Message, Wire
from urbanjax.types import ProcessError

TOLD, LOST, DONE = "told", "lost", "done"
PAUSE = 0.2  # s between two looks
LIMIT = 20.0  # s in which the main thread may end by itself: what is computed is written meanwhile
AT_ONCE = 1.0  # s, the same where nothing is computed yet
FAILED = 2  # exit code
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class ProcessLine:
    """This process' end of it. Process 0 has a wire to each of the others, and they have one to process 0.

    While it is `watched`, a signal and the end of another process raise an ProcessError in the main thread; where that
    thread does not come back from what it computes, the process ends within `LIMIT` seconds with the same line.
    """

    def __init__(self, process: int) -> None:
        """The line of a process, that nobody has come to yet."""
        self.process = process
        self.remedy = "start all processes again"  # the end of what is said, where the run cannot go on
        self.reason = ""  # why it cannot; empty while all others live or have done what they had to
        self.limit = AT_ONCE
        self._wires: dict[int, Wire] = {}
        self._told: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._done: set[int] = set()
        self._raised, self._left = False, threading.Event()
        self._change = threading.Lock()

    def tell(self, text: str) -> None:
        """Say something to all, for them to `hear`. Args: text."""
        self._say(TOLD, text)

    def hear(self) -> str:
        """What another process tells; waits for it."""
        return self._told.get()

    def check(self) -> None:
        """Raise ProcessError where the run cannot go on, for threads other than the main one."""
        if self.reason:
            raise ProcessError(self._message())

    @contextlib.contextmanager
    def signals(self) -> Iterator[None]:
        """Have signals raise an ProcessError in the main thread, which must be the one that calls this."""
        before = {number: signal.signal(number, self._end) for number in SIGNALS}
        try:
            yield
        finally:
            self._leave()
            for number, handler in before.items():
                signal.signal(number, handler or signal.SIG_DFL)

    @contextlib.contextmanager
    def watched(self, wires: Mapping[int, Wire]) -> Iterator[None]:
        """Notice how the others end, and tell them how this process does; done is the run when all are.

        Args: wires to other processes by number.
        """
        self._wires = dict(wires)
        watch = threading.Thread(target=self._watch, name="line", daemon=True)
        watch.start()
        try:
            yield
            self._finish()
        except BaseException as error:
            said = " ".join(str(error).split())
            self._say(LOST, self.reason or f"process {self.process} has failed: {type(error).__name__}: {said}")
            raise
        finally:
            self._leave()
            watch.join()
            for wire in self._wires.values():
                wire.close()

    def _leave(self) -> None:
        with self._change:  # nothing is raised from here on
            self._left.set()

    def _finish(self) -> None:
        self._say(DONE)
        while set(self._wires) - self._done:
            time.sleep(PAUSE)

    def _watch(self) -> None:
        with selectors.DefaultSelector() as selector:
            for process, wire in self._wires.items():
                selector.register(wire.connection, selectors.EVENT_READ, process)
            while not self.reason and not self._left.is_set():
                for key, _ in selector.select(PAUSE):
                    if not self._read(key.data):
                        selector.unregister(key.fileobj)
        self._insist()

    def _insist(self) -> None:
        """End the process where the main thread does not."""
        if not self._left.wait(self.limit):
            print(f"error: {self._message()}", file=sys.stderr, flush=True)
            os._exit(FAILED)

    def _read(self, process: int) -> bool:
        """Take what a process says; whether it will say more."""
        try:
            for message in self._wires[process].receive():
                self._take(process, message)
        except (EOFError, OSError, ValueError):
            if process not in self._done:
                self._lose(f"process {process} has ended without a word")
            return False
        return True

    def _take(self, process: int, message: Message) -> None:
        kind, text = message
        if kind == TOLD:
            self._told.put(text)
        elif kind == DONE:
            self._done.add(process)
        elif kind == LOST:
            self._lose(text)

    def _lose(self, reason: str) -> None:
        """Let the others know, and the main thread."""
        if self.reason:
            return
        self.reason = reason
        if self.process == 0:
            self._say(LOST, reason)
        with self._change:
            if not self._left.is_set():
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)

    def _end(self, number: int, frame: FrameType | None) -> None:
        if self._raised or self._left.is_set():
            return
        self._raised = True  # once: what is written on the way out is written whole
        self.reason = self.reason or f"process {self.process} was told to end ({signal.Signals(number).name})"
        raise ProcessError(self._message())

    def _message(self) -> str:
        return f"{self.reason}: {self.remedy}"

    def _say(self, kind: str, text: str = "") -> None:
        for wire in self._wires.values():
            with contextlib.suppress(OSError):  # who has ended is noticed elsewhere
                wire.send(kind, text)
