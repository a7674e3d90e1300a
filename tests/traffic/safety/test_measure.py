import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.traffic.safety.scenes import drive, objects, outline, pick, random_objects
from urbanjax.traffic.safety.boxes import box_time_to_collision
from urbanjax.traffic.safety.encroachment import post_encroachment_time
from urbanjax.traffic.safety.leaders import Leaders, follow, nearest_ahead
from urbanjax.traffic.safety.measure import SafetyParams, measure
from urbanjax.traffic.safety.rss import rss
from urbanjax.types import ScenarioError

DT, T, V = 0.2, 12, 5
PARAMS = SafetyParams(ttc_threshold=3.0, pet_window=8)


@pytest.fixture(scope="module")
def evaluate():
    return jax.jit(lambda tracks: measure(tracks, DT, params=PARAMS))


def traffic(seed, dtype=None):
    """A dense lane and crossing vehicles, at random; some samples absent."""
    rng = np.random.default_rng(seed)
    start = random_objects(rng, (V,), 25.0)
    start = start.replace(heading=start.heading * np.array([0.02, 0.02, 0.02, 1, 1]))
    across = start.position * np.array([[1.0, 0.05], [1.0, 0.05], [1.0, 0.05], [1, 1], [1, 1]])
    tracks = drive(start.replace(position=across), T, DT)
    tracks = tracks.replace(valid=jnp.asarray(rng.random((T, V)) < 0.85))
    return jax.tree.map(lambda x: x if x.dtype == bool else x.astype(dtype or x.dtype), tracks)


def host(tree):
    return jax.tree.map(np.asarray, tree)


def leader_of(scene, i):
    """The nearest one whose corners reach into the strip ahead, by a loop; None without one."""
    heading = float(scene.heading[i])
    frame = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    best, gap = None, np.inf
    for j in range(V):
        if i == j or not (scene.valid[i] and scene.valid[j]):
            continue
        centre = (np.asarray(scene.position[j] - scene.position[i], float)) @ frame
        corners = (outline(pick(scene, j)) - np.asarray(scene.position[i], float)) @ frame
        in_strip = corners[:, 1].min() < scene.width[i] / 2 and corners[:, 1].max() > -scene.width[i] / 2
        found = centre[0] - (corners[:, 0].max() - corners[:, 0].min()) / 2 - float(scene.length[i]) / 2
        if centre[0] > 0 and in_strip and found < gap:
            best, gap = j, found
    return best, gap


def test_the_leader_is_the_nearest_in_the_own_strip(x64):
    find, behind = jax.jit(nearest_ahead), jax.jit(follow)
    some = 0
    for seed in range(15):
        scene = host(pick(traffic(seed), 0))
        found = find(scene)
        for i in range(V):
            expected, gap = leader_of(scene, i)
            assert bool(found.exists[i]) == (expected is not None)
            if expected is not None:
                some += 1
                assert found.index[i] == expected
                measured = behind(pick(scene, i), pick(scene, expected))
                np.testing.assert_allclose(measured.gap, gap, atol=1e-9)
    assert 15 < some < 60


def test_it_is_a_loop_over_samples_and_pairs(x64, evaluate):
    collision, danger = jax.jit(box_time_to_collision), jax.jit(lambda a, b: rss(a, b, params=PARAMS.rss).margin)
    late = jax.jit(lambda a, b: post_encroachment_time(a, b, dt=DT, window=PARAMS.pet_window))
    tracks = traffic(1)
    found = evaluate(tracks)
    ttc, margin, pet = np.full((T, V, V), np.inf), np.full((T, V, V), np.inf), np.full((V, V), np.inf)
    for i, j in ((i, j) for i in range(V) for j in range(V) if i != j):
        one, two = (jax.tree.map(lambda x, k=k: x[:, k], host(tracks)) for k in (i, j))
        pet[i, j] = late(one, two)
        for k in range(T):
            ttc[k, i, j], margin[k, i, j] = collision(pick(one, k), pick(two, k)), danger(pick(one, k), pick(two, k))
    np.testing.assert_allclose(found.pairs.box_ttc, ttc.min(0), rtol=1e-9)
    np.testing.assert_allclose(found.pairs.pet, pet, rtol=1e-9)
    np.testing.assert_allclose(found.pairs.rss_time, DT * (margin < 0).sum(0), rtol=1e-9)
    np.testing.assert_allclose(found.series.box_ttc, ttc.min(2), rtol=1e-9)
    np.testing.assert_allclose(found.series.rss_margin, margin.min(2), rtol=1e-9)
    valid, least = np.asarray(tracks.valid), ttc.min(2)
    summary = found.summary
    np.testing.assert_allclose(summary.min_box_ttc, least.min(0), rtol=1e-9)
    np.testing.assert_allclose(summary.box_tet, DT * (least <= 3).sum(0), rtol=1e-9)
    np.testing.assert_allclose(summary.box_tit, DT * np.maximum(3 - least, 0).sum(0), rtol=1e-9)
    np.testing.assert_allclose(summary.min_pet, np.minimum(pet.min(0), pet.min(1)), rtol=1e-9)
    np.testing.assert_allclose(summary.rss_share, (margin.min(2) < 0).sum(0) / valid.sum(0), rtol=1e-9)
    assert np.isfinite(least).any()
    assert (np.asarray(summary.rss_share) > 0).any()
    assert np.isfinite(pet).any()


