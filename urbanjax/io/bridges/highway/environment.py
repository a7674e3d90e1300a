"""highway-env's environments, opened so that any ego can drive them."""

from typing import Any

import numpy as np

from urbanjax.types import ConfigError

FREQUENCY = 15  # Hz, of the simulation and of the driver
ACCELERATION = (-6.0, 3.0)  # m/s^2
STEERING = (-np.pi / 4, np.pi / 4)  # rad
SPEED = (0.0, 40.0)  # m/s
EGO_COLOUR = (50, 200, 0)
SCREEN = {"screen_width": 720, "screen_height": 200}  # px
TALL = 300  # px: an environment whose own screen is as high keeps it
WITHOUT_ROUTE = {
    "parking-": "it has parking spaces, but no road to drive along",
    "lane-keeping-": "it asks for one lane to be held, but has no route to drive",
}  # by the beginning of the name


def drivable() -> tuple[str, ...]:
    """The environments of highway-env in which a road can be driven along."""
    return tuple(name for name in _registered() if not name.startswith(tuple(WITHOUT_ROUTE)))


def check_drivable(name: str) -> None:
    """Nothing where the environment can be driven; raises ConfigError where not. Args: name, as registered."""
    names = drivable()
    if name in names:
        return
    why = "highway-env registers no such environment"
    if name in _registered():
        why = next(why for beginning, why in WITHOUT_ROUTE.items() if name.startswith(beginning))
    raise ConfigError(f"no highway-env environment '{name}' to drive: {why}; set 'envs' to some of {', '.join(names)}")


def open_environment(name: str, **config: Any) -> Any:
    """The environment `name` with both continuous controls at 15 Hz; `reset(seed=...)` places the traffic.

    Its ego has a `route` where the environment sends it somewhere, or where `destination` names a node of the road.
    Args: name, as registered (`highway-v0`); config, values over the environment's own. Raises ConfigError for one
    that cannot be driven.
    """
    check_drivable(name)
    import gymnasium
    from gymnasium.envs.registration import load_env_creator

    from urbanjax.io.bridges.highway.driven import DrivenEnv

    creator = load_env_creator(gymnasium.registry[name].entry_point)
    driven = type(f"Driven{creator.__name__}", (DrivenEnv, creator), {})
    action = {
        "type": "ContinuousAction",
        "longitudinal": True,
        "lateral": True,
        "acceleration_range": ACCELERATION,
        "steering_range": STEERING,
        "speed_range": SPEED,
    }
    defaults = {
        "observation": {"type": "AttributesObservation", "attributes": ["time"]},  # ours is read from the road
        "action": action,
        "simulation_frequency": FREQUENCY,
        "policy_frequency": FREQUENCY,
    }
    screen = SCREEN if creator.default_config()["screen_height"] < TALL else {}
    return driven(config={**defaults, **screen, **config}, render_mode="rgb_array")


def _registered() -> list[str]:
    """All environments of highway-env, of any version, in its own order."""
    import gymnasium
    import highway_env  # noqa: F401  registers its environments

    specs = gymnasium.registry.items()
    return [name for name, spec in specs if str(spec.entry_point).startswith("highway_env.")]


def action_of(acceleration: float, steering: float) -> np.ndarray:
    """[2] in [-1, 1]: the action for an acceleration (m/s^2) and a road-wheel angle (rad, positive = left, y up).

    Args: acceleration [m/s^2]; steering [rad].
    """
    scaled = [
        (acceleration - ACCELERATION[0]) / (ACCELERATION[1] - ACCELERATION[0]),
        (-steering - STEERING[0]) / (STEERING[1] - STEERING[0]),  # the screen's y points down
    ]
    return np.clip(2.0 * np.asarray(scaled) - 1.0, -1.0, 1.0)


def make_idm(env: Any, change_lanes: bool = True) -> None:
    """Put highway-env's IDM and MOBIL vehicle in the place, state and route of the ego; the rest stays as it is.

    Args: env, an environment after its reset; change_lanes, false for a vehicle that keeps to its lane.
    """
    from urbanjax.io.bridges.highway.driven import replace_with_idm

    env.vehicle = replace_with_idm(env.road, env.vehicle, change_lanes=change_lanes)
