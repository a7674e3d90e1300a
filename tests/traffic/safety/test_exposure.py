import jax
import jax.numpy as jnp
import numpy as np

from urbanjax.numerics.soft import Relaxation
from urbanjax.traffic.safety.exposure import time_exposed, time_integrated

HARD = Relaxation()


def sample(shape=(3, 40), seed=0):
    rng = np.random.default_rng(seed)
    ttc = np.where(rng.random(shape) < 0.3, np.inf, rng.uniform(0, 5, shape))
    return ttc, rng.random(shape) < 0.8


def test_they_are_the_sums_of_their_definitions(x64):
    ttc, valid = (jnp.asarray(x) for x in sample())
    exposed, integrated = np.zeros(3), np.zeros(3)
    for i in range(3):
        for k in range(40):
            if valid[i, k] and ttc[i, k] <= 1.5:
                exposed[i] += 0.1
                integrated[i] += 0.1 * (1.5 - ttc[i, k])
    assert (exposed > 0).all()
    given = {"valid": jnp.asarray(valid), "dt": 0.1, "threshold": 1.5}
    np.testing.assert_allclose(time_exposed(ttc, **given, relaxation=HARD), exposed, rtol=1e-12)
    np.testing.assert_allclose(time_integrated(ttc, **given), integrated, rtol=1e-12)


def test_a_closing_approach_has_the_area_of_a_triangle(x64):
    time = np.arange(0, 3, 1e-3)
    ttc, given = jnp.asarray(3.0 - time), {"valid": jnp.ones(time.shape, bool), "dt": 1e-3, "threshold": 1.5}
    np.testing.assert_allclose(time_exposed(ttc, **given, relaxation=HARD), 1.5, atol=2e-3)
    np.testing.assert_allclose(time_integrated(ttc, **given), 1.5**2 / 2, atol=2e-3)


def test_the_threshold_itself_and_contact_count_and_infinity_does_not():
    ttc, valid = jnp.array([1.5, 0.0, jnp.inf]), jnp.ones(3, bool)
    np.testing.assert_allclose(time_exposed(ttc, valid, dt=0.1, threshold=1.5, relaxation=HARD), 0.2, rtol=1e-6)
    np.testing.assert_allclose(time_integrated(ttc, valid, dt=0.1, threshold=1.5), 0.15, rtol=1e-6)
    assert time_exposed(ttc, ~valid, dt=0.1, threshold=1.5, relaxation=HARD) == 0
    assert time_integrated(ttc, ~valid, dt=0.1, threshold=1.5) == 0


def test_the_soft_twin_tends_to_the_hard_one_and_has_its_gradient(x64):
    ttc, valid = (jnp.asarray(x) for x in sample(seed=1))
    hard = time_exposed(ttc, valid, dt=0.1, threshold=1.5, relaxation=HARD)
    np.testing.assert_allclose(
        time_exposed(ttc, valid, dt=0.1, threshold=1.5, relaxation=Relaxation(1e-5, "soft")), hard, atol=1e-6
    )
    through = Relaxation(0.2, "straight_through")
    np.testing.assert_allclose(time_exposed(ttc, valid, dt=0.1, threshold=1.5, relaxation=through), hard, rtol=1e-12)

    def total(shift, relaxation=Relaxation(0.2, "soft")):
        return jnp.sum(time_exposed(ttc + shift, valid, dt=0.1, threshold=1.5, relaxation=relaxation))

    expected = (total(1e-6) - total(-1e-6)) / 2e-6
    assert expected < -0.1
    np.testing.assert_allclose(jax.grad(total)(0.0), expected, rtol=1e-6)
    np.testing.assert_allclose(jax.grad(lambda s: total(s, through))(0.0), expected, rtol=1e-6)


def test_gradients_of_the_integral_equal_central_differences_and_pass_infinity(x64):
    ttc, valid = (jnp.asarray(x) for x in sample(seed=2))
    slope = jax.grad(lambda x: jnp.sum(time_integrated(x, valid, dt=0.1, threshold=1.5)))(ttc)
    np.testing.assert_allclose(slope, np.where(valid & (ttc < 1.5), -0.1, 0), rtol=1e-12)
    by_threshold = jax.grad(lambda h: jnp.sum(time_integrated(ttc, valid, dt=0.1, threshold=h)))(1.5)
    up, down = (jnp.sum(time_integrated(ttc, valid, dt=0.1, threshold=1.5 + s)) for s in (1e-6, -1e-6))
    np.testing.assert_allclose(by_threshold, (up - down) / 2e-6, rtol=1e-6)