def following_by_loop(tracks):
    """Time to collision and deceleration [T, V] of every vehicle behind its leader."""
    ttc, deceleration = np.full((T, V), np.inf), np.zeros((T, V))
    tracks = host(tracks)
    for k in range(T):
        scene = pick(tracks, k)
        for i in range(V):
            j, gap = leader_of(scene, i)
            if j is not None:
                closing = float(scene.speed[i] - scene.speed[j] * np.cos(scene.heading[j] - scene.heading[i]))
                ttc[k, i] = 0 if gap <= 0 else gap / closing if closing > 0 else np.inf
                deceleration[k, i] = np.inf if gap <= 0 else max(closing, 0) ** 2 / (2 * gap)
    return ttc, deceleration


def test_the_summary_of_following_is_over_the_followers_own_time(x64, evaluate):
    met = 0
    for seed in (8, 9, 10):
        tracks = traffic(seed)
        ttc, deceleration = following_by_loop(tracks)
        met += np.isfinite(ttc).sum()
        found = evaluate(tracks)
        series, summary = found.series.following, found.summary
        np.testing.assert_allclose(series.ttc, ttc, rtol=1e-9)
        np.testing.assert_allclose(series.deceleration, deceleration, rtol=1e-9)
        np.testing.assert_allclose(summary.min_ttc, ttc.min(0), rtol=1e-9)
        np.testing.assert_allclose(summary.max_deceleration, deceleration.max(0), rtol=1e-9)
        np.testing.assert_allclose(summary.tet, DT * (ttc <= 3).sum(0), rtol=1e-9)
        np.testing.assert_allclose(summary.tit, DT * np.maximum(3 - ttc, 0).sum(0), rtol=1e-9)
    assert met > 10


def test_an_absent_vehicle_changes_nothing_whatever_its_entries(evaluate):
    tracks = traffic(3)
    gone = tracks.replace(valid=tracks.valid.at[:, 2].set(False))
    wild = jax.tree.map(lambda x: x if x.dtype == bool else x.at[:, 2].set(jnp.nan), gone)
    without = jax.tree.map(lambda x: jnp.delete(x, 2, axis=1), tracks)
    found = evaluate(wild)
    jax.tree.map(np.testing.assert_array_equal, found, evaluate(gone))
    expected = evaluate(without).summary
    for name in expected.__dataclass_fields__:
        one, other = np.delete(getattr(found.summary, name), 2), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=1e-4, err_msg=name)
    alone = jax.tree.map(lambda x: x[2], found.summary)
    assert np.isinf([alone.min_ttc, alone.min_box_ttc, alone.min_pet, alone.min_headway]).all()
    assert not np.any([alone.max_deceleration, alone.tet, alone.tit, alone.box_tet, alone.box_tit, alone.rss_share])


def test_vehicles_may_be_listed_in_any_order(evaluate):
    tracks, order = traffic(4), np.array([3, 1, 4, 0, 2])
    found, reference = evaluate(jax.tree.map(lambda x: x[:, order], tracks)).summary, evaluate(tracks).summary
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y[order], rtol=1e-5), found, reference)


def test_scenarios_go_through_vmap(evaluate):
    scenes = [traffic(5), traffic(6)]
    found = jax.vmap(evaluate)(jax.tree.map(lambda *x: jnp.stack(x), *scenes)).summary
    for k, scene in enumerate(scenes):
        jax.tree.map(lambda x, y, k=k: np.testing.assert_allclose(x[k], y, rtol=1e-4), found, evaluate(scene).summary)


def test_single_precision_agrees_with_double(evaluate):
    single = evaluate(traffic(7, jnp.float32))
    with jax.enable_x64(True):
        tracks = jax.tree.map(lambda x: x if x.dtype == bool else x.astype(jnp.float64), traffic(7, jnp.float32))
        double = evaluate(tracks)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4), single, double)


