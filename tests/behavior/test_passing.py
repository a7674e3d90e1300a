"""Who is in the way of a path: one who stands may be passed closely, one who moves may not."""

import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.behavior.surroundings import OccupancyParams, Surroundings, in_path, moving
from urbanjax.evaluation.batch import Job, outcomes
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.numerics.soft import Relaxation
from urbanjax.rollout import LoopParams
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

WIDTH = 1.9  # m, of the others
PARAMS = OccupancyParams()


def around(offset, speed):
    many = jnp.zeros(len(offset))
    fields = dict.fromkeys(Surroundings.__dataclass_fields__, many)
    return Surroundings(
        **fields
        | {"offset": jnp.asarray(offset), "speed": jnp.asarray(speed), "half_width": many + WIDTH / 2}
        | {"valid": many == 0, "lane_offset": many[:, None]}
    )


def telling(mode):
    return Driving(VehicleParams(), PARAMS, Relaxation(0.01, mode), 0.1)


@pytest.mark.parametrize("mode", ["hard", "soft"])
def test_one_who_stands_is_passed_by_less_than_one_who_moves(mode):
    touching = (WIDTH + VehicleParams().width) / 2
    rooms = jnp.asarray([-0.5, 0.1, 0.2, 0.4, 0.1, 0.2, 0.4])
    others = around(touching + rooms, [0.0, 0.0, 0.0, 0.0, 3.0, -3.0, 3.0])
    moves = moving(others, telling(mode))
    np.testing.assert_allclose(moves, [0, 0, 0, 0, 1, 1, 1], atol=0.01)
    found = in_path(others, telling(mode), offset=jnp.zeros(7), moves=moves)
    np.testing.assert_allclose(found, [1, 1, 0, 0, 1, 1, 0], atol=0.05)


def test_one_who_moves_sideways_alone_moves():
    others = around([3.0], [0.0]).replace(lateral_speed=jnp.asarray([-0.5]))
    assert moving(others, telling("hard")) == 1


@pytest.mark.slow
def test_gaps_between_standing_vehicles_are_driven_through():
    """0.35 to 0.75 m on either side, between two lanes."""
    mission = MISSIONS["narrow_passage"]
    found = [one.row["success"] for one in outcomes(LoopParams(), [Job(mission, 1000 + k) for k in range(16)])]
    assert np.sum(found) >= 15
