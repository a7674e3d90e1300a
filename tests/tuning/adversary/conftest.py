"""Arenas of drivers that compile in seconds, and one program of a single drive in each family's world."""

import jax
import jax.numpy as jnp
import pytest

from urbanjax.drivers import ConstantVelocity
from urbanjax.rollout import LoopParams
from urbanjax.sim.scenarios.encounter_families import FAMILIES
from urbanjax.sim.scenarios.encounters import Encounter
from urbanjax.tuning.adversary import ThreatParams, arena
from urbanjax.tuning.adversary.arena import drive
from urbanjax.tuning.adversary.braking import avoidance


class Lane:
    """The ego, which goes on as it does, behind a leader: any distance and speed."""

    def __init__(self):
        loop = LoopParams().replace(driver=ConstantVelocity())
        family = FAMILIES["braking_leader"]
        self.arena = arena(loop, family, mode="soft", temperature=0.3, params=ThreatParams())
        self._judge = jax.jit(self._judged)

    def encounter(self, gap: float, **numbers: float) -> Encounter:
        """A leader that stands `gap` m ahead, unless numbers say otherwise."""
        station = self.arena.place.front + gap + self.arena.place.half
        rows = {"ego_speed": 10.0, "station": station, "speed": 0.0, "offset": 0.0, "brakes_at": 100.0}
        rows |= {"braking": 0.0, "moves_at": 0.0, "moves_for": 1.0, "onset": 0.0} | numbers
        return Encounter(**{name: jnp.asarray(value, float) for name, value in rows.items()})

    def threat(self, encounter: Encounter, steps: int) -> jax.Array:
        """In m."""
        a = self.arena
        return drive(a.hard, a.case, encounter=encounter, params=a.params, n_steps=steps)[0]

    def judge(self, encounter: Encounter) -> tuple:
        """Threat, whether it failed, avoidance."""
        return self._judge(encounter)

    def _judged(self, encounter):
        a = self.arena
        value, driven = drive(a.hard, a.case, encounter=encounter, params=a.params, n_steps=a.steps)
        oracle = avoidance(
            driven.log, a.case, collision=driven.collision, onset=encounter.onset, vehicle=a.hard.vehicle
        )
        return value, driven.collision.any(), oracle


@pytest.fixture(scope="session")
def lane():
    return Lane()
