import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.behavior import lanes
from urbanjax.behavior.lanes import LaneParams
from urbanjax.numerics.soft import Relaxation
from urbanjax.roadmap.progress import Sample
from urbanjax.vehicle.driving import Driving
from urbanjax.vehicle.params import VehicleParams

NOWHERE = jnp.zeros(5)
LANE_2, LANE_3 = jnp.eye(5)[2], jnp.eye(5)[3]


def road(has_lane=(0, 1, 1, 1, 0)):
    """Lanes 3.5 m apart, of which the outer two are missing."""
    fields = {field.name: None for field in dataclasses.fields(Sample)}
    return Sample(**fields | {"lane_offset": 3.5 * jnp.arange(-2.0, 3.0), "has_lane": jnp.array(has_lane, bool)})


def nearest(offset, previous, relaxation=Relaxation()):
    driving = Driving(VehicleParams(), LaneParams(), relaxation, 0.1)
    return lanes.nearest_lane(road(), driving, offset=offset, previous=previous)


@pytest.mark.parametrize(("offset", "lane"), [(0.0, 2), (1.0, 2), (2.5, 3), (-3.0, 1), (9.0, 3)])
def test_the_nearest_lane_that_exists_is_chosen(offset, lane):
    weights = nearest(jnp.asarray(offset), NOWHERE)
    np.testing.assert_array_equal(weights, jnp.eye(5)[lane])


def test_between_two_lanes_the_previous_one_is_kept():
    middle = jnp.asarray(1.75 + 0.1)
    for previous, lane in ((NOWHERE, LANE_3), (LANE_2, LANE_2), (LANE_3, LANE_3)):
        np.testing.assert_array_equal(nearest(middle, previous), lane)
    far = jnp.asarray(3.2)
    np.testing.assert_array_equal(nearest(far, LANE_2), LANE_3)


def test_soft_weights_sum_to_one_and_tend_to_the_hard_choice():
    offset = jnp.asarray(1.2)
    for temperature, accuracy in ((1.0, 1.0), (1e-2, 1e-6)):
        weights = nearest(offset, NOWHERE, Relaxation(temperature, "soft"))
        np.testing.assert_allclose(weights.sum(), 1, rtol=1e-6)
        np.testing.assert_allclose(weights, LANE_2, atol=accuracy)
        assert weights[0] == weights[4] == 0
