"""Edie's flow, density and speed: uniform streams, standing queues, conservation over grids and laps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.traffic.flow import edie

region, diagram = jax.jit(edie.region), jax.jit(edie.diagram)
TIME = np.arange(0, 61, 3).astype(np.float32)


def stream(speed=10.0, headway=2.0, vehicles=40):
    """Vehicles that pass station 0 every `headway` seconds, from long before the first sample."""
    passed = headway * (np.arange(vehicles) - vehicles // 2)
    return np.float32(speed * (TIME[None] - passed[:, None]))


WAY = stream()
ALL = np.ones(WAY.shape, bool)
PERIOD, REACH = np.float32([7.3, 41.3]), np.float32([13.0, 97.0])


def test_a_uniform_stream_has_its_flow_density_and_speed():
    found = region(WAY, TIME, mask=ALL, period=np.float32([10, 40]), reach=np.float32([20, 100]))
    assert found.flow == pytest.approx(0.5, rel=1e-4)
    assert found.density == pytest.approx(0.05, rel=1e-4)
    assert found.speed == pytest.approx(10, rel=1e-4)


def test_a_standing_queue_has_density_and_no_flow():
    way = np.float32(np.repeat([[0.0], [8], [16], [24], [100]], len(TIME), axis=1))
    found = region(way, TIME, mask=ALL[:5], period=np.float32([5, 50]), reach=np.float32([0, 24]))
    assert found.flow == 0
    assert found.density == pytest.approx(3 / 24, rel=1e-5)
    assert found.speed == 0
    assert found.occupied
    empty = region(way, TIME, mask=ALL[:5], period=np.float32([5, 50]), reach=np.float32([30, 40]))
    assert not empty.occupied
    assert empty.speed == 0


def test_pieces_are_cut_exactly_by_the_sides():
    rng = np.random.default_rng(0)
    way = np.float32(np.cumsum(rng.uniform(-5, 40, (6, len(TIME))), axis=1) - 100)
    fine = np.linspace(TIME[0], TIME[-1], 600_001)
    spent = driven = 0.0
    for row in way:
        x = np.interp(fine, TIME, row)
        middle, t = 0.5 * (x[1:] + x[:-1]), 0.5 * (fine[1:] + fine[:-1])
        held = (middle > REACH[0]) & (middle < REACH[1]) & (t > PERIOD[0]) & (t < PERIOD[1])
        spent += held.sum() * (fine[1] - fine[0])
        driven += np.diff(x)[held].sum()
    found = region(way, TIME, mask=ALL[:6], period=PERIOD, reach=REACH)
    assert found.time == pytest.approx(spent, rel=1e-3)
    assert found.distance == pytest.approx(driven, rel=1e-3)


def test_cells_of_a_grid_add_up_to_the_whole():
    times, stations = np.linspace(*PERIOD, 5, dtype=np.float32), np.linspace(*REACH, 4, dtype=np.float32)
    cells = diagram(WAY, TIME, mask=ALL, times=times, stations=stations)
    whole = region(WAY, TIME, mask=ALL, period=PERIOD, reach=REACH)
    assert cells.flow.shape == (4, 3)
    assert cells.time.sum() == pytest.approx(float(whole.time), rel=1e-4)
    assert cells.distance.sum() == pytest.approx(float(whole.distance), rel=1e-4)
    one = region(WAY, TIME, mask=ALL, period=times[1:3], reach=stations[2:])
    assert cells.flow[1, 2] == pytest.approx(float(one.flow), rel=1e-5)
    np.testing.assert_allclose(cells.speed, 10, rtol=1e-4)


def test_laps_of_a_closed_course_all_count():
    length = 120.0
    way = np.float32(15 * TIME + np.array([[0.0], [30], [60], [90]]))
    ring = diagram(
        way, TIME, mask=ALL[:4], times=np.float32([0, 30, 60]), stations=np.float32([0, 50, 120]), length=length
    )
    np.testing.assert_allclose(ring.density, 4 / 120, rtol=0.02)
    np.testing.assert_allclose(ring.flow, 15 * 4 / 120, rtol=0.02)
    assert ring.time.sum() == pytest.approx(4 * 60, rel=1e-4)
    assert ring.distance.sum() == pytest.approx(4 * 60 * 15, rel=1e-4)
    back = diagram(
        -way, TIME, mask=ALL[:4], times=np.float32([0, 30, 60]), stations=np.float32([0, 50, 120]), length=length
    )
    assert back.time.sum() == pytest.approx(4 * 60, rel=1e-4)
    np.testing.assert_allclose(back.speed, -15, rtol=1e-4)


def test_single_precision_is_enough_after_many_kilometres(x64):
    way = WAY.astype(float) + 20_000.3
    reach = REACH + 20_000.0
    exact = region(way, TIME.astype(float), mask=ALL, period=PERIOD.astype(float), reach=reach.astype(float))
    single = region(way.astype(np.float32), TIME, mask=ALL, period=PERIOD, reach=reach.astype(np.float32))
    for name in ("flow", "density", "speed"):
        assert getattr(single, name) == pytest.approx(float(getattr(exact, name)), rel=1e-4)


def test_order_of_vehicles_padding_and_missing_samples():
    whole = region(WAY, TIME, mask=ALL, period=PERIOD, reach=REACH)
    padded = np.concatenate([WAY[::-1], np.full((3, len(TIME)), np.nan, np.float32)])
    again = region(padded, TIME, mask=np.isfinite(padded), period=PERIOD, reach=REACH)
    assert again.flow == pytest.approx(float(whole.flow), rel=1e-5)
    mask = ALL.copy()
    mask[:, 7] = False
    gap = region(WAY, TIME, mask=mask, period=PERIOD, reach=REACH)
    without = region(WAY, TIME, mask=ALL, period=PERIOD, reach=REACH)
    cut = region(WAY, TIME, mask=ALL, period=TIME[[6, 8]], reach=REACH)
    assert gap.time == pytest.approx(float(without.time - cut.time), rel=1e-3)


def test_gradients_are_differences_and_finite_when_standing(x64):
    way, time = jnp.asarray(WAY[18:23], float), jnp.asarray(TIME, float)
    mask = jnp.asarray(ALL[:5])

    @jax.jit
    def total(way):
        found = edie.region(way, time, mask=mask, period=jnp.asarray(PERIOD, float), reach=jnp.asarray(REACH, float))
        return found.speed + 100 * found.density + found.flow

    slope = jax.jit(jax.grad(total))(way)
    assert np.abs(slope).max() > 1e-3
    for at in [(0, 2), (1, 4), (2, 3), (3, 3), (4, 5)]:
        step = jnp.zeros_like(way).at[at].set(1e-5)
        assert slope[at] == pytest.approx(float(total(way + step) - total(way - step)) / 2e-5, abs=1e-6)
    assert np.isfinite(jax.grad(total)(jnp.full_like(way, 20.0))).all()
