"""Experiments that evaluate, one or many at once: what each drives, what it keeps of it, what it makes of that."""

import abc
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

from urbanjax.evaluation.batch import Outcome
from urbanjax.evaluation.together import Batch, Came, Wanted, together
from urbanjax.io.runs import progress
from urbanjax.io.runs.background import background
from urbanjax.io.runs.disk import is_of_disk
from urbanjax.types import ProcessError

Later = Callable[[Callable[[], None]], None]


@runtime_checkable
class Evaluation(Protocol):
    """One run of an experiment that evaluates drives; made of its params and its `Run`."""

    @abc.abstractmethod
    def missing(self) -> Mapping[str, Batch]:
        """The names of the parts that are to be driven here, with their batches: the others are known already."""

    @abc.abstractmethod
    def take(self, part: str, outcomes: Sequence[Outcome], later: Callable) -> None:
        """Keep what came of a part. Args: part, its name; outcomes, of its drives; later, has a call done meanwhile."""

    @abc.abstractmethod
    def finish(self) -> None:
        """Write what all drives come to; every part is there."""


def evaluate(
    evaluations: Mapping[str, Evaluation], *, ended: Callable[[str, Exception | None], None], title: str = "evaluation"
) -> tuple[int, float]:
    """Drive what is missing of all of them, in programs that they share. Returns the drives, and the seconds.

    Args: evaluations by name; ended, told of each when all its parts are kept, or what it raised; title of the bar.
    Raises OSError where what came cannot be written: what was written before is kept.
    """
    left = {name: dict(one.missing()) for name, one in evaluations.items()}
    wanted = [Wanted(name, batch, part) for name, parts in left.items() for part, batch in parts.items()]
    total, count, began = sum(len(one.jobs) for one in wanted), 0, time.perf_counter()
    for name in [name for name, parts in left.items() if not parts]:
        ended(name, None)
    with progress.bar(title) as tick, background() as later:
        tick(f"{total} drives", 0.0)
        for came in together(wanted):
            name, part = str(came.wanted.evaluation), came.wanted.part
            if name not in left:
                continue  # it has failed
            error = came.error or _taken(evaluations[name], came, later)
            del left[name][part]
            if error is not None or not left[name]:
                del left[name]
                _written(later)
                ended(name, error)
            count += len(came.wanted.jobs)
            tick(_paced(part, count, total, time.perf_counter() - began), count / total)
    return count, time.perf_counter() - began


def _taken(evaluation: Evaluation, came: Came, later: Later) -> Exception | None:
    """Keep what came of a part; returns what that raises, but for a disk that takes nothing any more."""
    try:
        evaluation.take(came.wanted.part, came.outcomes, later)
    except Exception as error:
        if is_of_disk(error) or isinstance(error, ProcessError):
            raise
        return error
    return None


def _written(later: Later) -> None:
    """Wait until all is written that was kept so far: what is called complete has to be there."""
    done = threading.Event()
    later(done.set)
    done.wait()
    later(lambda: None)  # raises what a call before has raised


def _paced(part: str, count: int, total: int, passed: float) -> str:
    return f"{part}, {count / passed:.1f} drives/s, {(total - count) * passed / count:.0f} s left"
