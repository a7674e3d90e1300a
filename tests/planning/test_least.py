"""The value that is computed of the boxes that are there alone is the smallest of all gaps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.planning.test_nearest import meeting
from urbanjax.planning import clearance
from urbanjax.planning.least import GROUP, least_gap


def ours(met):
    return least_gap(met.passage, met.driving, prediction=met.prediction, ignored=met.ignored)


def plain(met):
    room = clearance.gaps(met.passage, met.driving, prediction=met.prediction, ignored=met.ignored)
    return jnp.min(room, axis=1)


def among(met, *, valid):
    return met.replace(prediction=met.prediction.replace(valid=jnp.asarray(valid)))


@pytest.mark.parametrize("count", [1, GROUP, 2 * GROUP + 1])
@pytest.mark.parametrize("swept", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_it_is_the_least_gap_whoever_is_there(count, swept, share, x64):
    met = among(meeting(count, "hard", swept=swept), valid=np.random.default_rng(1).uniform(size=count) < share)
    np.testing.assert_allclose(ours(met), plain(met), rtol=0, atol=1e-12)


def test_of_nobody_everything_is_as_far_as_counts():
    met = among(meeting(5, "hard"), valid=np.zeros(5, bool))
    np.testing.assert_array_equal(ours(met), met.driving.params.far)


def test_in_a_batch_each_has_its_own(x64):
    mets = [among(meeting(9, "hard", seed=k), valid=np.arange(9) % 4 < k) for k in range(5)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *mets)
    np.testing.assert_allclose(jax.jit(jax.vmap(ours))(stacked), [plain(met) for met in mets], rtol=0, atol=1e-12)


def test_what_of_the_others_is_not_there_does_not_count_even_if_it_is_no_number():
    met = among(meeting(6, "hard"), valid=np.arange(6) < 3)
    broken = met.prediction.position.at[3:].set(jnp.nan)
    np.testing.assert_array_equal(
        ours(met.replace(prediction=met.prediction.replace(position=broken))),
        ours(met),
    )
