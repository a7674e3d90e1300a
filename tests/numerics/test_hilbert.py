"""The curve visits every cell once and never jumps; the order is that of the curve, invalid points last."""

import jax
import numpy as np
import pytest

from urbanjax.numerics import hilbert


@pytest.mark.parametrize(("d", "bits"), [(2, 4), (3, 3)])
def test_each_step_of_the_curve_goes_to_a_neighbour(d, bits):
    cells = np.stack(np.meshgrid(*[np.arange(2**bits)] * d, indexing="ij")).reshape(d, -1).astype(np.int32)
    code = np.asarray(jax.jit(hilbert.code_of, static_argnums=1)(cells, bits))
    assert np.array_equal(np.sort(code), np.arange(2 ** (bits * d)))
    steps = np.diff(cells[:, np.argsort(code)], axis=1)
    assert np.all(np.abs(steps).sum(axis=0) == 1)


def test_the_order_is_that_of_the_curve_with_invalid_points_last():
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij")).reshape(3, -1)
    cells = np.random.default_rng(0).permutation(cells, axis=1)
    valid = np.arange(512) % 5 > 0
    points = np.where(valid, cells, np.nan).astype(np.float32)
    order = np.asarray(jax.jit(hilbert.order)(points, valid))
    assert np.array_equal(np.sort(order), np.arange(512))
    assert valid[order][: valid.sum()].all()
    # Cells of the cube that the bounding box spans: 7 / 8 of a step fewer than there are points along an edge.
    step = np.floor(np.minimum(cells / 7 * 1024, 1023)).astype(np.int32)
    code = np.asarray(jax.jit(hilbert.code_of, static_argnums=1)(step, 10))
    assert np.all(np.diff(code[order[: valid.sum()]]) > 0)
