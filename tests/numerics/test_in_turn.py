"""A batch that is computed one member after the other is the batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.in_turn import in_turn


def smallest(scale, places, count):
    """The least distance of n points to the first `count` places. Args: scale; places, [n, m] by name; count."""

    def nearer(found):
        k, least = found
        return k + 1, jnp.minimum(least, scale * jnp.abs(places["at"][:, k] - places["own"]))

    start = (jnp.zeros_like(count), jnp.full(places["own"].shape, 10.0))
    return {"least": jax.lax.while_loop(lambda found: found[0] < count, nearer, start)[1], "count": count + 1}


def inputs(*batch):
    rng = np.random.default_rng(len(batch))
    places = {"at": jnp.asarray(rng.normal(size=(*batch, 3, 4))), "own": jnp.asarray(rng.normal(size=(*batch, 3)))}
    return jnp.asarray(1.5), places, jnp.asarray(rng.integers(0, 5, batch))


def equal(found, expected):
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(one, other)


def test_of_one_it_is_the_function():
    equal(jax.jit(in_turn(smallest))(*inputs()), smallest(*inputs()))


@pytest.mark.parametrize("backend", ["cpu", "another"])
def test_of_a_batch_it_is_the_function_of_each(backend, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    scale, places, count = inputs(6)
    for axes, args in (((None, 0, 0), (scale, places, count)), ((0, None, None), (count * 1.0, *inputs()[1:]))):
        equal(jax.jit(jax.vmap(in_turn(smallest), axes))(*args), jax.vmap(smallest, axes)(*args))


def test_of_a_batch_of_batches_too():
    scale, places, count = inputs(2, 3)
    both = lambda f: jax.vmap(jax.vmap(f, (None, 0, 0)), (None, 0, 0))  # noqa: E731
    equal(jax.jit(both(in_turn(smallest)))(scale, places, count), both(smallest)(scale, places, count))


def test_a_batch_on_a_cpu_is_a_loop_over_its_members():
    scale, places, count = inputs(6)
    jaxpr = str(jax.make_jaxpr(jax.vmap(in_turn(smallest), (None, 0, 0)))(scale, places, count))
    assert "length=6" in jaxpr
