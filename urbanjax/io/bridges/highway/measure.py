"""What is measured of a drive in highway-env, with the metrics of our own simulator."""

import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.evaluation import metrics
from urbanjax.io.bridges.highway.episode import Episode
from urbanjax.sim.log import Log
from urbanjax.types import VehicleState
from urbanjax.vehicle.params import VehicleParams

BOX = VehicleParams(length=5.0, width=2.0)  # highway-env's vehicles
BUCKET = 16  # drives that meet 1 to 16, 17 to 32, ... vehicles share one compiled program


def time_to_collision(episode: Episode, steps: int | None = None) -> np.ndarray:
    """[N] s until boxes meet if all keep their velocity, per sample of the drive; inf where they never would.

    Args: episode, the drive; steps, samples to pad to, so that drives of different lengths share one compiled program.
    """
    count = len(episode.time)
    if not episode.others.valid.any():
        return np.full(count, np.inf)
    return np.asarray(_box_ttc(_log(episode, count if steps is None else max(steps, count))))[:count]


@jax.jit
def _box_ttc(log: Log) -> jax.Array:
    return metrics.box_ttc(log, BOX)


def _log(episode: Episode, steps: int) -> Log:
    """The drive as far as the time to collision looks at it.

    The last sample is repeated up to `steps`; vehicles that are not there fill up the others.
    """
    more = -episode.others.valid.shape[1] % BUCKET

    def padded(values: np.ndarray) -> jax.Array:
        return jnp.asarray(np.concatenate([values, np.repeat(values[-1:], steps - len(values), axis=0)]))

    def filled(values: np.ndarray) -> jax.Array:
        return padded(np.pad(np.nan_to_num(values), [(0, 0), (0, more), *[(0, 0)] * (values.ndim - 2)]))

    heading, speed = padded(episode.heading), padded(episode.speed)
    ego = VehicleState(position=None, heading=heading, speed=speed, acceleration=None, steering=None)
    return Log(
        time=padded(episode.time),
        ego=ego,
        command=None,
        centre=padded(episode.position),
        along=None,
        offset=None,
        road_margin=None,
        traffic=jax.tree.map(filled, episode.others),
    )
