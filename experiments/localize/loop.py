"""The closed loop on what the car estimates: overtaking in the district with poses from scans alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from experiments.common.district import World
from urbanjax.course import Course, course_between
from urbanjax.evaluation import metrics, statistics
from urbanjax.evaluation.metrics import Metrics
from urbanjax.io.figures.style import BAD, GOOD, OTHER, figure, shades
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.localization.types import Health
from urbanjax.numerics.compiling import compiler_options
from urbanjax.roadmap.graph import RoadGraph
from urbanjax.rollout import LoopParams, rollout, steps_of
from urbanjax.sim import lanes as tables
from urbanjax.sim.lanes import LaneTables
from urbanjax.sim.lidar import LidarParams
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import OvertakeParams
from urbanjax.sim.scenarios.transplant import transplant
from urbanjax.sim.sensing import Sensing
from urbanjax.sim.world import SimParams
from urbanjax.stack import StackInfo, StackParams
from urbanjax.types import POSITIVE, SEED, SHARE, ConfigError, Unread, as_arrays, field, host_record, pytree, static

SHIFT = -30.0  # m, of the straight road's stations to those of the link


@pytree
class LoopStudy:
    """Which values of tau, how many starts and for how long."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "stack.behavior.gvp.tau": Unread("every value of 'loop.taus' is driven in its place"),
        "stack.lidar": Unread("the loop drives with 'localizer'"),
    }

    stack: StackParams = StackParams(localizer="lidar")
    sim: SimParams = SimParams()
    scenario: OvertakeParams = OvertakeParams()
    taus: tuple[float, ...] = field(default=(0.0, 0.25, 0.5, 0.75), metadata=SHARE)
    link: int = static(default=82)  # on which the ego starts: the middle lane of three before straight H
    duration: float = static(default=20.0, metadata=POSITIVE)  # s
    starts: int = static(default=8, metadata={"range": (0, 1000)})
    seed: int = static(default=0, metadata=SEED)


@host_record
class Loops:
    """Rollouts over A values of tau and S starts."""

    taus: np.ndarray  # [A]
    time: np.ndarray  # [T] s
    position: np.ndarray  # [A, S, T, 2] m, the true rear axle
    estimate: np.ndarray  # [A, S, T, 2] m, where it believed to be
    health: np.ndarray  # [A, S, T]
    progress: np.ndarray  # [A, S] m
    collided: np.ndarray  # [A, S] bool
    off_road: np.ndarray  # [A, S] bool

    @property
    def error(self) -> np.ndarray:
        """Planar error [A, S, T] m."""
        return np.linalg.norm(self.estimate - self.position, axis=-1)


def checked(study: LoopStudy, graph: RoadGraph) -> None:
    """Raise ConfigError if the ego cannot start on the link."""
    count = graph.length.shape[0]
    if study.link >= count or not bool(graph.valid[study.link] & graph.has_left[study.link]):
        raise ConfigError(f"'loop.link' must be one of {count} links and have a lane on its left, not {study.link}")
    if not bool(graph.has_predecessor[study.link, 0]):
        raise ConfigError(f"'loop.link' {study.link} begins a road: nothing leads back to it")


def drive(
    study: LoopStudy,
    world: World,
    localizer: LidarLocalizerParams,
    sensor: LidarParams,
    tick: Callable[[str], None] = lambda label: None,
) -> Loops:
    """All rollouts, one after the other in one compiled program."""
    graph = world.course.graph
    course = course_between(graph, study.link, goal=int(graph.predecessor[study.link, 0])).replace(map=world.course.map)
    stack = study.stack.replace(lidar=localizer)
    loop, family = as_arrays((LoopParams(sensor=sensor, stack=stack, sim=study.sim), study.scenario))
    lanes = tables.from_graph(graph)
    taus = jnp.asarray(study.taus)
    tick(f"driving {taus.size * study.starts} rollouts on poses from scans")
    steps = steps_of(study.duration, float(loop.period))
    program = jax.jit(_grid, static_argnames=("link", "starts", "n_steps"), compiler_options=compiler_options())
    key = jax.random.key(study.seed)
    position, estimate, health, progress, result = jax.device_get(
        program(
            loop,
            family,
            course,
            lanes,
            world.surroundings,
            taus,
            key,
            link=study.link,
            starts=study.starts,
            n_steps=steps,
        )
    )
    period = float(loop.period)
    return Loops(
        taus=np.asarray(taus),
        time=period * np.arange(steps),
        position=position,
        estimate=estimate,
        health=health,
        progress=progress,
        collided=np.asarray(result.collision) > 0.5,
        off_road=np.asarray(result.off_road) > 0.5,
    )


