"""The learned cost beside the tuned weights: the same loss, and its bound from the start."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.tune.imitation.task import ImitationTask
from urbanjax.planning import learned
from urbanjax.planning.learned import LearnedCost
from urbanjax.rollout import LoopParams
from urbanjax.tuning.libraries import library
from urbanjax.tuning.losses import imitation
from urbanjax.tuning.losses.imitation import Choices

RATE, DECAY = 3e-3, 1e-2
START = 3.0  # m, the least temperature that training starts from: near 0 no choice has a slope


def fit_network(
    task: ImitationTask, loop: LoopParams, choices: Choices, *, part: np.ndarray, temperature: float
) -> tuple[LearnedCost, np.ndarray]:
    """A network beside the loop's weights, trained on a part [N] of the demonstrations; and its losses [steps].

    Adam with weight decay over all of them at once; its loss is the expected displacement, as that of the weights.
    """
    optax = library("optax")
    feature = np.asarray(choices.features)[part]
    size = (feature - feature.min(axis=1, keepdims=True)).mean(axis=(0, 1))
    begun = learned.initial(jax.random.key(task.seed), jnp.asarray(size))
    weights = loop.stack.planning.micro.weights
    rule = optax.adamw(optax.cosine_decay_schedule(RATE, task.network_steps), weight_decay=DECAY)

    def loss(model: tuple[LearnedCost, Array], choices: Choices, part: Array) -> Array:
        network, scale = model

        def one(choices: Choices) -> Array:
            cost = imitation.costs(choices, weights, learned=network)
            return imitation.displacement(choices, cost, temperature=max(temperature, START) * jnp.exp(scale))

        return jnp.sum(jax.vmap(one)(choices) * part) / jnp.sum(part)

    @jax.jit
    def search(model: Any, choices: Choices, part: Array) -> tuple[Any, Array]:
        def step(carry: tuple, _: None) -> tuple[tuple, Array]:
            model, state = carry
            value, slope = jax.value_and_grad(loss)(model, choices, part)
            # What scales inputs is measured, and not trained.
            slope = (slope[0].replace(size=jnp.zeros_like(slope[0].size)), slope[1])
            change, state = rule.update(slope, state, model)
            change = (change[0].replace(size=jnp.zeros_like(change[0].size)), change[1])
            return (optax.apply_updates(model, change), state), value

        (model, _), losses = jax.lax.scan(step, (model, rule.init(model)), None, length=task.network_steps)
        return model, losses

    inputs = jax.device_put((choices, jnp.asarray(part, jnp.float32)))
    (network, _), losses = search((begun, jnp.zeros(())), *inputs)
    return network, np.asarray(losses)
