"""Symmetric 3x3 matrices in six entries do what numpy does with nine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from urbanjax.numerics import symmetric


@pytest.fixture
def matrices(x64):
    a = np.random.default_rng(0).normal(size=(50, 3, 3))
    return a @ a.transpose(0, 2, 1)


def test_packing_is_undone_by_unpacking(matrices):
    np.testing.assert_array_equal(symmetric.unpack(symmetric.pack(jnp.asarray(matrices))), matrices)


def test_algebra_equals_numpy(matrices):
    s, v = symmetric.pack(jnp.asarray(matrices)), np.random.default_rng(1).normal(size=(50, 3))
    np.testing.assert_allclose(symmetric.determinant(s), np.linalg.det(matrices), rtol=1e-9)
    np.testing.assert_allclose(symmetric.unpack(symmetric.inverse(s)), np.linalg.inv(matrices), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(symmetric.product(s, jnp.asarray(v.T)).T, np.einsum("nij,nj->ni", matrices, v))
    np.testing.assert_allclose(
        symmetric.unpack(symmetric.outer(jnp.asarray(v.T))), np.einsum("ni,nj->nij", v, v), rtol=1e-12
    )
    r = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turned = symmetric.unpack(symmetric.congruence(jnp.asarray(r), s))
    np.testing.assert_allclose(turned, r @ matrices @ r.T, rtol=1e-10, atol=1e-12)


def test_eigenvalues_and_the_smallest_eigenvector(matrices):
    s = symmetric.pack(jnp.asarray(matrices))
    values, vectors = np.linalg.eigh(matrices)
    np.testing.assert_allclose(symmetric.eigenvalues(s).T, values, rtol=1e-6, atol=1e-8)
    along = np.sum(np.asarray(symmetric.smallest_eigenvector(s)).T * vectors[:, :, 0], axis=1)
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-8)


@pytest.mark.parametrize("s", [[0.0] * 6, [1.0, 0, 0, 1, 0, 1], [2.0, 0, 0, 2, 0, 1e-9]])
def test_degenerate_matrices_are_finite_in_value_and_gradient(s):
    s = jnp.array(s)
    for function in (symmetric.inverse, symmetric.smallest_eigenvector):
        assert np.isfinite(function(s)).all()
    assert np.isfinite(jax.jacfwd(symmetric.inverse)(s)).all()
    assert float(jnp.linalg.norm(symmetric.smallest_eigenvector(s))) == pytest.approx(1)