def _grid(
    loop: LoopParams,
    family: OvertakeParams,
    course: Course,
    lanes: LaneTables,
    surroundings: Any,
    taus: Array,
    key: Array,
    link: int,
    starts: int,
    n_steps: int,
) -> tuple[Array, Array, Array, Array, Metrics]:
    def one(pair: tuple[Array, Array]) -> tuple:
        tau, number = pair
        mine = jax.random.fold_in(key, number)
        straight = overtake.sample(mine, family, vehicle=loop.vehicle, others=loop.sim.traffic)
        start = transplant(straight, lanes, link=jnp.asarray(link), shift=SHIFT).world
        gvp = loop.stack.behavior.gvp.replace(tau=tau)
        stack = loop.stack.replace(behavior=loop.stack.behavior.replace(gvp=gvp))
        sensing = Sensing(surroundings, jax.random.fold_in(mine, 1))
        log, kept = rollout(loop.replace(stack=stack), course, lanes, start, n_steps, _localized, sensing)
        result = metrics.evaluate(log, loop.vehicle, relaxation=stack.relaxation)
        return log.ego.position, *kept, metrics.progress(log)[-1], result

    tau, number = jnp.meshgrid(taus, jnp.arange(starts), indexing="ij")
    flat = lax.map(one, (tau.ravel(), number.ravel()))
    return jax.tree.map(lambda x: x.reshape(taus.size, starts, *x.shape[1:]), flat)


def _localized(info: StackInfo) -> tuple[Array, Array]:
    return info.localization.pose.translation(), info.localization.health


def table(loops: Loops) -> dict[str, list[Any]]:
    """One row per tau."""
    return {
        "tau": loops.taus.tolist(),
        "progress [m]": loops.progress.mean(1).tolist(),
        "collisions": loops.collided.sum(1).tolist(),
        "off the road": loops.off_road.sum(1).tolist(),
        "pose error, mean [m]": loops.error.mean((1, 2)).tolist(),
        "pose error, largest [m]": loops.error.max((1, 2)).tolist(),
        "scans not NORMAL [%]": (100 * (loops.health != Health.NORMAL).mean((1, 2))).tolist(),
    }


def summary(loops: Loops) -> dict[str, Any]:
    """Flat numbers."""
    progress: dict[str, float] = {}
    for tau, row in zip(loops.taus, loops.progress, strict=True):
        progress |= statistics.mean(row).flat(f"loop_tau_{tau:g}_progress_m")
    return {
        "loop_rollouts": loops.collided.size,
        "loop_collisions": int(loops.collided.sum()),
        **statistics.rate(loops.collided.ravel()).flat("loop_collisions_share"),
        "loop_off_road": int(loops.off_road.sum()),
        "loop_mean_error_m": loops.error.mean(),
        "loop_max_error_m": loops.error.max(),
        **progress,
    }


def draw(loops: Loops, path: Path) -> None:
    """True paths in the first lane's frame, and the error of the pose that was driven on."""
    colours = shades(len(loops.taus))
    ahead = loops.position[0, 0, 1] - loops.position[0, 0, 0]
    ahead = ahead / np.linalg.norm(ahead)
    away = loops.position - loops.position[:, :, :1]
    along, aside = away @ ahead, away @ np.array([-ahead[1], ahead[0]])
    with figure(path, 10.0, height=5.0) as canvas:
        axes = canvas.subplots(2, 1)
        for i, tau in enumerate(loops.taus):
            for s in range(loops.progress.shape[1]):
                bad = loops.collided[i, s]
                label = rf"$\tau$ = {tau:g}" if s == 0 else None
                axes[0].plot(along[i, s], aside[i, s], color=BAD if bad else colours[i], lw=0.9, label=label)
            axes[1].plot(loops.time, loops.error[i].mean(0), color=colours[i])
        axes[1].fill_between(loops.time, loops.error.min((0, 1)), loops.error.max((0, 1)), color=OTHER, alpha=0.2, lw=0)
        axes[0].set(title="True paths from the start", xlabel="along the road [m]", ylabel="left [m]")
        axes[0].legend(ncols=4, loc="upper right")
        axes[1].set(title="Error of the pose (mean; band: all)", xlabel="time [s]", ylabel="m", ylim=(0, None))
        axes[1].axhline(0.0568, color=GOOD, lw=0.8, ls="--")
