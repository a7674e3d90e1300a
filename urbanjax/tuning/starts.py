"""Closed loops that are under way: from where tuning differentiates them (host side)."""

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.evaluation import programs
from urbanjax.evaluation.batch import CHUNK, Job, case_of
from urbanjax.evaluation.case import Case
from urbanjax.evaluation.metrics import HARD, clearance
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.programs import compiled
from urbanjax.evaluation.streams import dealt, streams
from urbanjax.evaluation.traffic import mannered_sim
from urbanjax.numerics.compiling import compiler_options
from urbanjax.rollout import LoopParams, Underway, go_on
from urbanjax.tuning.scenes import APART, SceneParams, TuningScene, scenes
from urbanjax.types import ConfigError, as_arrays, host_record, pytree

MARGIN, AHEAD = 10.0, 1.2  # m, and of the way at the present speed, that have to be left to the goal


@pytree
class Start:
    """Where a scene begins, or S of them stacked along the first axis."""

    loop: LoopParams  # that drives, among traffic of the scene's manner
    case: Case
    now: Underway  # the loop at the moment of the scene

    def at(self, numbers: Any) -> "Start":
        """Some of them. Args: numbers [R], which, from 0; or one."""
        chosen = np.asarray(numbers)
        return jax.tree.map(lambda x: np.asarray(x)[chosen], self)

    @property
    def count(self) -> int:
        """S."""
        return int(np.shape(self.now.world.time)[0])


@host_record
class SceneSet:
    """Scenes with their starts."""

    scenes: tuple[TuningScene, ...]  # S
    start: Start  # [S]


def scene_set(loop: LoopParams, which: SceneParams, *, horizon: float, seed: int) -> SceneSet:
    """Scenes of a set with their starts, see `starts`.

    Args: loop, that drives up to them; which, of them; horizon [s] for which they last; seed, of the draw.
    """
    return starts(loop, scenes(which, seed=seed), horizon=horizon)


def starts(loop: LoopParams, drawn: Sequence[TuningScene], *, horizon: float) -> SceneSet:
    """The scenes and their starts [S], driven up to their moments by the loop as it is.

    They stay where they are while parameters are tuned, so that a change of the loss is one of the parameters. Where
    the drive is over by the moment of a scene, or will be within the horizon, or has touched somebody or left the road,
    the scene begins at the last moment before. Args: loop, with hard choices; drawn, scenes of one size; horizon [s]
    for which scenes last. Raises ConfigError where there is none, and for relaxed choices.
    """
    if not drawn:
        raise ConfigError("there is no scene to begin in: give at least one")
    if loop.stack.relaxation.mode != "hard":
        raise ConfigError("'stack.relaxation.mode' is relaxed: starts are driven as deployed, set it to hard")
    numbered = list(enumerate(drawn))
    parts = [numbered[k : k + CHUNK] for k in range(0, len(numbered), CHUNK)]
    found: dict[int, Start] = {}
    drive = functools.partial(_driven, loop.loop(), horizon)
    for part, driven in dealt(parts, drive, devices=streams()[: len(parts)]):
        found.update({number: driven.at(k) for k, (number, _) in enumerate(part)})
    begun = jax.tree.map(lambda *x: np.stack(x), *(found[number] for number in range(len(drawn))))
    since = begun.now.world.time - begun.case.start.time
    moments = (APART * np.round(since / APART)).tolist()
    return SceneSet(tuple(dataclasses.replace(scene, moment=t) for scene, t in zip(drawn, moments, strict=True)), begun)


def _driven(
    loop: LoopParams, horizon: float, parts: Iterable[list[tuple[int, TuningScene]]]
) -> Iterator[tuple[list[tuple[int, TuningScene]], Start]]:
    """The starts of every part, one chunk at a time."""
    steps = round(APART / float(loop.period))
    for part in parts:
        full = [scene for _, scene in part] + [part[-1][1]] * (CHUNK - len(part))
        loops, cases = _stacked([_among(loop, scene) for scene in full]), _stacked([_case(loop, s) for s in full])
        now = compiled(programs.fresh)(loops, cases)
        moments = np.array([scene.moment for scene in full])
        kept, sound = now, np.ones(CHUNK, bool)
        for k in range(1, round(float(moments.max()) / APART) + 1):
            now, touched, left = _on(steps)(loops, cases, now)
            sound &= ~np.asarray(touched)
            goes_on = np.asarray(left) > MARGIN + AHEAD * horizon * np.asarray(now.world.ego.speed)
            wanted = moments > (k - 0.5) * APART
            kept = compiled(programs.renewed)(kept, now, new=wanted & sound & goes_on)
        yield part, jax.device_get(Start(loops, cases, kept))


def _among(loop: LoopParams, scene: TuningScene) -> LoopParams:
    return as_arrays(loop.replace(sim=mannered_sim(loop.sim, scene.traffic)))


def _case(loop: LoopParams, scene: TuningScene) -> Case:
    return as_arrays(case_of(loop, Job(MISSIONS[scene.mission], scene.seed), traffic=scene.traffic))


def _stacked(records: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *x: np.stack(x), *jax.device_get(list(records)))


@functools.cache
def _on(steps: int) -> Any:
    """A program of so many steps: the loops, whether they failed meanwhile, and the way that is left to the goal."""

    def one(loop: LoopParams, case: Case, now: Underway) -> tuple[Underway, Array, Array]:
        after, (log, _) = go_on(loop, case.course, lanes=case.lanes, now=now, n_steps=steps, keep=lambda info: None)
        gaps, others = clearance(log, loop.vehicle, relaxation=HARD)
        touched = jnp.any(others & (gaps <= 0)) | jnp.any(log.road_margin < 0)
        return after, touched, case.goal - after.state.station

    return jax.jit(jax.vmap(one), compiler_options=compiler_options())
