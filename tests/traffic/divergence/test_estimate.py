"""The divergence of two sample sets: known answers with their errors, invariances, scipy's tree, the printed form."""

import functools
import itertools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from urbanjax.traffic.divergence.estimate import DivergenceParams, all_pairs, divergence

N = 2000
ONE = ((0, 1),)


@pytest.fixture(scope="session")
def estimate():
    return jax.jit(divergence, static_argnames="pairs")


@functools.cache
def sloped(form, policy):
    """Values and validity of three pairs of three teams of 60 samples, and the gradient of the first value."""
    params = DivergenceParams(ks=(5,), form=form, ties=policy)

    def value(points):
        found = divergence(points, jnp.ones((3, 60), bool), params=params, pairs=(*ONE, (2, 1), (0, 2)))
        return found.value[0, 0], (found.value[:, 0], found.valid[:, 0])

    return jax.jit(jax.value_and_grad(value, has_aux=True))


def reference(x, y, k):
    """The corrected form from scipy's tree, in float64."""
    r = cKDTree(x).query(x, k + 1)[0][:, -1]
    s = cKDTree(y).query(x, [k])[0][:, -1]
    return x.shape[1] * np.mean(np.log(s / r)) + np.log(len(y) / (len(x) - 1))


def padded(*sets, n=N):
    points = np.stack([np.pad(x, ((0, n - len(x)), (0, 0))) for x in sets]).astype(np.float32)
    return points, np.arange(n) < np.array([[len(x)] for x in sets])


def gaussian(rng, n, scale=1.0, shift=0.0):
    return scale * rng.normal(size=(n, 2)) + [shift, 0]


DRAWN = {
    "N(0, I) in N(0, 4 I)": lambda rng, n: (gaussian(rng, n), gaussian(rng, n, 2.0)),
    "N(0, 4 I) in N(0, I)": lambda rng, n: (gaussian(rng, n, 2.0), gaussian(rng, n)),
    "N(0, I) in N((2, 0), I)": lambda rng, n: (gaussian(rng, n), gaussian(rng, n, 1.0, 2.0)),
    "N(0, I) in N(0, I)": lambda rng, n: (gaussian(rng, n), gaussian(rng, n)),
    "[0, 1]^2 in [0, 2]^2": lambda rng, n: (rng.random((n, 2)), 2 * rng.random((n, 2))),
}


def stated(name):
    """Truth, and mean and standard deviation by n, as docs/divergence.md states them."""
    page = (Path(__file__).parents[3] / "docs" / "divergence.md").read_text(encoding="utf-8")
    cells = next(line for line in page.splitlines() if line.startswith(f"| {name} |")).split("|")[2:6]
    means = ([float(number) for number in cell.split("±")] for cell in cells[1:])
    return float(cells[0]), dict(zip((500, 2000, 20_000), means, strict=True))


def checked(estimate, name, n, repetitions):
    rng = np.random.default_rng(0)
    sets = (padded(*DRAWN[name](rng, n), n=max(n, N)) for _ in range(repetitions))
    values = [float(estimate(*s, params=DivergenceParams(), pairs=ONE).value[0, 0]) for s in sets]
    mean, deviation = stated(name)[1][n]
    assert abs(np.mean(values) - mean) < 4 * deviation / repetitions**0.5
    if repetitions >= 20:
        assert 0.5 * deviation < np.std(values) < 1.6 * deviation


@pytest.mark.parametrize("n", [500, 2000])
@pytest.mark.parametrize("name", DRAWN)
def test_known_answers_within_their_stated_errors(estimate, name, n):
    checked(estimate, name, n, 20)


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWN)
def test_known_answers_of_many_samples(estimate, name):
    checked(estimate, name, 20_000, 6)


def test_what_is_stated_is_near_the_truth_unless_q_has_no_samples_where_p_goes():
    for name in DRAWN:
        truth, means = stated(name)
        errors = [abs(mean - truth) for mean, _ in means.values()]
        if name in ("N(0, 4 I) in N(0, I)", "N(0, I) in N((2, 0), I)"):
            assert errors[0] > errors[1] > errors[2]
        else:
            assert max(errors) < 0.04


