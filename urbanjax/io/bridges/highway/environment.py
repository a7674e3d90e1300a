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


def open_environment(name: str, **config: Any) -> Any:
    """The environment `name` with both continuous controls at 15 Hz; `reset(seed=...)` places the traffic.

    Rewards are left out: some are defined for discrete actions only.
    Args: name, as registered (`highway-v0`); config, values over the environment's own. Raises ConfigError for an
    unknown name.
    """
    import gymnasium
    import highway_env  # noqa: F401  registers its environments
    from gymnasium.envs.registration import load_env_creator

    try:
        creator = load_env_creator(gymnasium.spec(name).entry_point)
    except gymnasium.error.Error as error:
        raise ConfigError(f"no highway-env environment '{name}': {str(error).splitlines()[0]}") from error
    driven = type(f"Driven{creator.__name__}", (creator,), {"_reward": _no_reward, "_rewards": _no_rewards})
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


def _no_reward(self: Any, action: Any) -> float:
    return 0.0


def _no_rewards(self: Any, action: Any) -> dict[str, float]:
    return {}


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
    """Put highway-env's IDM and MOBIL vehicle in the place and state of the ego; the other traffic stays as it is.

    Args: env, an environment after its reset; change_lanes, false for a vehicle that keeps to its lane.
    """
    from highway_env.vehicle.behavior import IDMVehicle

    ego = env.vehicle
    idm = IDMVehicle(env.road, ego.position, ego.heading, ego.speed, enable_lane_change=change_lanes)
    env.road.vehicles[env.road.vehicles.index(ego)] = idm
    env.controlled_vehicles[0] = idm
