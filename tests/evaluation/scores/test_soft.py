"""The soft twins of all scores: their gradients, and what they tend to."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.evaluation.scores.drives import VEHICLE, batch, busy_drive, clean_drive, edited, stacked
from tests.evaluation.scores.test_epdms import CALM, random_window
from tests.trees import float_leaves
from urbanjax.evaluation.scores import carla, commonroad, competition, epdms, nuplan
from urbanjax.evaluation.scores.epdms_windows import STEPS
from urbanjax.numerics.soft import Relaxation


def busy_window():
    """A window that is close to all of its thresholds, but loses nothing for good."""
    rng = np.random.default_rng(3)
    window = clean_drive(t=STEPS, others=((9.0, 0.2, 0.05, 8.5), (-9.0, 1.0, 0.1, 10.5), (6.0, 3.2, 0.02, 10.0)))
    noise = {
        name: getattr(window, name) + rng.normal(scale=0.2, size=STEPS)
        for name in ("yaw_rate", "acceleration", "road_margin")
    }
    ego = window.ego.replace(heading=0.1 * np.sin(np.arange(STEPS) / 6), speed=10 + rng.normal(scale=0.1, size=STEPS))
    offset = 0.5 + rng.normal(scale=0.02, size=STEPS)
    oncoming = edited(np.zeros(STEPS, bool), [20, 21], True)
    return window.replace(ego=ego, offset=offset, oncoming=oncoming, **noise)


def windowed(window, before, reference, relaxation):
    return epdms.score(window, VEHICLE, reference=reference, before=before, relaxation=relaxation)


def drives():
    return [(drive,) for drive in batch(8, 60, 60)]


def windows():
    rng = np.random.default_rng(8)
    return [random_window(rng) for _ in range(60)]


@dataclasses.dataclass
class Twin:
    score: object  # of what is given and a relaxation
    busy: object  # makes what is given, close to all thresholds
    drawn: object  # makes many of them at random
    reaches: int  # leaves of the first of them that have a derivative, at least
    atol: float = 1e-9  # of the derivatives
    rtol: float = 1e-7  # of the value in mode straight-through


def of_drives(score, reaches, **more):
    return Twin(score, lambda: (busy_drive(),), drives, reaches, **more)


LARGE = {"atol": 1e-8, "rtol": 1e-5}  # of scores that reach far beyond 1
TWINS = {
    "nuplan": of_drives(lambda f, relaxation: nuplan.score(f, VEHICLE, relaxation=relaxation), 10),
    "carla": of_drives(lambda f, relaxation: carla.score(f, relaxation=relaxation), 3, **LARGE),
    "commonroad": of_drives(lambda f, relaxation: commonroad.cost(f, relaxation=relaxation), 3, **LARGE),
    "competition": of_drives(lambda f, relaxation: competition.score(f, VEHICLE, relaxation=relaxation), 3, **LARGE),
    "epdms": Twin(windowed, lambda: (busy_window(), CALM, jnp.asarray(60.0)), windows, 9),
}
every = pytest.mark.parametrize("twin", TWINS.values(), ids=TWINS)


@every
def test_the_gradient_is_that_of_finite_differences(x64, twin):
    first, *others = twin.busy()
    floats, back = float_leaves(jax.tree.map(jnp.asarray, first))

    def total(x, temperature):
        return twin.score(back(x), *others, Relaxation(temperature, mode="soft")).total

    value_and_slopes, rng = jax.jit(jax.value_and_grad(total)), np.random.default_rng(0)
    for temperature in (0.3, 1.0):
        _, slopes = value_and_slopes(floats, temperature)
        assert all(np.isfinite(slope).all() for slope in slopes)
        assert sum(np.abs(slope).max() > 1e-8 for slope in slopes) >= twin.reaches
        for _ in range(3):
            way = [rng.normal(size=np.shape(x)) for x in floats]
            ahead, behind = (
                value_and_slopes([x + step * w for x, w in zip(floats, way, strict=True)], temperature)[0]
                for step in (1e-6, -1e-6)
            )
            along = sum(np.sum(slope * w) for slope, w in zip(slopes, way, strict=True))
            np.testing.assert_allclose(along, (ahead - behind) / 2e-6, rtol=1e-4, atol=twin.atol)


@every
def test_it_tends_to_the_hard_score(x64, twin):
    given = stacked(twin.drawn())
    soft = jax.jit(lambda t: jax.vmap(lambda *one: twin.score(*one, Relaxation(t, mode="soft")))(*given))
    hard = jax.jit(jax.vmap(lambda *one: twin.score(*one, Relaxation())))(*given)
    names = [spec.name for spec in dataclasses.fields(hard)]

    def error(temperature):
        """The largest of each run."""
        found = soft(temperature)
        pairs = ((np.asarray(getattr(x, name), float) for x in (found, hard)) for name in names)
        return np.max([np.abs(one - other).reshape(len(one), -1).max(axis=1) for one, other in pairs], axis=0)

    errors = [error(temperature) for temperature in (1e-1, 1e-3, 1e-5)]
    assert np.mean(errors[0]) > np.mean(errors[1]) > np.mean(errors[2])
    assert np.max(errors[2]) < 1e-3


@every
def test_straight_through_has_the_value_of_hard(twin):
    given = jax.tree.map(jnp.asarray, twin.busy())
    through, hard = (
        jax.jit(lambda *one, how=how: twin.score(*one, how))(*given)
        for how in (Relaxation(0.3, mode="straight_through"), Relaxation())
    )
    for spec in dataclasses.fields(hard):
        found, wanted = (np.asarray(getattr(x, spec.name), float) for x in (through, hard))
        np.testing.assert_allclose(found, wanted, rtol=twin.rtol, atol=1e-5, err_msg=spec.name)


def test_every_score_has_a_twin_here():
    """But for the smooth one, whose gradient is tested with the metrics."""
    files = {path.stem for path in Path(epdms.__file__).parent.glob("*.py")}
    assert files - {"__init__", "smooth", "epdms_terms", "epdms_windows"} == TWINS.keys()
