"""One step in single precision is the step in double precision, but for choices between equals."""

import jax

from experiments.benchmark import precision
from tests.scenes import loop_params, overtake_scene
from urbanjax.types import as_arrays


def test_single_precision_commands_as_double_precision_does():
    params = as_arrays(loop_params())
    course, lanes, starts = map(as_arrays, overtake_scene(params, 4))
    found = precision.flips(params, course, lanes, starts, 15)
    assert found["float32_steps_compared"] == 60
    assert found["float32_flips_path_share"] <= 1 / 60
    assert found["float32_flips_micro_share"] <= 2 / 60
    assert found["float32_acceleration_error_mps2"] < 1e-2
    assert found["float32_steering_error_rad"] < 1e-3
    assert not jax.config.jax_enable_x64
