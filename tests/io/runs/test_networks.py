import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import save

from urbanjax.io.runs.networks import load_learned, save_learned
from urbanjax.planning import learned
from urbanjax.planning.micro import MICRO_TERMS
from urbanjax.types import FileError


@pytest.fixture
def network():
    return learned.initial(jax.random.key(1), jnp.ones(len(MICRO_TERMS)), hidden=4)


def test_a_network_comes_back_as_it_was(network, tmp_path):
    save_learned(tmp_path / "a.safetensors", network)
    jax.tree.map(np.testing.assert_array_equal, network, load_learned(tmp_path / "a.safetensors"))


@pytest.mark.parametrize("content", [b"", b"not at all", save({"size": np.ones(8, np.float32)})])
def test_what_is_no_network_is_refused_by_name(content, tmp_path):
    path = tmp_path / "wrong.safetensors"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"wrong\.safetensors"):
        load_learned(path)
    with pytest.raises(FileError, match="no such file"):
        load_learned(tmp_path / "missing")


def test_numbers_that_are_not_finite_are_refused(network, tmp_path):
    path = tmp_path / "nan.safetensors"
    save_learned(path, network.replace(size=network.size.at[0].set(jnp.nan)))
    with pytest.raises(FileError, match="'size' must hold finite"):
        load_learned(path)
