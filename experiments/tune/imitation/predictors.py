"""What each set of parameters would have driven in the place of people it has not seen: one file left out at a time."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from experiments.tune.imitation.fit import Fitted, fit_fan, fit_weights, through_planner
from experiments.tune.imitation.network import fit_network
from experiments.tune.imitation.task import N_TIMES, ImitationTask, RecordedDrivers, chosen_from, with_fan
from urbanjax.planning.learned import LearnedCost
from urbanjax.rollout import LoopParams
from urbanjax.tuning.losses import imitation
from urbanjax.tuning.losses.imitation import Choices
from urbanjax.types import host_record

PRINTED, DEFAULT, WIDER, LIKELY, WEIGHTS = "printed", "default", "default, wide fan", "likely weights", "tuned weights"
LINEAR, NETWORK, CONSTANT = "tuned linear", "tuned network", "constant velocity"
ALL = (PRINTED, DEFAULT, WIDER, LIKELY, WEIGHTS, LINEAR, NETWORK, CONSTANT)


@host_record
class Predictions:
    """What one predictor says of N demonstrations, each by parameters that have not seen its file."""

    error: np.ndarray  # [N, H] m, of the candidate of least cost, at its own times
    likelihood: np.ndarray  # [N] nat, log density of what was driven; NaN where there is none
    share: np.ndarray  # [N] nat, log of the share of the candidate nearest to it; NaN where there is none
    chosen: np.ndarray  # [N] int, the candidate of least cost


@host_record
class Study:
    """All predictors, and what was tuned for each file that was left out."""

    predictions: dict[str, Predictions]
    fits: dict[str, tuple[Fitted, Fitted, Fitted]]  # file -> weights alone, fan with weights, weights on that fan
    losses: dict[str, dict[str, np.ndarray]]  # file -> search -> [steps]
    tuned: dict[str, LoopParams]  # file -> the tuned loop
    networks: dict[str, LearnedCost]  # file -> the learned cost


def study(task: ImitationTask, loop: LoopParams, drivers: RecordedDrivers, tick: Callable[[str], None]) -> Study:
    """Tune without each file and predict it."""
    wide = with_fan(loop, task)
    tick("fans of the default parameters")
    fans = {DEFAULT: chosen_from(loop, drivers.every), WIDER: chosen_from(wide, drivers.every)}
    slope = through_planner(task, wide)
    found: dict[str, dict[str, np.ndarray]] = {name: _empty(drivers) for name in ALL}
    found[CONSTANT] = {**_empty(drivers), "error": constant_velocity(drivers)}
    fits, losses, tuned, networks = {}, {}, {}, {}
    for k, name in enumerate(drivers.files):
        held, part = drivers.file == name, drivers.file != name
        tick(f"without {name} ({k + 1} of {len(drivers.files)}): weights")
        likely, alone = (
            fit_weights(task, wide, fans[WIDER], part=part, loss=loss) for loss in ("nearest", "displaced")
        )
        tick(f"without {name} ({k + 1} of {len(drivers.files)}): through the planner")
        fan = fit_fan(task, wide, drivers.every, part=part, slope=slope)
        moved = fan.params(wide)
        offered = chosen_from(moved, drivers.every)
        linear = fit_weights(task, moved, offered, part=part, loss="displaced", start=fan.temperature)
        tuned[name] = linear.params(moved)
        tick(f"without {name} ({k + 1} of {len(drivers.files)}): network")
        network, steps = fit_network(task, tuned[name], offered, part=part, temperature=linear.temperature)
        networks[name], fits[name] = network, (alone, fan, linear)
        losses[name] = {
            LIKELY: likely.losses,
            WEIGHTS: alone.losses,
            "through the planner": fan.losses,
            LINEAR: linear.losses,
            NETWORK: steps,
        }
        rows = (
            (PRINTED, loop, fans[DEFAULT], None),
            (DEFAULT, loop, fans[DEFAULT], None),
            (WIDER, wide, fans[WIDER], None),
            (LIKELY, likely.params(wide), fans[WIDER], None),
            (WEIGHTS, alone.params(wide), fans[WIDER], None),
            (LINEAR, tuned[name], offered, None),
            (NETWORK, tuned[name], offered, network),
        )
        for who, params, choices, learned in rows:
            said = predicted(task, params, choices, part=part, printed=who == PRINTED, learned=learned)
            for key, values in said.items():
                found[who][key][held] = values[held]
    return Study({name: Predictions(**rows) for name, rows in found.items()}, fits, losses, tuned, networks)


def predicted(
    task: ImitationTask,
    params: LoopParams,
    choices: Choices,
    *,
    part: np.ndarray,
    printed: bool = False,
    learned: LearnedCost | None = None,
) -> dict[str, np.ndarray]:
    """What some parameters say of every demonstration, at the temperature that suits a part [N] of them best."""
    cost = np.asarray(_costs(choices, params.stack.planning.micro.weights, learned))
    cost = np.asarray(choices.printed + choices.broken) if printed else cost
    chosen = np.asarray(cost.argmin(axis=1))
    likelihood, share = (_best(values, part) for values in _likelihoods(choices, jnp.asarray(cost), task.spread))
    error = np.take_along_axis(np.asarray(choices.error), chosen[:, None, None], axis=1)[:, 0]
    return {"error": error, "likelihood": likelihood, "share": share, "chosen": chosen}


def constant_velocity(drivers: RecordedDrivers) -> np.ndarray:
    """Distance [N, H] (m) from who goes straight on at the speed of the moment."""
    ego, time = drivers.every.situation.ego, np.asarray(drivers.every.time[:, :N_TIMES])
    towards = np.stack([np.cos(ego.heading), np.sin(ego.heading)], axis=-1)
    way = np.asarray(drivers.every.vehicle.centre_offset)[:, None] + ego.speed[:, None] * time
    return np.linalg.norm(ego.position[:, None] + way[..., None] * towards[:, None] - drivers.driven, axis=-1)


TEMPERATURES = np.geomspace(0.01, 3000.0, 56)  # m


@jax.jit
def _likelihoods(choices: Choices, cost: jax.Array, spread: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Log density and log share [temperatures, N] [nat]."""

    def at(temperature: jax.Array) -> tuple[jax.Array, jax.Array]:
        def one(choices: Choices, cost: jax.Array) -> tuple[jax.Array, jax.Array]:
            density = imitation.driven_loss(choices, cost, temperature=temperature, spread=spread)
            return -density, -imitation.nearest_loss(choices, cost, temperature=temperature)

        return jax.vmap(one)(choices, cost)

    return jax.lax.map(at, jnp.asarray(TEMPERATURES, cost.dtype))


def _best(values: jax.Array, part: np.ndarray) -> np.ndarray:
    """Those [N] of the temperature under which a part of them is likeliest."""
    rows = np.asarray(values)
    return rows[rows[:, part].mean(axis=1).argmax()]


_costs = jax.jit(
    jax.vmap(lambda choices, weights, learned: imitation.costs(choices, weights, learned=learned), (0, None, None))
)


def _empty(drivers: RecordedDrivers) -> dict[str, np.ndarray]:
    n = len(drivers.file)
    return {
        "error": np.full((n, N_TIMES), np.nan),
        "likelihood": np.full(n, np.nan),
        "share": np.full(n, np.nan),
        "chosen": np.zeros(n, int),
    }
