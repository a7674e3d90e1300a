"""String stability: known gains, scipy's spectra, and what masks, absent vehicles and resampling must keep."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

from urbanjax.traffic import bootstrap
from urbanjax.traffic.flow import stability, transfer
from urbanjax.types.errors import TrafficError

gains = jax.jit(stability.gains)
spectra = jax.jit(transfer.transfer, static_argnames="length")
interval = jax.jit(stability.bootstrapped, static_argnames=("block", "draws"))
T, RATE = 400, 10.0
TIME = np.arange(T) / RATE
GROWTH = np.array([1, 1.2, 0.9, 1.5])


def platoon(seed=0, noise=0.0):
    """Four vehicles that repeat the first one's disturbance, each by its growth and half a second late."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 6, 4)
    rows = []
    for i, size in enumerate(np.cumprod(GROWTH)):
        t = TIME - 0.5 * i
        wave = sum(np.sin(2 * np.pi * f * t + p) for f, p in zip((0.05, 0.1, 0.25, 0.5), phase, strict=True))
        rows.append(15 + size * wave + noise * rng.normal(size=T))
    return np.float32(rows)


SPEED, ALL = platoon(), np.ones((4, T), bool)


def test_gains_are_ratios_of_deviations():
    found = gains(SPEED, ALL)
    deviation = SPEED - SPEED.mean(1, keepdims=True)
    spread, peak = SPEED.std(1), np.abs(deviation).max(1)
    np.testing.assert_allclose(found.spread, spread, rtol=1e-4)
    np.testing.assert_allclose(found.peak, peak, rtol=1e-4)
    np.testing.assert_allclose(found.l2[1:], spread[1:] / spread[:-1], rtol=1e-4)
    np.testing.assert_allclose(found.linf[1:], peak[1:] / peak[:-1], rtol=1e-4)
    np.testing.assert_allclose(found.l2[1:], GROWTH[1:], rtol=0.03)
    assert found.chain_l2 == pytest.approx(np.prod(np.asarray(found.l2[1:])), rel=1e-4)
    assert found.chain_linf == pytest.approx(peak[-1] / peak[0], rel=1e-4)
    assert found.pair.tolist() == [False, True, True, True]


def test_an_absent_vehicle_is_passed_over_and_padding_changes_nothing():
    speed = np.insert(SPEED, 2, np.nan, axis=0)
    speed = np.concatenate([speed, np.full((2, T), np.nan, np.float32)])
    speed = np.concatenate([speed, np.full((7, 30), np.nan, np.float32)], axis=1)
    mask = np.isfinite(speed)
    found, plain = gains(speed, mask), gains(SPEED, ALL)
    there = np.array([0, 1, 3, 4])
    np.testing.assert_allclose(found.l2[there], plain.l2, rtol=1e-4)
    np.testing.assert_allclose(found.linf[there], plain.linf, rtol=1e-4)
    assert found.chain_l2 == pytest.approx(float(plain.chain_l2), rel=1e-4)
    assert not found.pair[np.array([2, 5, 6])].any()
    seen = spectra(speed, mask, rate=RATE, length=64)
    assert seen.segments[2] == 0
    np.testing.assert_allclose(seen.gain[there, :8], spectra(SPEED, ALL, rate=RATE, length=64).gain[:, :8], rtol=1e-3)


def test_one_vehicle_is_no_platoon():
    found = gains(SPEED, ALL & (np.arange(4) == 1)[:, None])
    assert not found.chain
    assert not found.pair.any()
    assert found.chain_l2 == 0


def test_each_pair_is_compared_over_the_samples_of_both():
    mask = ALL.copy()
    mask[0, 100:150] = False
    mask[1, 300:] = False
    found = gains(SPEED, mask)
    both = mask[0] & mask[1]
    assert found.l2[1] == pytest.approx(SPEED[1, both].std() / SPEED[0, both].std(), rel=1e-4)
    assert found.spread[0] == pytest.approx(SPEED[0, mask[0]].std(), rel=1e-4)