def test_random_sets_equal_scipys_tree(estimate):
    rng = np.random.default_rng(2)
    params = DivergenceParams(ks=(1, 5, 10))
    for _ in range(30):
        sizes = rng.integers(30, N, 2)
        x, y = ((10 ** rng.uniform(-1, 2)) * gaussian(rng, n, 1.0, rng.uniform(-3, 3)) for n in sizes)
        points, valid = padded(x, y)
        x, y = points[0, : sizes[0]].astype(float), points[1, : sizes[1]].astype(float)
        found = estimate(points, valid, params=params, pairs=ONE)
        assert found.valid.all()
        np.testing.assert_allclose(found.value[0], [reference(x, y, k) for k in (1, 5, 10)], atol=1e-5)


def test_moves_scales_and_order_change_nothing(estimate):
    rng = np.random.default_rng(3)
    x, y = gaussian(rng, 1500), gaussian(rng, 1200, 2.0, 1.0)
    before = float(estimate(*padded(x, y), params=DivergenceParams(), pairs=ONE).value[0, 0])
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cos, -sin], [sin, cos]])
    changed = {
        "turned": (x @ turn.T, y @ turn.T),
        "mirrored": (x * [1, -1], y * [1, -1]),
        "moved": (x + 40, y + 40),
        "scaled": (x * 100, y * 100),
        "shuffled": (rng.permutation(x), rng.permutation(y)),
    }
    for name, sets in changed.items():
        after = float(estimate(*padded(*sets), params=DivergenceParams(), pairs=ONE).value[0, 0])
        assert abs(after - before) < 2e-4 if name == "moved" else abs(after - before) < 2e-5, name


def test_all_pairs_in_one_call_equal_the_pairs(estimate):
    rng = np.random.default_rng(4)
    points, valid = padded(*(gaussian(rng, 400 + 100 * i, 1 + 0.3 * i) for i in range(3)), n=700)
    found = estimate(points, valid, params=DivergenceParams(), pairs=None)
    assert all_pairs(3) == tuple(itertools.permutations(range(3), 2))
    for row, (i, j) in enumerate(all_pairs(3)):
        x, y = points[i][valid[i]].astype(float), points[j][valid[j]].astype(float)
        np.testing.assert_allclose(found.value[row, 0], reference(x, y, 5), atol=1e-5)
    np.testing.assert_allclose(found.value, (found.terms * found.used).sum(-1) / found.used.sum(-1), atol=1e-5)


@pytest.mark.parametrize(("samples_p", "samples_q"), [(N, N), (400, 100)])
def test_the_printed_form_is_reproduced_and_is_wrong(estimate, samples_p, samples_q):
    rng = np.random.default_rng(5)
    points, valid = padded(gaussian(rng, samples_p), gaussian(rng, samples_q, 2.0))
    x, y = (team[mask].astype(float) for team, mask in zip(points, valid, strict=True))
    printed = float(estimate(points, valid, params=DivergenceParams(form="printed"), pairs=ONE).value[0, 0])
    r, s = cKDTree(x).query(x, 6)[0][:, 5], cKDTree(y).query(x, 5)[0][:, 4]
    m, n = samples_p, samples_q  # "P(x|z) and Q(x|z) have m and n samples"
    density = 5 / ((n - 1) * np.pi * r**2)
    np.testing.assert_allclose(printed, np.sum(density * np.log(r / s)) + np.log(m / (n - 1)), rtol=1e-4)
    assert printed < -100  # the divergence is 0.6363


