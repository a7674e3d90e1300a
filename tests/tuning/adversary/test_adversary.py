"""What is found is a failure, what is called avoidable is, and the threat leads there."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.tuning.adversary.conftest import Lane
from urbanjax.sim.scenarios.encounter_families import FAMILIES
from urbanjax.tuning import space
from urbanjax.tuning.adversary import KrigedSearch, distinct, hunt
from urbanjax.tuning.adversary.arena import PARTS
from urbanjax.tuning.adversary.hunt import Trial
from urbanjax.types import as_arrays
from urbanjax.types.errors import TuningError


def test_somebody_a_metre_ahead_is_fate(lane):
    _, failed, oracle = lane.judge(lane.encounter(1.0))
    assert failed
    assert not oracle.avoidable
    assert np.isneginf(oracle.latest)


def test_a_slow_leader_far_ahead_is_avoidable_up_to_its_braking_distance(lane):
    # 40 m at 10 m/s: contact after 4 s; full braking needs 10**2 / 12 = 8.33 m, so it may begin until 3.16 s.
    _, failed, oracle = lane.judge(lane.encounter(40.0))
    assert failed
    assert oracle.avoidable
    assert oracle.latest == pytest.approx((40 - 100 / 12) / 10, abs=0.1)


def test_nobody_can_know_before_the_onset(lane):
    _, failed, oracle = lane.judge(lane.encounter(40.0, onset=3.3))
    assert failed
    assert not oracle.avoidable


def test_whoever_is_not_reached_is_no_failure(lane):
    value, failed, _ = lane.judge(lane.encounter(60.0, speed=9.0))
    assert not failed
    assert value > 40


def test_slope_of_the_threat_equals_central_differences():
    with jax.enable_x64(True):
        lane, step = Lane(), 1e-6
        start = lane.encounter(30.0, speed=9.0, brakes_at=0.43, braking=5.0)
        threat = jax.jit(lambda one: lane.threat(one, 12))
        slope = jax.grad(threat)(start)
        for name in ("ego_speed", "station", "speed", "brakes_at", "braking"):
            one, other = (threat(start.replace(**{name: getattr(start, name) + x})) for x in (step, -step))
            assert float(getattr(slope, name)) == pytest.approx(float(one - other) / (2 * step), rel=1e-5), name
        assert float(slope.station) == pytest.approx(1, abs=1e-3)  # one metre more is one metre more


@pytest.mark.parametrize("name", FAMILIES)
def test_any_z_is_within_the_stated_ranges(name):
    numbers = FAMILIES[name].numbers
    of, base = space(numbers, "*"), as_arrays(numbers)
    assert len(of.keys) == len(dataclasses.fields(numbers))
    for z in (*np.random.default_rng(0).normal(size=(20, len(of.keys))) * 1e3, np.zeros(len(of.keys))):
        values = of.params(jnp.asarray(z, float), base)
        for number in of.numbers:
            assert number.low <= getattr(values, number.key) <= number.high + 1e-5


@pytest.mark.parametrize("search", ["gradient", "values", "random", "cma_es"])
def test_whoever_sees_nobody_is_found_to_fail(lane, search):
    found = hunt(lane.arena, search, seed=1, budget=40.0, cost_of_gradient=2.0)
    assert found.failures
    assert found.trials[-1].cost <= 40
    assert len(distinct(lane.arena, found.failures)) <= len(found.failures)


def test_failures_of_one_cell_count_once(lane):
    near = [Trial(np.full(5, x), 1.0, 0.0, True, True, 0.0, False) for x in (0.01, 0.02, 3.0)]
    assert distinct(lane.arena, near) == [near[0], near[2]]
    assert PARTS == 3


def bowl_of(seed: int, *, sloped: int, budget: float) -> tuple[set[tuple[int, ...]], list[int]]:
    """Cells with a find, and sizes of generations with slopes, in a bowl of three numbers that chance seldom hits."""
    bottom, found, sizes, cost = np.array([2.0, -1.5, 1.5]), set(), [], 0.0

    def cells(z: np.ndarray) -> np.ndarray:
        return np.floor(z / 0.7).astype(int)

    search = KrigedSearch(np.zeros(3), sigma=1.7, seed=seed, cells=cells, found=-5.0, population=8, sloped=sloped)
    while cost < budget:
        z, asks = search.ask(), search.needs_gradient
        losses = 4 * ((z - bottom) ** 2).sum(1)
        finds = losses < 2.0
        found |= set(map(tuple, cells(z[finds])))
        cost += len(z) * (2 if asks else 1)
        sizes += [len(z)] if asks else []
        search.tell(z, losses - 20 * finds, gradients=8 * (z - bottom) if asks else None)
    return found, sizes


def test_a_kriged_search_goes_where_chance_seldom_comes_and_slopes_lead_it_there():
    with_slopes = [bowl_of(seed, sloped=4, budget=96) for seed in range(4)]
    values = [bowl_of(seed, sloped=0, budget=96)[0] for seed in range(4)]
    drawn = np.random.default_rng(0).normal(size=(4 * 96, 3)) * 1.7
    by_chance = ((drawn - np.array([2.0, -1.5, 1.5])) ** 2).sum(1) < 0.5
    assert sum(len(found) for found, _ in with_slopes) > 3 * by_chance.sum()
    assert sum(len(found) for found in values) > 3 * by_chance.sum()
    assert all(set(sizes) == {4} for _, sizes in with_slopes)


def test_a_generation_has_a_point_of_each_cell_and_none_where_a_find_is_known():
    search = KrigedSearch(
        np.zeros(2), sigma=1.0, seed=0, cells=lambda z: (z > 0).astype(int), found=-5.0, population=8, sloped=0
    )
    z = search.ask()
    search.tell(z, np.where((z > 0).all(1), -15.0, 3.0))
    cells = {tuple(row) for row in search.ask() > 0}
    assert len(search.ask()) == 3
    assert cells == {(False, False), (False, True), (True, False)}


def test_sizes_that_are_none_are_refused():
    with pytest.raises(TuningError, match="population is 0"):
        KrigedSearch(np.zeros(2), sigma=1.0, seed=0, cells=np.sign, found=-5.0, population=0)


def test_a_gradient_that_is_not_finite_ends_no_search():
    search = KrigedSearch(np.zeros(2), sigma=1.0, seed=0, cells=np.sign, found=-5.0, population=4, sloped=2)
    z = search.ask()
    search.tell(z, np.full(4, 3.0))
    assert search.needs_gradient
    z = search.ask()
    search.tell(z, np.full(len(z), 2.0), gradients=np.full(z.shape, np.nan))
    assert np.isfinite(search.ask()).all()