@pytest.mark.parametrize("length", [64, 75])
def test_spectra_are_scipys(length):
    speed = platoon(1, noise=0.3)
    found = spectra(speed, ALL, rate=RATE, length=length)
    options = {"fs": RATE, "window": "hann", "nperseg": length, "noverlap": length - length // 2, "detrend": "constant"}
    frequency, power = scipy.signal.welch(speed, **options)
    _, cross = scipy.signal.csd(speed[:-1], speed[1:], **options)
    np.testing.assert_allclose(found.frequency, frequency, rtol=1e-5)
    np.testing.assert_allclose(found.power[:, 1:], power[:, 1:], rtol=2e-3)
    np.testing.assert_allclose(found.gain[1:, 1:], np.abs(cross / power[:-1])[:, 1:], rtol=2e-3)
    _, coherence = scipy.signal.coherence(speed[:-1], speed[1:], **options)
    np.testing.assert_allclose(found.coherence[1:, 1:], coherence[:, 1:], rtol=5e-3)
    turned = np.exp(1j * (np.asarray(found.phase[1:, 1:]) - np.angle(cross)[:, 1:]))
    np.testing.assert_allclose(turned[np.asarray(found.coherence[1:, 1:]) > 0.2], 1, atol=5e-3)
    assert found.segments.tolist() == [0, *[(T - length) // (length // 2) + 1] * 3]


def test_a_segment_longer_than_the_log_is_refused():
    with pytest.raises(TrafficError, match="segments of 401 samples of a series of 400"):
        transfer.transfer(jnp.asarray(SPEED), jnp.asarray(ALL), rate=RATE, length=401)


def test_gain_and_delay_of_each_vehicle_come_out_where_the_disturbance_is():
    found = spectra(SPEED, ALL, rate=RATE, length=200)
    for f in (0.05, 0.1, 0.25, 0.5):
        at = int(np.argmin(np.abs(np.asarray(found.frequency) - f)))
        np.testing.assert_allclose(found.gain[1:, at], GROWTH[1:], rtol=0.03)
        np.testing.assert_allclose(found.phase[1:, at], -np.pi * f, atol=0.05)
        assert np.all(found.coherence[1:, at] > 0.97)
    gain, frequency, some = transfer.worst(found, 0.04, high=0.6, coherence=0.9)
    np.testing.assert_allclose(gain[1:], GROWTH[1:], rtol=0.15)
    assert np.all((frequency[1:] >= 0.04) & (frequency[1:] <= 0.6))
    assert some.tolist() == [False, True, True, True]
    # The coherence of one segment is 1, and no evidence.
    assert not transfer.worst(
        spectra(SPEED[:, :200], ALL[:, :200], rate=RATE, length=200), 0.04, high=0.6, coherence=0.9
    )[2].any()


def test_segments_with_a_missing_sample_are_left_out():
    mask, speed = ALL.copy(), platoon(2, noise=0.3)
    mask[1, 250:] = False
    found, short = (
        spectra(np.where(mask, speed, np.nan), mask, rate=RATE, length=50),
        spectra(speed[:, :250], ALL[:, :250], rate=RATE, length=50),
    )
    np.testing.assert_allclose(found.gain[1:3], short.gain[1:3], rtol=1e-4)
    assert found.segments[3] > found.segments[2] == short.segments[2]


def test_intervals_hold_the_gain_and_shrink_with_the_length_of_the_log():
    key = jax.random.key(0)
    speed = platoon(3, noise=0.2)
    pairs, chain = interval(key, speed, mask=ALL, block=50, draws=200, level=0.9)
    again, _ = interval(key, speed, mask=ALL, block=50, draws=200, level=0.9)
    np.testing.assert_array_equal(pairs, again)
    found = gains(speed, ALL)
    assert np.all((pairs[1:, 0] < found.l2[1:]) & (found.l2[1:] < pairs[1:, 1]))
    assert chain[0] < found.chain_l2 < chain[1]
    fewer, _ = interval(key, speed[:, :100], mask=ALL[:, :100], block=50, draws=200, level=0.9)
    assert np.all((fewer[1:, 1] - fewer[1:, 0]).mean() > (pairs[1:, 1] - pairs[1:, 0]).mean())


def test_blocks_are_consecutive_and_begin_anywhere():
    index = np.asarray(bootstrap.blocks(jax.random.key(1), 50, block=8, draws=400))
    assert index.shape == (400, 50)
    assert np.all(np.diff(index[:, :48].reshape(400, 6, 8), axis=2) % 50 == 1)
    assert set(index[:, 0]) == set(range(50))
    share = np.bincount(index.ravel(), minlength=50) / index.size
    np.testing.assert_allclose(share, 1 / 50, rtol=0.15)
    with pytest.raises(TrafficError, match="blocks of 51 samples"):
        bootstrap.blocks(jax.random.key(1), 50, block=51, draws=2)


def test_gradients_are_differences_and_finite_at_standstill(x64):
    speed = jnp.asarray(platoon(4, noise=0.3)[:3, :24], float)
    mask = jnp.ones((3, 24), bool).at[1, 20:].set(False)

    @jax.jit
    @jax.value_and_grad
    def total(speed):
        found, seen = stability.gains(speed, mask), transfer.transfer(speed, mask, rate=RATE, length=12)
        shares = jnp.sum(found.l2) + jnp.sum(found.linf) + found.chain_l2
        return shares + jnp.sum(seen.gain[:, 1:4]) + jnp.sum(seen.coherence[:, 1:4]) + jnp.sum(seen.power)

    _, slope = total(speed)
    for at in [(0, 0), (0, 13), (1, 5), (1, 22), (2, 9), (2, 23)]:
        step = jnp.zeros_like(speed).at[at].set(1e-5)
        assert slope[at] == pytest.approx(float(total(speed + step)[0] - total(speed - step)[0]) / 2e-5, abs=1e-5)
    value, slope = total(jnp.zeros_like(speed))
    assert np.isfinite(value)
    assert np.isfinite(slope).all()


def test_a_batch_of_platoons_equals_the_platoons():
    speeds = jnp.stack([SPEED, platoon(5)])
    found = jax.jit(jax.vmap(stability.gains))(speeds, jnp.stack([ALL, ALL]))
    np.testing.assert_allclose(found.l2[1], gains(speeds[1], ALL).l2, rtol=1e-5)
