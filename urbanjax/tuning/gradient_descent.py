"""Descent along gradients of the loss, told and counted as the black-box searches are."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from urbanjax.tuning.libraries import library
from urbanjax.tuning.optimiser import Numbers, Optimiser
from urbanjax.types.errors import TuningError


class GradientDescent(Optimiser):
    """Adam (Kingma 2015, as in `optax`) from several points at once, each gradient clipped by its global norm.

    A generation is the current point of every restart: the first begins at the start, others at the start + sigma *
    normal, or there too where they differ in what they minimise. `best` is the best point evaluated, not the last one.
    """

    needs_gradient = True

    def __init__(
        self,
        start: Numbers,
        *,
        sigma: float,
        seed: int,
        restarts: int = 1,
        rate: float = 0.05,
        clip: float = 1.0,
        steps: int | None = None,
        together: bool = False,
    ) -> None:
        """See `Optimiser`.

        Args: start [P], sigma and seed, of `Optimiser`; restarts, R points that descend; rate, the learning rate, in
        units of z a step; clip, the largest norm of a gradient; steps, over which the rate falls to 0 as a cosine
        (default: it stays); together, whether all restarts begin at the start. Raises TuningError for one that is not
        positive.
        """
        super().__init__(start, sigma=sigma, seed=seed)
        for name, value in {"restarts": restarts, "rate": rate, "clip": clip, "steps": steps}.items():
            if value is not None and not 0 < value < np.inf:
                raise TuningError(f"{name} is {value}: give a positive number")
        drawn = np.random.default_rng(seed).normal(size=(restarts, self.start.size))
        drawn[0] = 0.0
        self._points = jnp.asarray(self.start + (0.0 if together else self.sigma) * drawn, float)
        optax = library("optax")
        schedule = rate if steps is None else optax.cosine_decay_schedule(rate, steps)
        rule = optax.chain(optax.clip_by_global_norm(clip), optax.adam(schedule))

        def step(point: Array, state: Any, gradient: Array) -> tuple[Array, Any]:
            update, state = rule.update(gradient, state)
            return optax.apply_updates(point, update), state

        self._state, self._step = jax.vmap(rule.init)(self._points), jax.jit(jax.vmap(step))

    def standing(self) -> np.ndarray:
        """The current points [R, P] of all restarts."""
        return self._propose()

    def _propose(self) -> np.ndarray:
        return np.asarray(self._points, np.float64)

    def _learn(self, z: np.ndarray, losses: np.ndarray, gradients: np.ndarray) -> None:
        slopes = jnp.asarray(gradients, self._points.dtype)
        self._points, self._state = self._step(self._points, self._state, slopes)
