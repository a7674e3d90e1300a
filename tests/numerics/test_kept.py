"""What is kept of a step is not computed anew, and the gradient is that of the plain loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics.kept import kept, recomputed


def looped(wrap, mark):
    """The gradient by x of three steps, each of which has one exponential, without a derivative, and one sine."""

    def step(carry, _):
        grown = mark(jax.lax.stop_gradient(jnp.exp(0.1 * carry)))
        return jnp.sin(grown) * carry, grown

    def total(x):
        last, grown = jax.lax.scan(wrap(step), x, length=3)
        return jnp.sum(last) + jnp.sum(grown)

    return jax.grad(total)


@pytest.fixture
def x():
    return jnp.asarray(np.random.default_rng(0).normal(size=4))


def test_the_gradient_is_that_of_the_plain_loop(x, x64):
    plain = looped(lambda step: step, lambda values: values)(x)
    np.testing.assert_allclose(looped(recomputed, kept)(x), plain, rtol=1e-12)


def test_only_what_is_not_kept_is_computed_twice(x):
    def counts(mark):
        program = str(jax.make_jaxpr(looped(recomputed, mark))(x))
        return program.count(" exp "), program.count(" sin ")

    assert counts(kept) == (1, 2)
    assert counts(lambda values: values) == (2, 2)
