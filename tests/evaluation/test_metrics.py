import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.sim.conftest import Road
from urbanjax.evaluation import metrics, scores
from urbanjax.numerics.soft import Relaxation
from urbanjax.sim import log as logs
from urbanjax.types import Command, Objects, VehicleState, as_arrays
from urbanjax.vehicle.comfort import ComfortParams
from urbanjax.vehicle.params import VehicleParams

HARD, VEHICLE = Relaxation(), VehicleParams()
evaluate = jax.jit(metrics.evaluate)
clearance, collision, box_ttc, inverse_ttc = map(
    jax.jit, (metrics.clearance, metrics.collision, metrics.box_ttc, metrics.inverse_ttc)
)
record = jax.jit(logs.record)
STILL = Command(jnp.zeros(()), jnp.zeros(()))
score, terms = jax.jit(scores.score), jax.jit(scores.terms)
L, W = VEHICLE.length, VEHICLE.width


def make(ego_x=(0.0,), ego_y=0.0, ego_speed=10.0, others=(), dt=0.1, **fields):
    """A log of a drive along x past others, given as (x, y, heading, speed) and as large as the ego."""
    x = jnp.asarray(ego_x) * 1.0
    t = x.shape[0]
    zero = jnp.zeros(t)
    centre = jnp.stack([x, zero + ego_y], axis=1)
    ego = VehicleState(centre, zero, zero + ego_speed, fields.pop("acceleration", zero), fields.pop("steering", zero))
    rows = [jnp.asarray([row] * t) * 1.0 for row in others] or [jnp.zeros((t, 4))]
    other = jnp.stack(rows, axis=1)
    valid = jnp.full(other.shape[:2], bool(others))
    objects = Objects(other[..., :2], other[..., 2], other[..., 3], jnp.full_like(other[..., 0], L), valid, valid)
    objects = objects.replace(width=jnp.full_like(other[..., 0], W))
    base = {"along": ego.speed, "offset": zero, "road_margin": zero + 0.8}
    return logs.Log(jnp.arange(t) * dt, ego, Command(zero, zero), centre, traffic=objects, **(base | fields))


