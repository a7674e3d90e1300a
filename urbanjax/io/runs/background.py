"""What is written while the device computes."""

import collections
import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

WAITING = 4  # calls that may wait; whoever asks for one more waits for the first


@contextlib.contextmanager
def background() -> Iterator[Callable[[Callable[[], None]], None]]:
    """A function that has others called in a thread, one after the other, and raises here what they raise.

    All of them are done when the block ends.
    """
    waiting: collections.deque[Future] = collections.deque()
    with ThreadPoolExecutor(1) as pool:

        def later(call: Callable[[], None]) -> None:
            while waiting and (len(waiting) >= WAITING or waiting[0].done()):
                waiting.popleft().result()
            waiting.append(pool.submit(call))

        yield later
        for one in waiting:
            one.result()
