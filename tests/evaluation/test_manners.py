"""How the others drive: what each kind of traffic changes, and what it leaves."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.evaluation.test_metrics import make
from urbanjax.evaluation.missions import MISSIONS
from urbanjax.evaluation.traffic import MANNERS, as_recorded, mannered, mannered_sim
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.world import SimParams
from urbanjax.types import RoadUser
from urbanjax.vehicle.params import VehicleParams

SEED = 5
# Of each kind what it draws or sets for every driver; the others are as the mission has them.
CHANGED = {
    "idm": set(),
    "mixed": {"headway", "desired_speed", "politeness", "changes"},
    "assertive": {"headway", "desired_speed", "politeness", "changes"},
    "non_yielding": set(),
    "replay": set(),
}


@pytest.fixture(scope="module")
def world():
    """Among others somebody who does not react."""
    return MISSIONS["overtake"].case(1, others=TrafficParams(), vehicle=VehicleParams()).start


@pytest.mark.parametrize("name", MANNERS)
def test_a_kind_of_traffic_changes_what_it_says(world, name):
    plain = world.traffic
    one, again, other = (mannered(world, name, seed=seed).traffic for seed in (SEED, SEED, SEED + 1))
    for spec in dataclasses.fields(plain):
        was, now, same, drawn = (np.asarray(getattr(x, spec.name)) for x in (plain, one, again, other))
        np.testing.assert_array_equal(now, same)
        assert (now.dtype, now.shape) == (was.dtype, was.shape)
        assert np.array_equal(now, was) == (spec.name not in CHANGED[name]), spec.name
        assert np.array_equal(now, drawn) == (spec.name not in CHANGED[name] or name == "assertive"), spec.name


def test_what_is_drawn_and_what_is_set(world):
    plain = world.traffic
    reacts = plain.reacts
    assert reacts.any()
    assert not reacts.all()
    mixed, pushy = (mannered(world, name, seed=SEED).traffic for name in ("mixed", "assertive"))
    for one in (mixed, pushy):
        np.testing.assert_array_equal(one.desired_speed[~reacts], plain.desired_speed[~reacts])
        assert not (one.changes & ~reacts).any()
    assert np.ptp(mixed.headway) > 0.3
    assert mixed.headway.min() >= 0.7
    assert mixed.headway.max() <= 2.2
    assert np.abs(mixed.desired_speed / plain.desired_speed - 1)[reacts].max() <= 0.2 + 1e-6
    assert mixed.politeness.min() >= 0
    assert mixed.politeness.max() <= 0.6
    assert 0 < mixed.changes.sum() < reacts.sum()
    np.testing.assert_allclose(pushy.headway, 0.6)
    np.testing.assert_allclose(pushy.desired_speed[reacts], 1.2 * plain.desired_speed[reacts], rtol=1e-6)
    assert (pushy.politeness == 0).all()
    assert pushy.changes[reacts].all()


@pytest.mark.parametrize("name", MANNERS)
def test_only_those_who_do_not_yield_look_at_nobody(name):
    sim = mannered_sim(SimParams(), name)
    assert (sim == SimParams()) == (name != "non_yielding")
    margin = sim.reaction.margin
    assert sim.replace(reaction=sim.reaction.replace(margin=SimParams().reaction.margin)) == SimParams()
    assert (margin > 100) == (name == "non_yielding")


def test_who_is_replayed_moves_as_in_the_log(world):
    log = jax.tree.map(np.asarray, make([0.0, 1.0, 2.0], others=[(12.0, 0.0, 0.1, 4.0), (0.0, 3.5, 0.2, 5.0)]))
    kind = jnp.full((3, 2), int(RoadUser.CYCLIST), jnp.int32)
    there = np.array([[True, False], [True, True], [True, True]])
    for them in (log.traffic.replace(valid=there), log.traffic.replace(valid=there, kind=kind)):
        found = as_recorded(world, log.replace(traffic=them), period=0.1)
        assert not found.traffic.valid.any()
        for name in ("position", "heading", "speed", "valid"):
            np.testing.assert_array_equal(getattr(found.replay, name), getattr(them, name), err_msg=name)
        for name in ("length", "width"):
            np.testing.assert_array_equal(getattr(found.replay, name), getattr(them, name)[0], err_msg=name)
        assert found.replay.period == pytest.approx(0.1)
        expected = RoadUser.VEHICLE if them.kind is None else RoadUser.CYCLIST
        assert found.replay.kind.tolist() == [expected, expected]
    assert found.ego is world.ego
