"""RecordedDrivers with known weights, and what is found of them: simulated choices on overtaking starts."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from experiments.tune.imitation import fit, paths
from experiments.tune.imitation.task import AT_ONCE, ImitationTask
from urbanjax import stack
from urbanjax.course import course_between
from urbanjax.evaluation.recorded.demonstration import Demonstration
from urbanjax.planning.situation import Situation, look
from urbanjax.rollout import LoopParams
from urbanjax.sim import lanes as tables
from urbanjax.sim import world as worlds
from urbanjax.sim.scenarios import overtake
from urbanjax.sim.scenarios.overtake import RIGHT, OvertakeParams
from urbanjax.tuning.losses import imitation, lattice
from urbanjax.tuning.losses.imitation import Choices
from urbanjax.tuning.losses.lattice import DrivenPath
from urbanjax.types import as_arrays, host_record

PLANTED = (2.0, 0.5, 0.4, 3.0, 0.5, 2.0)  # factors of the default weights, in the order of `fit.WEIGHTS`
PLANTED_ACCELERATION = 0.1  # per m^2/s^3: its default is 0, of which there are no multiples
PLANTED_LATTICE = (2.0, 3.0, 0.5, 2.0, 0.6)  # of those that a road of one direction informs
TEMPERATURE = 1.0  # m


@host_record
class Recovered:
    """What is found of planted weights."""

    cosine: float  # of planted and recovered weights, each times the spread of its term over the candidates
    regret: float  # mean planted cost of what the recovered weights choose above the least, over the mean spread
    choices: int
    weights: dict[str, tuple[float, float, float]]  # key -> planted, recovered (at one temperature), share of costs
    uninformed: tuple[str, ...]  # left out


def situations(loop: LoopParams, task: ImitationTask) -> Situation:
    """Overtaking starts [N, ...] with the ego anywhere in its lane, as the stack sees them."""
    family, base = OvertakeParams(), as_arrays(loop)
    params, sim = base.handed_down()
    graph = overtake.road(family)
    course, lanes = course_between(graph, RIGHT, goal=RIGHT), tables.from_graph(graph)

    def one(key: jax.Array) -> Situation:
        start, beside = jax.random.split(key)
        world = overtake.sample(start, as_arrays(family), vehicle=base.vehicle, others=base.sim.traffic).world
        shift, turn, steering = jax.random.uniform(beside, (3,), minval=-1.0) * jnp.array([0.8, 0.05, 0.03])
        ego = world.ego.replace(
            position=world.ego.position + jnp.stack([jnp.zeros(()), shift]),
            heading=world.ego.heading + turn,
            steering=steering,
        )
        world = world.replace(ego=ego)
        station = stack.init(params, course, ego.pose).station
        seen = worlds.observe(sim, lanes, world=world)
        return look(params.situation, course, station=station, ego=ego, observation=seen).replace(signals=None)

    keys = jax.random.split(jax.random.key(task.seed), task.planted)
    return jax.jit(lambda keys: jax.lax.map(one, keys, batch_size=AT_ONCE))(keys)


def demonstrated(loop: LoopParams, seen: Situation) -> Demonstration:
    """Situations as demonstrations whose driver stands: what it did is drawn later."""
    n = seen.ego.speed.shape[0]
    still = jnp.tile(seen.ego.position[:, None], (1, 15, 1))
    return Demonstration(
        situation=seen,
        vehicle=jax.tree.map(lambda x: jnp.full(n, x), as_arrays(loop.vehicle)),
        time=jnp.tile(0.2 * jnp.arange(1.0, 16.0), (n, 1)),
        position=still,
        heading=jnp.tile(seen.ego.heading[:, None], (1, 15)),
        valid=jnp.ones((n, 15), bool),
    )


def of_candidates(task: ImitationTask, loop: LoopParams, choices: Choices) -> Recovered:
    """Weights of the micro plan, from candidates drawn with planted ones."""
    keys = fit.WEIGHTS
    weights = np.array([float(getattr(loop.stack.planning.micro.weights, name)) for name in imitation.MICRO_TERMS])
    planted = weights * [1.0, PLANTED[0], *PLANTED[1:3], 1.0, *PLANTED[3:], 1.0]  # by MICRO_TERMS
    planted[imitation.MICRO_TERMS.index("acceleration")] = PLANTED_ACCELERATION
    cost = np.asarray(choices.features @ planted + choices.broken)
    drawn = draw(cost, task.seed)
    # The driver keeps to the candidate that it chose.
    error = np.where(np.arange(cost.shape[1])[None] == drawn[:, None], 0.0, 1.0)
    chosen = choices.replace(error=np.repeat(error[..., None], 2, axis=2).astype(np.float32))
    found = fit.fit_weights(task, loop, chosen, part=np.ones(len(cost), bool), start=TEMPERATURE)
    moved = found.params(loop).stack.planning.micro.weights
    own = np.array([float(getattr(moved, name)) for name in imitation.MICRO_TERMS]) / found.temperature
    feature, allowed = np.asarray(choices.features), choices.broken <= choices.broken.min(axis=1, keepdims=True)
    spread = np.sqrt(np.mean(np.var(feature, axis=1, where=allowed[..., None]), axis=0))
    at = [i for i, name in enumerate(imitation.MICRO_TERMS) if name not in ("length", "transition")]
    least, chosen_cost = (
        cost.min(axis=1),
        np.take_along_axis(cost, (feature @ own + choices.broken).argmin(axis=1)[:, None], axis=1)[:, 0],
    )
    return Recovered(
        cosine=cosine((planted * spread)[at], (own * spread)[at]),
        regret=float((chosen_cost - least).mean() / np.std(cost, axis=1, where=allowed).mean()),
        choices=len(cost),
        weights=told(keys, planted[at], own[at] * TEMPERATURE, spread[at]),
        uninformed=("transition",),
    )


def of_paths(task: ImitationTask, loop: LoopParams, found: DrivenPath) -> Recovered:
    """Weights of the lattice, from paths drawn with planted ones."""
    weights = as_arrays(loop.stack.planning.macro.weights)
    names = [key.removeprefix(paths.PREFIX) for key in paths.LATTICE_WEIGHTS if not key.endswith("oncoming")]
    factors = dict(zip(names, PLANTED_LATTICE, strict=True))
    known = weights.replace(**{name: getattr(weights, name) * factor for name, factor in factors.items()})
    prices = jax.jit(jax.vmap(lattice.weighed, (0, None)))
    start, edges = (np.asarray(x, float) for x in prices(found.costs, known))
    drawn = draw_paths(start, edges, task.seed)
    seen = found.replace(node=drawn.astype(np.int32), reached=np.ones(drawn.shape, bool))
    every = np.ones(len(drawn), bool)
    z, _ = paths.fit_paths(loop, seen, part=every, value=paths.losses_of(loop), prior=0.0)
    values = paths.space(loop, paths.LATTICE_WEIGHTS).values(jnp.asarray(z[:-1], jnp.float32))
    temperature = paths.START * float(np.exp(z[-1]))
    own = {name: values[paths.PREFIX + name] / temperature for name in names}
    size = {name: spread_of(start, edges, found, name) for name in names}
    planted = {name: float(getattr(known, name)) for name in names}
    scaled = (np.array([of[name] * size[name] for name in names]) for of in (planted, own))
    best = jax.jit(jax.vmap(lambda s, e: lattice.layered_search(s, e, relaxation=lattice.Relaxation())))
    tuned = weights.replace(**{name: jnp.asarray(values[paths.PREFIX + name]) for name in names})
    node = np.asarray(best(*prices(found.costs, tuned))[1]).argmax(axis=-1)
    paid, least = price_of(start, edges, node), price_of(start, edges, np.asarray(best(start, edges)[1]).argmax(-1))
    return Recovered(
        cosine=cosine(*scaled),
        regret=float((paid - least).mean() / least.mean()),
        choices=len(drawn),
        weights=told(
            [paths.PREFIX + n for n in names],
            *(np.array([of[n] for n in names]) for of in (planted, {n: x * TEMPERATURE for n, x in own.items()}, size)),
        ),
        uninformed=("transition", "oncoming"),
    )


def told(
    keys: Sequence[str], planted: np.ndarray, own: np.ndarray, spread: np.ndarray
) -> dict[str, tuple[float, float, float]]:
    """By key: weights planted and found, and their share of what costs differ by (where small, little is told)."""
    share = planted * spread / np.sum(planted * spread)
    return {key: (float(a), float(b), float(c)) for key, a, b, c in zip(keys, planted, own, share, strict=True)}


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    """Of the angle between two vectors."""
    return float(one @ other / np.sqrt((one @ one) * (other @ other)))


def draw(cost: np.ndarray, seed: int) -> np.ndarray:
    """A candidate [N] for each row of costs [N, J] (m), by their shares at the planted temperature."""
    noise = np.random.default_rng(seed).gumbel(size=cost.shape)
    return (noise - np.asarray(cost, float) / TEMPERATURE).argmax(axis=1)


def draw_paths(start: np.ndarray, edges: np.ndarray, seed: int) -> np.ndarray:
    """Nodes [N, S] of paths drawn by their likelihood. Costs of starts [N, M] and edges [N, S - 1, M, M] (m)."""
    value = [np.zeros_like(start)]
    for cost in np.moveaxis(edges, 1, 0)[::-1]:
        through = -(cost + value[-1][:, None, :]) / TEMPERATURE
        value.append(-TEMPERATURE * np.logaddexp.reduce(through, axis=2))
    noise = np.random.default_rng(seed).gumbel(size=(edges.shape[1] + 1, *start.shape))
    node, rows = [(noise[0] - (start + value[-1]) / TEMPERATURE).argmax(axis=1)], np.arange(len(start))
    for k in range(edges.shape[1]):
        going = edges[rows, k, node[-1]] + value[-2 - k]
        node.append((noise[k + 1] - going / TEMPERATURE).argmax(axis=1))
    return np.stack(node, axis=1)


def price_of(start: np.ndarray, edges: np.ndarray, node: np.ndarray) -> np.ndarray:
    """Cost [N] (m) of paths through nodes [N, S]."""
    rows = np.arange(len(start))[:, None]
    steps = edges[rows, np.arange(edges.shape[1])[None], node[:, :-1], node[:, 1:]]
    return start[rows[:, 0], node[:, 0]] + steps.sum(axis=1)


def spread_of(start: np.ndarray, edges: np.ndarray, found: DrivenPath, name: str) -> float:
    """Root mean variance of one term over paths that are drawn with the planted weights."""
    zero = {"nodes": {}, "start": {}, "edges": {}}
    costs, shape = found.costs, edges.shape
    terms = {part: getattr(costs, part).get(name) for part in zero}
    first = np.zeros(start.shape) + (0 if terms["start"] is None else np.asarray(terms["start"]))
    nodes = np.zeros((shape[0], shape[1] + 1, shape[2])) + (0 if terms["nodes"] is None else np.asarray(terms["nodes"]))
    between = np.zeros(shape) + (0 if terms["edges"] is None else np.asarray(terms["edges"]))
    between = between + nodes[:, 1:, None, :]
    drawn = [price_of(first + nodes[:, 0], between, draw_paths(start, edges, 100 + k)) for k in range(8)]
    return float(np.sqrt(np.mean(np.var(drawn, axis=0))))
