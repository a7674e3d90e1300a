import jax
import jax.numpy as jnp
import numpy as np

from tests.planning.conftest import small_params
from urbanjax.planning import learned
from urbanjax.planning.learned import BOUND, CONTEXT
from urbanjax.planning.micro import MICRO_TERMS, MicroParams
from urbanjax.tuning import trainables
from urbanjax.types.config import schema

SIZE = jnp.ones(len(MICRO_TERMS))


def inputs(n=5):
    rng = np.random.default_rng(0)
    return jnp.asarray(rng.uniform(0, 9, (n, len(MICRO_TERMS))), jnp.float32), jnp.ones(len(CONTEXT))


def test_it_begins_as_nothing_and_stays_well_below_a_broken_limit():
    network = learned.initial(jax.random.key(0), SIZE)
    np.testing.assert_array_equal(network(*inputs()), 0.0)
    huge = jax.tree.map(lambda x: x + 1e4, network)
    assert np.abs(huge(*inputs())).max() <= BOUND
    assert MicroParams().infeasible > 2 * BOUND


def test_it_tells_candidates_and_scenes_apart():
    network = learned.initial(jax.random.key(0), SIZE)
    network = network.replace(kernel=(*network.kernel[:2], jnp.ones_like(network.kernel[2])))
    features, context = inputs()
    here = np.asarray(network(features, context))
    assert np.ptp(here) > 1e-3
    assert np.abs(here - network(features, 9 * context)).max() > 1e-3
    # What is common to all candidates is no reason to choose any.
    np.testing.assert_allclose(network(features + 3.0, context), here, atol=1e-4)


def test_it_is_no_key_of_a_config_and_no_number_to_be_tuned():
    assert "learned" not in schema(MicroParams)
    params = MicroParams(learned=learned.initial(jax.random.key(0), SIZE))
    assert [number.key for number in trainables(params)] == [number.key for number in trainables(MicroParams())]


def test_the_planner_adds_it_and_keeps_to_its_limits(planner, scenes):
    window = scenes.road()
    scene = window, scenes.ego(window), scenes.traffic(window, [(60.0, 0.0, 0.0)])
    plain, params = planner(*scene)[2], small_params()
    network = learned.initial(jax.random.key(0), SIZE)

    def planned(network):
        return planner(*scene, params=params.replace(micro=params.micro.replace(learned=network)))[2]

    same = planned(network)
    np.testing.assert_array_equal(same.cost, plain.cost)
    assert int(same.chosen) == int(plain.chosen)
    rows = np.random.default_rng(1).normal(0, 1e3, network.kernel[2].shape)
    strong = planned(network.replace(kernel=(*network.kernel[:2], jnp.asarray(rows, jnp.float32))))
    moved = np.asarray(strong.cost) - np.asarray(plain.cost)
    assert 1.0 < np.abs(moved).max() <= BOUND + 1e-2
    assert not np.asarray(strong.reasons)[int(strong.chosen)].any()
    assert np.asarray(strong.reasons).any()
