"""What several devices, or several cores of one, do at the same time: who is free takes what comes next (host side)."""

import contextlib
import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import jax

T = TypeVar("T")
R = TypeVar("R")


def streams() -> list[Any]:
    """The device of every stream of chunks, None for the only one: a chunk by itself leaves cores of a CPU idle."""
    devices = jax.local_devices()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    at_once = max(cores // len(devices), 1) if devices[0].platform == "cpu" else 1
    return [None] * at_once if len(devices) == 1 else [device for _ in range(at_once) for device in devices]


def dealt(items: Iterable[T], drive: Callable[[Iterable[T]], Iterator[R]], *, devices: Sequence[Any]) -> Iterator[R]:
    """What comes of the items, as it comes; they are dealt out to one stream for each device.

    Args: items; drive, a stream: it takes items as it needs them; devices, see `streams`. Raises what a stream raises.
    """
    if len(devices) == 1:
        yield from drive(items)
        return
    found: queue.SimpleQueue = queue.SimpleQueue()
    wanted = _Shared(items)

    def work(device: Any) -> None:
        end: Any = None
        try:
            with jax.default_device(device) if device else contextlib.nullcontext():
                for result in drive(wanted):
                    found.put(result)
        except BaseException as error:
            end = error
        finally:
            found.put(end)

    with ThreadPoolExecutor(len(devices)) as pool:
        try:
            for device in devices:
                pool.submit(work, device)
            ended = 0
            while ended < len(devices):
                result = found.get()
                if isinstance(result, BaseException):
                    raise result
                ended += result is None
                if result is not None:
                    yield result
        finally:
            wanted.end()  # the others end with the drives that they have begun


class _Shared:
    """An iterator that several threads take from."""

    def __init__(self, items: Iterable) -> None:
        self._items, self._lock = iter(items), threading.Lock()

    def __iter__(self) -> "_Shared":
        return self

    def __next__(self) -> Any:
        with self._lock:
            return next(self._items)

    def end(self) -> None:
        """Let there be no further items."""
        with self._lock:
            self._items = iter(())
