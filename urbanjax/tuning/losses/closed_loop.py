"""The loss of a closed loop, and its gradient, scene by scene: what tuning of a deployed stack minimises."""

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.evaluation.batch import CHUNK
from urbanjax.evaluation.scores import Score, ScoreParams, terms
from urbanjax.evaluation.streams import dealt, streams
from urbanjax.numerics.compiling import compiler_options
from urbanjax.numerics.soft import Relaxation
from urbanjax.rollout import LoopParams, Underway
from urbanjax.sim.log import Log
from urbanjax.tuning.losses.unrolled import unrolled
from urbanjax.tuning.spaces import Space
from urbanjax.tuning.starts import Start
from urbanjax.types import ConfigError, as_arrays, host_record
from urbanjax.types.arguments import whole

HARD = Relaxation()
DERIVATIVES = ("auto", "forward", "reverse", "none")
SEGMENT = 10  # steps, by which horizons differ: a loop of any length is one program
FORWARD_MOST = 4  # coordinates, up to which forward mode costs less


@host_record
class Rows:
    """What came of R rows, each a scene with coordinates of its own."""

    loss: np.ndarray  # [R], the score with its sign turned
    score: Score  # [R], and its terms
    gradient: np.ndarray  # [R, P] of the loss; [R, 0] where it was not asked for


@host_record
class ClosedLoop:
    """Losses of a space of parameters in closed loops. Holds no arrays."""

    space: Space
    longest: int  # steps, of which one program drives as many as are asked for, by tens
    step_clip: float | None = None  # greatest norm of what a step hands back to the one before in "reverse"

    def losses(
        self,
        z: np.ndarray,
        start: Start,
        *,
        n_steps: int | None = None,
        score: ScoreParams | Sequence[ScoreParams] | None = None,
        relaxation: Relaxation = HARD,
        derivative: str = "none",
    ) -> Rows:
        """The loss of every row, with its gradient where a derivative is asked for.

        What comes out for a row does not depend on the other ones. Not finite is left as it is: whoever asked knows the
        scene. "forward" pushes every coordinate through the loop, "reverse" goes back once for all of them; they agree
        to rounding where `step_clip` does not bind, and "auto" takes the first one for up to FORWARD_MOST coordinates.
        Args: z [R, P], coordinates of each row, or [P] of all; start [R]; n_steps, a multiple of SEGMENT (default:
        the longest); score, weights of the terms, one for all rows
        or one for each; relaxation, of all choices; derivative, one of DERIVATIVES. Raises ConfigError for other
        numbers of steps and rows, and a derivative that there is not.
        """
        n_steps = whole(n_steps or self.longest, "n_steps", error=ConfigError, least=SEGMENT, most=self.longest)
        if n_steps % SEGMENT or self.longest % SEGMENT:
            raise ConfigError(f"n_steps is {n_steps} of {self.longest}: give multiples of {SEGMENT}")
        if derivative not in DERIVATIVES:
            raise ConfigError(f"derivative is {derivative!r}: use one of {', '.join(DERIVATIVES)}")
        if derivative == "auto":
            derivative = "forward" if self.space.size <= FORWARD_MOST else "reverse"
        count = start.count
        points = np.broadcast_to(np.asarray(z, jnp.zeros(()).dtype), (count, self.space.size))
        scores = [score or ScoreParams()] * count if score is None or isinstance(score, ScoreParams) else list(score)
        if len(scores) != count:
            raise ConfigError(f"{len(scores)} scores for {count} rows: give one for all, or one for each")
        weights = jax.tree.map(lambda *x: np.stack(x), *jax.device_get([as_arrays(one) for one in scores]))
        program = _program(self, relaxation.mode, derivative)
        shared = as_arrays(relaxation).temperature, np.int32(n_steps // SEGMENT)
        run = functools.partial(_chunks, program, (points, start, weights), shared)
        parts = [np.arange(k, min(k + CHUNK, count)) for k in range(0, count, CHUNK)]
        found = dict(dealt(enumerate(parts), run, devices=streams()[: len(parts)]))
        return Rows(*jax.tree.map(lambda *x: np.concatenate(x), *(found[k] for k in range(len(parts)))))


def _chunks(
    program: Callable, rows: Any, shared: tuple, parts: Iterable[tuple[int, np.ndarray]]
) -> Iterator[tuple[int, tuple]]:
    """What the program gives for every chunk of rows; a chunk that is not full holds repeats."""
    for k, part in parts:
        full = np.concatenate([part, np.repeat(part[-1:], CHUNK - len(part))])
        found = program(*jax.tree.map(lambda x, full=full: x[full], rows), *shared)
        yield k, jax.tree.map(lambda x, part=part: x[: len(part)], jax.device_get(found))


@functools.cache
def _program(of: ClosedLoop, mode: str, derivative: str) -> Callable:
    """(z [R, P], start [R], score [R], temperature, segments) to loss [R], score [R] and gradient [R, P]."""

    def loss(z: Array, start: Start, score: ScoreParams, temperature: Array, segments: Array) -> tuple[Array, Score]:
        relaxation = Relaxation(mode=mode).replace(temperature=temperature)
        own = of.space.params(z, start.loop)
        own = own.replace(stack=own.stack.replace(relaxation=relaxation))
        step_clip = of.step_clip if derivative == "reverse" else None
        log, counts = _driven(own, start, most=of.longest // SEGMENT, segments=segments, step_clip=step_clip)
        relaxed = HARD if mode == "hard" else relaxation
        found = terms(log, own.vehicle, params=score, relaxation=relaxed, counts=counts)
        return -found.total, found

    def row(z: Array, *rest: Any) -> tuple[Array, Score, Array]:
        if derivative == "reverse":
            (value, found), gradient = jax.value_and_grad(loss, has_aux=True)(z, *rest)
        elif derivative == "forward":

            def along(direction: Array) -> tuple[Array, Array, Score]:
                return jax.jvp(lambda z: loss(z, *rest), (z,), (direction,), has_aux=True)

            value, gradient, found = jax.vmap(along, out_axes=(None, 0, None))(jnp.eye(z.shape[0], dtype=z.dtype))
        else:
            (value, found), gradient = loss(z, *rest), z[:0]
        return value, found, gradient

    return jax.jit(jax.vmap(row, (0, 0, 0, None, None)), compiler_options=compiler_options())


def _driven(
    loop: LoopParams, start: Start, *, most: int, segments: Array, step_clip: float | None
) -> tuple[Log, Array]:
    """The log [T] of at most so many segments, and which of its steps were driven; in others stands the first one."""

    def on(now: Underway) -> tuple[Underway, Log]:
        return unrolled(loop, start.case, now=now, n_steps=SEGMENT, step_clip=step_clip)

    def off(now: Underway) -> tuple[Underway, Log]:
        return now, jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(on, now)[1])

    def segment(now: Underway, number: Array) -> tuple[Underway, Log]:
        return jax.lax.cond(number < segments, on, off, now)

    _, logs = jax.lax.scan(segment, start.now, jnp.arange(most))
    log = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), logs)
    counts = jnp.arange(most * SEGMENT) < segments * SEGMENT

    def held(x: Array) -> Array:
        return jnp.where(counts.reshape(-1, *[1] * (x.ndim - 1)), x, x[:1])

    return jax.tree.map(held, log), counts