def test_progress_is_the_integral_of_the_speed():
    speed = jnp.asarray([0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(metrics.progress(make(np.zeros(4), along=speed)), [0, 0.05, 0.2, 0.45], rtol=1e-5)


def test_clearance_known_answers():
    log = make([0.0, 5.0, 9.0], others=[(12.0, 0.0, 0.0, 0.0), (0.0, 3.5, 0.0, 0.0)])
    found, others = clearance(log, VEHICLE, relaxation=HARD)
    assert others.all()
    np.testing.assert_allclose(found, [3.5 - W, 3.5 - W, 3.0 - L], atol=1e-5)
    alone = make([0.0, 1.0])
    assert not clearance(alone, VEHICLE, relaxation=HARD)[1].any()
    found = evaluate(alone, VEHICLE, relaxation=HARD)
    assert found.alone
    assert found.collision == 0
    assert np.isinf([found.ttc_lane, found.ttc_box]).all()
    late = log.replace(traffic=log.traffic.replace(valid=jnp.asarray([[False, False], [False, False], [True, False]])))
    found = evaluate(late, VEHICLE, relaxation=HARD)
    assert not found.alone
    np.testing.assert_allclose(found.clearance, 3.0 - L, atol=1e-5)


def test_collision_and_off_road_are_yes_or_no_when_hard():
    near = make([0.0, 5.0], others=[(11.0, 0.0, 0.0, 0.0)])
    hit = make([0.0, 7.0], others=[(11.0, 0.0, 0.0, 0.0)])
    assert collision(near, VEHICLE, relaxation=HARD) == 0
    assert collision(hit, VEHICLE, relaxation=HARD) == 1
    assert metrics.off_road(near, HARD) == 0
    assert metrics.off_road(near.replace(road_margin=jnp.asarray([0.5, -0.1])), HARD) == 1


def test_time_to_collision_behind_a_slower_vehicle():
    log = make(ego_speed=10.0, others=[(20.0 + L, 0.2, 0.0, 4.0), (15.0, 3.5, 0.0, 0.0)])
    np.testing.assert_allclose(1 / inverse_ttc(log, VEHICLE, relaxation=HARD), 20 / 6, rtol=1e-5)
    np.testing.assert_allclose(box_ttc(log, VEHICLE), 20 / 6, rtol=1e-5)


@pytest.mark.parametrize("other", [(30.0, 0.0, 0.0, 12.0), (-20.0, 0.0, 0.0, 5.0), (30.0, 3.5, 0.0, 0.0)])
def test_no_time_to_collision_where_nothing_comes_closer_in_the_way(other):
    log = make(ego_speed=10.0, others=[other])
    assert inverse_ttc(log, VEHICLE, relaxation=HARD)[0] == 0
    assert box_ttc(log, VEHICLE)[0] == np.inf
    assert evaluate(log_of_two(log), VEHICLE, relaxation=HARD).ttc_lane == np.inf


def log_of_two(log):
    later = jax.tree.map(lambda x: jnp.concatenate([x, x]), log)
    return later.replace(time=jnp.asarray([0.0, 0.1]))


def test_box_time_of_a_crossing_vehicle():
    # It comes from the right at 8 m/s towards the point 30 m ahead, where the ego is after 3 s.
    log = make(ego_speed=10.0, others=[(30.0, -24.0, np.pi / 2, 8.0)])
    first_touch = max((30 - L / 2 - W / 2) / 10, (24 - W / 2 - L / 2) / 8)
    np.testing.assert_allclose(box_ttc(log, VEHICLE), first_touch, rtol=1e-5)
    late = make(ego_speed=10.0, others=[(30.0, -45.0, np.pi / 2, 8.0)])
    assert box_ttc(late, VEHICLE)[0] == np.inf


def test_box_time_equals_a_fine_search():
    rng = np.random.default_rng(2)
    rows = np.c_[rng.uniform(-20, 20, (200, 2)), rng.uniform(-4, 4, 200), rng.uniform(0, 12, 200)]
    log = make(ego_speed=6.0, others=rows.tolist())
    each = [jax.tree.map(lambda x, i=i: x[:, i : i + 1], log.traffic) for i in range(200)]
    found = np.stack([box_ttc(log.replace(traffic=one), VEHICLE)[0] for one in each[:40]])
    times = jnp.arange(0.0, 8.0, 0.005)

    @jax.jit
    def touching(one):
        way = jnp.stack([jnp.cos(one.heading[0, 0]), jnp.sin(one.heading[0, 0])]) * one.speed[0, 0]
        moved = one.position[0] + times[:, None] * way[None, :]
        many = jax.tree.map(lambda x: jnp.broadcast_to(x[0], (times.shape[0], *x.shape[1:])), one)
        path = make(6.0 * times).replace(traffic=many.replace(position=moved[:, None, :]))
        return clearance(path, VEHICLE, relaxation=HARD)[0] <= 0

    hits = np.stack([touching(one) for one in each[:40]])
    expected = np.where(hits.any(1), times[hits.argmax(1)], np.inf)
    assert 5 < hits.any(1).sum() < 35
    agree = np.isclose(found, expected, rtol=0, atol=0.01)  # two that never meet agree too
    # A graze shorter than the search's step may be missed by it, and times beyond its end are not searched.
    assert np.all(agree | (np.asarray(found) > 7.9) | ((expected == np.inf) & (np.asarray(found) < np.inf)))
    assert agree.sum() >= 37


def test_comfort_known_answers():
    log = make(np.zeros(3), ego_speed=jnp.asarray([8.0, 6.0, 7.0]), acceleration=jnp.asarray([0.0, -2.0, 1.0]))
    found = evaluate(log.replace(ego=log.ego.replace(steering=jnp.full(3, 0.1))), VEHICLE, relaxation=HARD)
    assert found.min_speed == 6
    assert found.speed_drop == 2
    assert found.max_acceleration == 2
    np.testing.assert_allclose(found.max_jerk, 30.0, rtol=1e-5)
    np.testing.assert_allclose(found.max_lateral, 64 * np.tan(0.1) / VEHICLE.wheelbase, rtol=1e-5)


def test_hard_metrics_are_the_limit_of_soft_ones():
    log = make([0.0, 4.0], others=[(14.0, 1.0, 0.1, 3.0), (9.0, 4.0, 0.0, 9.0)], road_margin=jnp.asarray([0.4, 0.2]))
    hard = evaluate(log, VEHICLE, relaxation=HARD)
    soft = evaluate(log, VEHICLE, relaxation=Relaxation(1e-3, "soft"))
    for a, b in zip(jax.tree.leaves(hard), jax.tree.leaves(soft), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-2, atol=1e-2)


def test_overlaps_of_all_pairs():
    log = make(others=[(0.0, 0.0, 0.0, 0.0), (4.0, 0.5, 0.0, 0.0), (20.0, 0.0, 0.0, 0.0), (21.0, 0.0, 0.0, 0.0)])
    objects = jax.tree.map(lambda x: x[0], log.traffic)
    found = metrics.overlaps(objects.replace(valid=jnp.asarray([True, True, True, False])))
    expected = np.zeros((4, 4), bool)
    expected[0, 1] = expected[1, 0] = True
    np.testing.assert_array_equal(found, expected)


def test_record_measures_lane_and_road():
    road = Road()
    world = road.world(road.traffic(), ego_x=50.0, ego_y=0.6, ego_speed=8.0, heading=0.1)
    entry = record(road.params, road.lanes, world=world, command=STILL)
    half = L / 2 - 0.95
    y = 0.6 + half * np.sin(0.1)
    np.testing.assert_allclose(entry.offset, y, atol=1e-5)
    np.testing.assert_allclose(entry.along, 8 * np.cos(0.1), rtol=1e-5)
    lowest = y - L / 2 * np.sin(0.1) - W / 2 * np.cos(0.1)
    np.testing.assert_allclose(entry.road_margin, lowest + 1.75, atol=1e-4)
    # Crossing the line between the lanes leaves the road's edge as far away as it was.
    middle = road.world(road.traffic(), ego_x=50.0, ego_y=1.75)
    entry = record(road.params, road.lanes, world=middle, command=STILL)
    np.testing.assert_allclose(entry.road_margin, 3.5 - W / 2, atol=1e-4)
    outside = road.world(road.traffic(), ego_x=50.0, ego_y=-1.2)
    entry = record(road.params, road.lanes, world=outside, command=STILL)
    np.testing.assert_allclose(entry.road_margin, 1.75 - 1.2 - W / 2, atol=1e-4)


def test_score_prefers_more_progress_room_and_comfort():
    params, soft = scores.ScoreParams(), Relaxation(0.1, "soft")

    def total(log):
        return score(log, VEHICLE, params=params, relaxation=soft)

    base = make(np.arange(10.0), others=[(5.0, 3.5, 0.0, 0.0)])
    worse = {
        "slow": base.replace(along=0.5 * base.along),
        "near": make(np.arange(10.0), others=[(5.0, 2.2, 0.0, 0.0)]),
        "edge": base.replace(road_margin=base.road_margin - 0.8),
        "rough": base.replace(ego=base.ego.replace(acceleration=jnp.asarray([0.0, 2.0] * 5))),
        "wide": base.replace(offset=base.offset + 0.7),
        "curved": base.replace(ego=base.ego.replace(steering=base.ego.steering + 0.05)),
    }
    assert all(total(log) < total(base) for log in worse.values())
    terms = scores.terms(base, VEHICLE, params=params, relaxation=soft)
    parts = [getattr(terms, name) for name in terms.__dataclass_fields__ if name != "total"]
    np.testing.assert_allclose(sum(parts), terms.total, rtol=1e-6)


def test_every_term_of_the_score_is_weighed_as_it_says():
    gas = jnp.asarray([0.0, 1.0, 2.0])
    how = {"acceleration": gas, "steering": jnp.full(3, 0.05), "offset": jnp.ones(3), "road_margin": jnp.full(3, 0.15)}
    log = make([0.0, 1.0, 2.0], others=[(0.0, W + 0.75, 0.0, 10.0), (2.0, W + 0.75, 0.0, 10.0)], **how)
    found = terms(log, VEHICLE)
    wanted = {
        "progress": 1.0,
        "clearance": -2.0 * 0.5**2,
        "road": -2.0 * 0.5**2,
        "acceleration": -0.1 * np.mean((gas / 2) ** 2),
        "lateral": -0.1 * (100 * np.tan(0.05) / VEHICLE.wheelbase / 2) ** 2,
        "jerk": -0.02 * (10 / 4) ** 2,
        "lane": -0.05 * (1 / 0.5) ** 2,
        "discomfort": 0.0,
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-4, err_msg=name)
    np.testing.assert_allclose(found.total, sum(wanted.values()), rtol=1e-4)


def test_nearness_to_the_bounds_of_comfort_counts_where_it_is_asked_for():
    bounds = ComfortParams()
    asked = scores.ScoreParams(discomfort=2.0, nearness=0.2)

    def discomfort(*gas):
        return float(terms(make(np.arange(3.0), acceleration=jnp.asarray(gas)), VEHICLE, params=asked).discomfort)

    assert discomfort(*[0.8 * bounds.acceleration] * 3) == pytest.approx(0.0, abs=1e-5)
    assert discomfort(*[bounds.acceleration] * 3) == pytest.approx(-2.0, rel=1e-5)
    assert discomfort(*[-bounds.deceleration] * 3) == pytest.approx(-2.0, rel=1e-5)


def test_gradient_of_the_score_matches_differences():
    with jax.enable_x64(True):
        soft = as_arrays(Relaxation(0.1, "soft"))
        params = as_arrays(scores.ScoreParams())
        log = make(np.linspace(0.0, 9.0, 6), others=[(8.0, 2.1, 0.05, 3.0), (15.0, 0.4, 0.0, 0.0)])
        log = log.replace(ego=log.ego.replace(acceleration=jnp.linspace(0.0, 1.0, 6)), road_margin=log.time - 0.1)

        @jax.jit
        @jax.value_and_grad
        def value(x):
            moved = log.replace(
                centre=log.centre + x[:2][None, :],
                along=log.along * (1 + x[2]),
                ego=log.ego.replace(heading=log.ego.heading + x[3], steering=log.ego.steering + x[4]),
                road_margin=log.road_margin + x[5],
            )
            return scores.score(moved, VEHICLE, params=params, relaxation=soft)

        x = jnp.full(6, 0.01)
        gradient, size = value(x)[1], 1e-6
        differences = [(value(x + size * e)[0] - value(x - size * e)[0]) / (2 * size) for e in np.eye(6)]
        np.testing.assert_allclose(gradient, differences, rtol=1e-5, atol=1e-8)
        assert np.all(np.abs(gradient) > 1e-6)


def test_gradient_is_finite_at_a_standstill_on_one_spot():
    log = make(np.zeros(4), ego_speed=0.0, others=[(0.0, 0.0, 0.0, 0.0)])

    def value(log):
        soft = Relaxation(0.1, "soft")
        found = metrics.evaluate(log, VEHICLE, relaxation=soft)
        return scores.score(log, VEHICLE, params=scores.ScoreParams(), relaxation=soft) + sum(jax.tree.leaves(found))

    gradient = jax.jit(jax.grad(value, allow_int=True))(log)
    floats = [g for g in jax.tree.leaves(gradient) if jnp.issubdtype(g.dtype, jnp.floating)]
    assert all(np.all(np.isfinite(g)) for g in floats)
