"""How fast registration is, beside small_gicp on the same clouds where that is installed (extra `peers`)."""

import importlib
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np

from experiments.common import timing
from urbanjax import registration
from urbanjax.registration import AlignParams, MapParams, PreprocessParams
from urbanjax.registration.downsample import DownsampleParams
from urbanjax.types import SEED, as_arrays, pytree, static


@pytree
class RegistrationStudy:
    """Two scans of one made-up street, and what is done with them."""

    preprocess: PreprocessParams = PreprocessParams(downsample=DownsampleParams(resolution=0.5, capacity=16384))
    map: MapParams = MapParams()
    align: AlignParams = AlignParams()
    points: int = static(default=69_000)  # of each scan
    starts: int = static(default=64)  # around the truth
    threads: int = static(default=2)  # of small_gicp
    repeats: int = static(default=20)
    seed: int = static(default=0, metadata=SEED)


def street(n: int, seed: int) -> np.ndarray:
    """N points [n, 3] (m) of ground, two rows of houses with gaps, and poles, denser nearby, 1 cm of noise."""
    rng = np.random.default_rng(seed)
    far = 45 * rng.uniform(-1, 1, n) ** 3
    aside, up = rng.uniform(-1, 1, n), rng.uniform(0, 1, n)
    side = np.sign(aside)
    setback = 9 + 2 * np.sign(np.sin(far / 3.7)) * side
    house = np.stack([far, side * setback, 8 * up**2 - 1.8], 1)
    front = np.stack([7.4 * np.round(far / 7.4), side * (9 + 2 * aside), 8 * up**2 - 1.8], 1)
    ground = np.stack([far, 9 * aside, 0 * up - 1.8 + 0.02 * aside], 1)
    around = 0.1 * np.cos(40 * up), 0.1 * np.sin(40 * up)
    pole = np.stack([11 * np.round(far / 11) + around[0], side * 6 + around[1], 5 * up - 1.8], 1)
    which = rng.choice(4, n, p=[0.35, 0.15, 0.45, 0.05])
    return np.choose(which[:, None], [house, front, ground, pole]) + 0.01 * rng.normal(size=(n, 3))


def measure(study: RegistrationStudy, tick: Callable[[str], None] = lambda label: None) -> dict[str, float]:
    """Medians in milliseconds, ours and small_gicp's (if there), and how far the answers are apart."""
    tick("registration")
    truth = jaxlie.SE3.exp(jnp.array([0.5, 0.1, 0.02, 0.002, -0.003, 0.02]))
    back = np.asarray(truth.inverse().as_matrix(), float)
    target = street(study.points, study.seed)
    source = street(study.points, study.seed + 1) @ back[:3, :3].T + back[:3, 3]
    params = as_arrays(study)
    prepare, build, align, many = (
        jax.jit(f) for f in (registration.preprocess, registration.build, registration.align, registration.align_starts)
    )
    raw = [registration.padded(points, study.points) for points in (source, target)]
    peer = peer_of(study, source, target)
    if peer is None:
        clouds = [prepare(*arrays, params=params.preprocess)[0] for arrays in raw]
    else:
        clouds = [
            registration.cloud(
                jnp.asarray(c.points()[:, :3], jnp.float32), jnp.asarray(np.asarray(c.covs())[:, :3, :3], jnp.float32)
            )
            for c in peer.clouds
        ]
    world = build(clouds[1], params.map)
    twists = np.random.default_rng(study.seed).normal(size=(study.starts, 6)) * [0.3, 0.3, 0.05, 0.01, 0.01, 0.03]
    starts = jax.vmap(jaxlie.SE3.exp)(jnp.asarray(twists, jnp.float32))
    identity = jaxlie.SE3.identity()
    found = align(clouds[0], world, start=identity, params=params.align)
    out = {
        "registration_dropped_voxels": float(prepare(*raw[0], params=params.preprocess)[1].dropped),
        "registration_points": float(clouds[0].valid.sum()),
        "registration_error_m": float(jnp.linalg.norm((found.pose.inverse() @ truth).translation())),
    }
    calls: dict[str, Callable[[], Any]] = {
        "preprocess": lambda: prepare(*raw[0], params=params.preprocess),
        "map": lambda: build(clouds[1], params.map),
        "align": lambda: align(clouds[0], world, start=identity, params=params.align),
        f"align_{study.starts}_starts": lambda: many(clouds[0], world, starts=starts, params=params.align),
    }
    for name, call in calls.items():
        tick(f"registration: {name}")
        out[f"registration_{name}_ms"] = _milliseconds(call, study.repeats)
        if peer is not None:
            matrices = np.asarray(starts.as_matrix(), float)
            out[f"small_gicp_{name}_ms"] = _milliseconds(lambda n=name, m=matrices: peer.call(n, m), study.repeats)
    if peer is not None:
        off = np.linalg.inv(peer.align(np.eye(4))) @ np.asarray(found.pose.as_matrix(), float)
        out["registration_from_small_gicp_m"] = float(np.linalg.norm(off[:3, 3]))
    return out


def table(numbers: dict[str, float]) -> dict[str, list[Any]]:
    """Columns by heading for people."""
    names = [n.removeprefix("registration_").removesuffix("_ms") for n in numbers if n.endswith("_ms")]
    names = [n for n in names if f"registration_{n}_ms" in numbers]
    peers = [numbers.get(f"small_gicp_{n}_ms") for n in names]
    ours = [numbers[f"registration_{n}_ms"] for n in names]
    ratio = [None if theirs is None else mine / theirs for mine, theirs in zip(ours, peers, strict=True)]
    return {"registration (median, warm)": names, "ours [ms]": ours, "small_gicp [ms]": peers, "ratio": ratio}


class SmallGicp:
    """small_gicp on the same points."""

    def __init__(self, library: Any, study: RegistrationStudy, source: np.ndarray, target: np.ndarray):
        self.library, self.study, self.raw = library, study, source
        self.clouds = [self._prepare(points) for points in (source, target)]
        self.world = self._map()

    def call(self, name: str, starts: np.ndarray) -> None:
        """Do what the row `name` of the table times. Args: starts [S, 4, 4]."""
        if name == "preprocess":
            self._prepare(self.raw)
        elif name == "map":
            self._map()
        else:
            for start in [np.eye(4)] if name == "align" else starts:
                self.align(start)

    def align(self, start: np.ndarray) -> np.ndarray:
        """The pose [4, 4] that it finds."""
        found = self.library.align(
            self.world,
            self.clouds[0],
            init_T_target_source=start,
            max_correspondence_distance=float(self.study.align.factor.max_distance),
            num_threads=self.study.threads,
        )
        return np.asarray(found.T_target_source)

    def _prepare(self, points: np.ndarray) -> Any:
        down = self.study.preprocess
        return self.library.preprocess_points(
            points,
            downsampling_resolution=float(down.downsample.resolution),
            num_neighbors=down.features.neighbours,
            num_threads=self.study.threads,
        )[0]

    def _map(self) -> Any:
        world = self.library.GaussianVoxelMap(float(self.study.map.resolution))
        world.insert(self.clouds[1])
        return world


def peer_of(study: RegistrationStudy, source: np.ndarray, target: np.ndarray) -> SmallGicp | None:
    """The peer, or None where it is not installed."""
    try:
        library = importlib.import_module("small_gicp")
    except ImportError:
        return None
    return SmallGicp(library, study, source, target)


def _milliseconds(call: Callable[[], Any], repeats: int) -> float:
    """Warm median."""
    timing.seconds(call)
    return 1e3 * timing.median(call, runs=repeats)