def test_a_given_leader_takes_the_place_of_the_nearest(evaluate):
    start = objects([[0.0, 0.0], [20.0, 0.0], [50.0, 0.0]], np.zeros(3), [10.0, 8.0, 4.0])
    tracks = drive(start, T, DT)
    given = Leaders(jnp.array([2, 2, 0]), jnp.array([True, False, True]))
    led = jax.jit(lambda tracks, leaders: measure(tracks, DT, params=PARAMS, leaders=leaders))
    found = led(tracks, given).series.following
    np.testing.assert_allclose(found.gap[0], [46, np.inf, np.inf], rtol=1e-6)  # one behind is no leader
    np.testing.assert_allclose(found.ttc[0], [46 / 6, np.inf, np.inf], rtol=1e-6)
    np.testing.assert_array_equal(found.exists[0], [True, False, False])
    each = jax.tree.map(lambda x: jnp.broadcast_to(x, (T, 3)), given)
    np.testing.assert_array_equal(led(tracks, each).series.following.ttc, found.ttc)
    nearest = evaluate(tracks).series
    np.testing.assert_array_equal(nearest.leader.index[0][:2], [1, 2])
    np.testing.assert_allclose(nearest.following.gap[0], [16, 26, np.inf], rtol=1e-6)


NAMES = ("position", "heading", "speed")


@jax.jit
def terms(tracks, step, direction):
    """What is differentiable in the summary of tracks moved by a step in a direction."""
    moved = {name: getattr(tracks, name) + step * way for name, way in zip(NAMES, direction, strict=True)}
    s = measure(tracks.replace(**moved), DT, params=PARAMS).summary
    return jnp.stack([s.min_ttc[0], s.min_headway[0], s.max_deceleration[0], s.tit[0], *s.min_box_ttc, *s.box_tit])


slope_of_terms = jax.jit(lambda tracks, direction: jax.jvp(lambda s: terms(tracks, s, direction), (0.0,), (1.0,))[1])


@pytest.mark.parametrize("which", range(3), ids=NAMES)
def test_gradients_of_the_summary_equal_central_differences(x64, which):
    start = objects([[0.0, 0.0], [20.0, 0.4], [4.0, -24.0]], [0.01, -0.02, 1.4], [12.0, 7.0, 9.0])
    tracks = drive(start, 6, DT)
    rng = np.random.default_rng(0)
    direction = [rng.normal(size=np.shape(getattr(tracks, name))) * (NAMES[which] == name) for name in NAMES]
    slope = np.asarray(slope_of_terms(tracks, direction))
    finite = np.isfinite(np.asarray(terms(tracks, 0.0, direction)))
    assert finite.sum() >= 6
    up, down = (np.asarray(terms(tracks, step, direction))[finite] for step in (1e-6, -1e-6))
    assert (np.abs(up - down) > 1e-8).sum() >= 4
    np.testing.assert_allclose(slope[finite], (up - down) / 2e-6, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(slope[~finite], 0)


def test_gradients_are_finite_where_vehicles_stand_coincide_touch_or_are_absent():
    position = np.array([[0.0, 0], [0, 0], [4, 0], [30, 0], [np.nan, np.nan]])
    start = objects(position, [0.0, 0, 0, 0, np.nan], [0.0, 0, 0, 5, np.nan], valid=[True, True, True, True, False])
    tracks = drive(start, 4, DT)

    def total(position, heading, speed):
        found = measure(tracks.replace(position=position, heading=heading, speed=speed), DT, params=PARAMS)
        return sum(jnp.sum(jnp.where(jnp.isinf(x), 0, x)) for x in jax.tree.leaves(found.summary))

    for slope in jax.jit(jax.grad(total, (0, 1, 2)))(tracks.position, tracks.heading, tracks.speed):
        assert np.isfinite(slope).all()


def test_wrong_shapes_are_named():
    tracks = traffic(0)
    with pytest.raises(ScenarioError, match=r"tracks\.speed has the shape \(5,\)"):
        measure(tracks.replace(speed=tracks.speed[0]), DT, params=PARAMS)
    with pytest.raises(ScenarioError, match=r"tracks\.valid has the shape .*vmap"):
        measure(jax.tree.map(lambda x: x[None], tracks), DT, params=PARAMS)
    with pytest.raises(ScenarioError, match=r"leaders\.index has the shape \(3,\)"):
        measure(tracks, DT, params=PARAMS, leaders=Leaders(jnp.zeros(3, jnp.int32), jnp.zeros(V, bool)))
