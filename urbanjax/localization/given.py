"""The localizer for which the pose is given: simulators that state it, and studies of planning alone."""

import jax.numpy as jnp

from urbanjax.localization.types import Health, Localization
from urbanjax.types import Observation, ScenarioError


def step(observation: Observation) -> Localization:
    """The observed pose, with zero covariance. Raises ScenarioError (when traced) if the observation has no pose.

    Args: observation, with the pose T_map_body.
    """
    if observation.pose is None:
        raise ScenarioError("localizer 'given' needs observation.pose; give it, or choose another localizer")
    dtype = observation.pose.unit_complex_xy.dtype
    return Localization(
        pose=observation.pose, covariance=jnp.zeros((3, 3), dtype), health=jnp.asarray(Health.NORMAL, jnp.int32)
    )
