"""String stability of the recorded platoons: adaptive cruise control at short and long headway, and human drivers."""

import jax
import numpy as np
import pytest

from tests.io.logs.formats import OPENACC, form
from urbanjax.io import logs
from urbanjax.traffic.flow import passages, stability, transfer

pytestmark = pytest.mark.real_data
RATE = 10.0  # Hz
GAINS, SPECTRA = jax.jit(stability.gains), jax.jit(transfer.transfer, static_argnames="length")
INTERVAL = jax.jit(stability.bootstrapped, static_argnames=("block", "draws"))


@pytest.fixture(scope="module")
def platoon(data_dir):
    """Reads (vehicles, speed [V, T], mask [V, T]); the leader of the order has no columns in these recordings."""
    folder = data_dir / "traffic" / "openacc"
    if not folder.is_dir():
        pytest.skip(f"no platoons at {folder}")

    def read(name):
        found = logs.read(folder / f"{name}.csv", form(OPENACC))
        ticks = [np.round(log.time * RATE).astype(int) for log in found]
        for log, tick in zip(found, ticks, strict=True):
            np.testing.assert_allclose(log.time, tick / RATE, atol=1e-6)
        first = min(tick[0] for tick in ticks)
        speed = np.full((len(found), max(tick[-1] for tick in ticks) - first + 1), np.nan, np.float32)
        for row, log, tick in zip(speed, found, ticks, strict=True):
            row[tick - first] = log.speed
        return [log.vehicle for log in found], speed, np.isfinite(speed)

    return read


@pytest.mark.parametrize(
    ("name", "head", "tail", "gain", "vehicles"),
    [
        ("short_setting/handling_part14", ("MAZDA_3", 5.20), ("AUDI_A4", 7.15), 1.378, 10),
        ("no_ACC/handling_part40", ("JAGUAR_I_PACE", 5.56), ("MAZDA_3", 5.78), 1.044, 7),
        ("long_setting/handling_part38", ("JAGUAR_I_PACE", 3.13), ("MAZDA_3", 6.14), 1.963, 7),
    ],
)
def test_deviation_of_speed_from_head_to_tail_over_the_whole_recording(platoon, name, head, tail, gain, vehicles):
    who, speed, mask = platoon(name)
    found = GAINS(speed, mask)
    assert len(who) == vehicles
    assert (who[0], round(float(found.spread[0]), 2)) == head
    assert (who[-1], round(float(found.spread[-1]), 2)) == tail
    # Over the samples that both have: not quite the ratio of the two numbers above.
    assert found.chain_l2 == pytest.approx(gain, abs=1e-3)
    np.testing.assert_allclose(found.spread, np.nanstd(speed.astype(float), axis=1), rtol=1e-4)


def test_a_recording_of_eighty_seconds_does_not_tell_the_gain_of_its_platoon(platoon):
    low, high = {}, {}
    for name in ("short_setting/handling_part14", "no_ACC/handling_part40", "long_setting/handling_part38"):
        _, speed, mask = platoon(name)
        _, chain = INTERVAL(jax.random.key(0), speed, mask=mask, block=200, draws=300, level=0.9)
        low[name[:5]], high[name[:5]] = (float(x) for x in chain)
        assert chain[0] < GAINS(speed, mask).chain_l2 < chain[1]
    assert low["short"] < 1 < high["short"]
    assert low["no_AC"] < 1 < high["no_AC"]
    assert low["long_"] > 1, "here the platoon amplifies whatever the blocks"


def test_the_standing_start_hides_what_cruise_control_does_to_disturbances(platoon):
    gains = {}
    for name, start, end in (("short_setting/handling_part14", 336, 800), ("no_ACC/handling_part40", 238, 2506)):
        _, speed, mask = platoon(name)
        moving, held = speed[:, start:end], mask[:, start:end]
        assert np.nanmin(moving) > 2
        gains[name[:5]] = float(GAINS(moving, held).chain_l2)
    assert gains["short"] == pytest.approx(5.20, abs=0.02)
    assert gains["no_AC"] == pytest.approx(1.10, abs=0.02)


def test_human_drivers_follow_slow_changes_of_speed_as_they_are(platoon):
    _, speed, mask = platoon("no_ACC/handling_part40")
    found = SPECTRA(speed, mask, rate=RATE, length=256)
    band = (np.asarray(found.frequency) > 0.03) & (np.asarray(found.frequency) < 0.06)
    assert found.segments[1:].min() >= 10
    assert np.all(found.coherence[1:, band] > 0.3)
    assert np.all((found.gain[1:, band] > 0.4) & (found.gain[1:, band] < 1.6))
    assert np.all(found.phase[1:, band] < 0), "everybody is late"


def test_the_last_vehicle_of_a_platoon_passes_a_station_last(platoon):
    _, speed, mask = platoon("short_setting/handling_part14")
    way = np.cumsum(np.where(mask, speed, 0) / RATE, axis=1).astype(np.float32)
    time = (np.arange(way.shape[1]) / RATE).astype(np.float32)
    found = jax.jit(passages.passages)(
        way - 20 * np.arange(10, dtype=np.float32)[:, None], time, mask=mask, station=150.0
    )
    np.testing.assert_array_equal(found.vehicle, np.arange(10))
    assert np.all(found.headway[1:] > 0.5)
    assert np.median(found.headway[1:]) < 4