def test_adaptive_neighbourhoods_lessen_the_bias_of_the_reverse_divergence(estimate):
    rng = np.random.default_rng(6)
    sets = [padded(gaussian(rng, N, 2.0), gaussian(rng, N)) for _ in range(10)]
    fixed, adaptive = (
        np.mean([float(estimate(*s, params=DivergenceParams(form=form), pairs=ONE).value[0, 0]) for s in sets])
        for form in ("corrected", "adaptive")
    )
    assert fixed + 0.2 < adaptive < 1.6137
    same = [padded(gaussian(rng, N), gaussian(rng, N)) for _ in range(10)]
    assert (
        abs(
            np.mean(
                [float(estimate(*s, params=DivergenceParams(form="adaptive"), pairs=ONE).value[0, 0]) for s in same]
            )
        )
        < 0.05
    )


def test_gradients_equal_central_differences_with_the_neighbours_held(x64):
    rng = np.random.default_rng(7)
    points, valid = np.stack([gaussian(rng, 60), gaussian(rng, 60, 2.0)]), np.arange(60) < [[60], [50]]

    def value(p):
        return divergence(p, jnp.asarray(valid), params=DivergenceParams(ks=(3,)), pairs=ONE).value[0, 0]

    evaluate, step = jax.jit(jax.value_and_grad(value)), 1e-6
    slope = evaluate(jnp.asarray(points))[1]
    for _ in range(5):
        direction = rng.normal(size=points.shape)
        ahead, behind = (float(evaluate(jnp.asarray(points + sign * step * direction))[0]) for sign in (1, -1))
        np.testing.assert_allclose(float((slope * direction).sum()), (ahead - behind) / (2 * step), rtol=1e-5)
    assert np.all(slope[1, 50:] == 0)


@pytest.mark.parametrize("policy", ["dedupe", "floor"])  # `error` computes what `dedupe` does
def test_coincident_samples_have_finite_values_and_gradients(policy):
    points = np.random.default_rng(8).normal(size=(3, 60, 2)).astype(np.float32)
    points[:2, :30], points[1, 30:] = 0, points[0, 30:]
    (number, (_, valid)), slope = sloped("corrected", policy)(points)
    assert valid[0]
    assert np.isfinite(number)
    assert np.isfinite(slope).all()


def test_too_few_samples_are_no_estimate(estimate):
    rng = np.random.default_rng(9)
    for few in ((5, 100), (100, 4), (0, 100)):
        found = estimate(*padded(*(gaussian(rng, n) for n in few)), params=DivergenceParams(), pairs=ONE)
        assert not found.valid.any()
        assert np.isnan(found.value[0, 0])
    assert estimate(*padded(gaussian(rng, 6), gaussian(rng, 5)), params=DivergenceParams(), pairs=ONE).valid.all()


def coincident(points):
    points[0, :10] = points[0, 0]


def not_a_number(points):
    points[0, 3, 1] = np.nan


def infinite(points):
    points[1, 3, 1] = np.inf


SPOILT = [
    (coincident, "error"),
    *((spoil, policy) for spoil in (not_a_number, infinite) for policy in ("error", "dedupe", "floor")),
]


@pytest.mark.parametrize(
    ("spoil", "policy", "form"),
    [
        pytest.param(*spoilt, form, marks=pytest.mark.slow if "error" not in spoilt and form != "corrected" else ())
        for form in ("corrected", "printed", "adaptive")
        for spoilt in SPOILT
    ],
)
def test_no_estimate_is_not_a_number_with_gradient_zero(spoil, policy, form):
    points = np.random.default_rng(10).normal(size=(3, 60, 2)).astype(np.float32)
    spoil(points)
    (_, (number, valid)), slope = sloped(form, policy)(points)
    assert valid.tolist() == [False, spoil is not infinite, spoil is infinite]  # only the pairs of the spoilt team
    np.testing.assert_array_equal(np.isnan(number), ~valid)
    np.testing.assert_array_equal(slope, 0)


def test_samples_that_do_not_count_may_be_anything(estimate):
    rng = np.random.default_rng(11)
    points, valid = padded(gaussian(rng, 100), gaussian(rng, 100, 2.0))
    found = estimate(np.where(valid[..., None], points, np.nan), valid, params=DivergenceParams(), pairs=ONE)
    assert float(found.value[0, 0]) == float(estimate(points, valid, params=DivergenceParams(), pairs=ONE).value[0, 0])
