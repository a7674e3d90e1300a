"""Encounters in which a driver was found to fail, as a mission: the numbers of each are what a file of them holds."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from urbanjax.evaluation.aim import Aim
from urbanjax.evaluation.case import Case
from urbanjax.sim.agents import TrafficParams
from urbanjax.sim.scenarios import encounters
from urbanjax.sim.scenarios.encounter_families import FAMILIES, SIZE, EncounterStage, Family, staged
from urbanjax.types import ConfigError, as_arrays, host_record, with_values
from urbanjax.types.config import nearest
from urbanjax.vehicle.params import VehicleParams

LAST = 0.15  # s before the end, from which on a drive counts as survived: its last step, at any usual period
PREFIX = "found_"  # of the mission's name, before the family's


@host_record
class FoundScene:
    """One encounter by its numbers."""

    family: str
    numbers: Mapping[str, float]  # by key


@host_record
class FoundMission:
    """All encounters of one family: survived without a violation is won."""

    family: Family
    scenes: tuple[FoundScene, ...]

    @property
    def name(self) -> str:
        """Of the mission, in rows."""
        return f"{PREFIX}{self.family.name}"

    @property
    def size(self) -> Hashable:
        """What the shapes of its cases depend on."""
        return "encounter", SIZE

    @property
    def longest(self) -> float:
        """Duration [s] of its drives."""
        return self.family.duration

    @property
    def count(self) -> int:
        """How many encounters there are."""
        return len(self.scenes)

    def case(self, seed: int, *, others: TrafficParams, vehicle: VehicleParams) -> Case:
        """The encounter of a number. Args: seed, its number; others, how traffic drives; vehicle, the ego's."""
        numbers = as_arrays(with_values(self.family.numbers, self.scenes[seed].numbers))
        case, place = encounter_case(self.family, others=others, vehicle=vehicle)
        start = jax.tree.map(jnp.asarray, case.start)
        met = encounters.meet(start, self.family.encounter(numbers, place), limit=place.limit)
        return jax.device_get(case.replace(start=met))


def encounter_case(
    family: Family, *, others: TrafficParams, vehicle: VehicleParams
) -> tuple[Case, encounters.EncounterPlace]:
    """The case of a family before anybody meets (`encounters.meet`), and its place: to be survived to the end.

    Args: family; others, how traffic drives; vehicle, the ego's dimensions.
    """
    where = staged(family, others=others, vehicle=vehicle)
    case = Case(where.stage.corridor, where.stage.lanes, where.world, **_to_the_end(where, family.duration))
    return case, where.place


def _to_the_end(where: EncounterStage, duration: float) -> dict[str, Any]:
    """Goal, limit and aim: to be there at the end of a drive; scores of progress take a way at the speed limit."""
    anything = jnp.array([[-jnp.inf, jnp.inf]])
    aim = Aim(
        outline=jnp.zeros((1, 1, 1, 2)),
        anywhere=jnp.array([True]),
        time=jnp.array([[duration - LAST, jnp.inf]]),
        speed=anything,
        heading=jnp.array([[0.0, 2 * jnp.pi]]),
    )
    return jax.device_get(
        as_arrays({"goal": where.start + where.place.limit * duration, "limit": duration, "aim": aim})
    )


def found_missions(scenes: Sequence[FoundScene]) -> list[FoundMission]:
    """A mission for each family, in the order in which they come.

    Args: scenes. Raises ConfigError for a family that there is not, and for a number that it has not or out of range.
    """
    for number, scene in enumerate(scenes):
        if scene.family not in FAMILIES:
            raise ConfigError(
                f"scene {number} is of the family {scene.family!r}, which there is not{nearest(scene.family, FAMILIES)}"
            )
        try:
            with_values(FAMILIES[scene.family].numbers, scene.numbers)
        except ConfigError as error:
            raise ConfigError(f"scene {number}, {scene.family}: {error}") from error
    names = dict.fromkeys(scene.family for scene in scenes)
    return [FoundMission(FAMILIES[name], tuple(x for x in scenes if x.family == name)) for name in names]
