"""Typed errors: raised at the edge, never inside jit. Each message names the key or file and the remedy."""


class UrbanJaxError(Exception):
    """Base of every error that urbanjax raises on purpose."""


class ConfigError(UrbanJaxError):
    """A configuration key or value is wrong."""


class RoadError(UrbanJaxError):
    """A road network is empty, inconsistent or not finite."""


class RouteError(UrbanJaxError):
    """A route cannot be planned: a goal, start or via-point is unknown or unreachable."""


class ScenarioError(UrbanJaxError):
    """A scenario, observation or simulation input is out of range."""


class CloudError(UrbanJaxError):
    """A point cloud is empty, too large for its capacity or not finite."""


class FileError(UrbanJaxError):
    """A file is missing, truncated or not what its name says."""


class ProcessError(UrbanJaxError):
    """A process that shares a run has ended early or was told to: none of them can go on."""


class TrafficError(UrbanJaxError):
    """A course, an area or another input of the traffic analysis is out of range."""


class TuningError(UrbanJaxError):
    """A search over parameters cannot go on: its settings, losses, gradients or history are not what it needs."""


class GradientError(TuningError):
    """A gradient is not finite: `restart` and `parameter` say in which point and which of its elements."""

    def __init__(self, *, restart: int, parameter: int) -> None:
        super().__init__(
            f"the gradient of restart {restart} is not finite in parameter {parameter}: pin this parameter, or move "
            "the start to where the loss is differentiable"
        )
        self.restart, self.parameter = restart, parameter


class NotFiniteError(TuningError):
    """A loss or a gradient in a closed loop is not finite: where, and by which parameter."""

    def __init__(self, *, generation: int, parameter: str, scene: str) -> None:
        what = f"the derivative with respect to '{parameter}'" if parameter else "the loss"
        super().__init__(
            f"generation {generation}: {what} is not finite in the scene {scene}; leave this "
            f"{'parameter' if parameter else 'mission'} out, or lower 'rate' and 'sigma'"
        )
        self.generation, self.parameter, self.scene = generation, parameter, scene
