"""One real pair of scans beside small_gicp: the same numbers on the same clouds, and the time that they take."""

import functools
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from experiments.common import registration_speed, timing
from experiments.common.registration_speed import RegistrationStudy
from urbanjax import registration
from urbanjax.io.clouds import pointclouds
from urbanjax.io.clouds.poses import read_matrix
from urbanjax.io.files import data_folder
from urbanjax.registration import PreprocessParams
from urbanjax.registration.downsample import DownsampleParams, downsample
from urbanjax.registration.features import features
from urbanjax.types import Unread, as_arrays, pytree, static


@pytree
class PairParams:
    """How the pair is registered, the same on both sides."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "folder": Unread("the pair is left out, see 'pair.use'", lambda p: not p.use),
        "speed": Unread("the pair is left out, see 'pair.use'", lambda p: not p.use),
    }

    # Voxels of the peer begin elsewhere: room for a few more than it keeps.
    speed: RegistrationStudy = RegistrationStudy(
        preprocess=PreprocessParams(downsample=DownsampleParams(resolution=0.25, capacity=8192)), repeats=15
    )
    # With source.ply, target.ply and T_target_source.txt; by default that of the data beside the project.
    folder: str = static(default="", metadata={"path": True})
    use: bool = static(default=True)


def folder_of(params: PairParams) -> Path:
    """Where the pair is."""
    return Path(params.folder or data_folder() / "lidar" / "outdoor_pair")


def missing(params: PairParams) -> str | None:
    """One line on why the comparison is left out, None if it is not."""
    if not params.use:
        return "The real pair is left out: pair.use is false."
    if not (folder_of(params) / "source.ply").is_file():
        return f"The real pair is left out: there is no {folder_of(params).name} (set URBANJAX_DATA or pair.folder)."
    if importlib.util.find_spec("small_gicp") is None:
        return "The real pair is left out: small_gicp is not installed (extra `peers`)."
    return None


def compare(params: PairParams, tick: Callable[[str, float | None], None]) -> tuple[dict[str, float], dict[str, float]]:
    """Agreement (name with unit) and times (as `registration_speed.measure`), with compile times and memory."""
    source, target = (pointclouds.read(folder_of(params) / f"{name}.ply") for name in ("source", "target"))
    truth = read_matrix(folder_of(params) / "T_target_source.txt")
    study = params.speed
    peer: Any = registration_speed.peer_of(study, source, target)
    tick("real pair: agreement", None)
    with jax.enable_x64(True):
        agreement = _agreement(study, peer, truth)
    agreement |= _features(study, peer, source)
    tick("real pair: time", None)
    return agreement, _times(study, peer, (source, target))


def _cloud(peer_cloud: Any, dtype: Any) -> registration.PointCloud:
    covariance = np.asarray(peer_cloud.covs())[:, :3, :3]
    return registration.cloud(jnp.asarray(peer_cloud.points()[:, :3], dtype), jnp.asarray(covariance, dtype))


def _agreement(study: RegistrationStudy, peer: Any, truth: np.ndarray) -> dict[str, float]:
    """Ours in double precision on the peer's own clouds, from the identity and at the peer's answer."""
    params = as_arrays(study)
    source, target = (_cloud(cloud, jnp.float64) for cloud in peer.clouds)
    world = jax.jit(registration.build)(target, params.map)
    align = jax.jit(registration.align)
    theirs = peer.library.align(peer.world, peer.clouds[0], num_threads=study.threads)
    out: dict[str, float] = {}
    for name, pose in (("start", np.eye(4)), ("end", np.asarray(theirs.T_target_source))):
        at = jaxlie.SE3.from_matrix(jnp.asarray(pose))
        one = align(source, world, start=at, params=params.align.replace(max_iterations=1))
        peers = peer.library.align(
            peer.world, peer.clouds[0], init_T_target_source=pose, num_threads=study.threads, max_iterations=1
        )
        scale = np.sqrt(np.abs(np.diag(peers.H)))
        out[f"pair_{name}_hessian_difference_share"] = _worst(one.hessian, peers.H, np.outer(scale, scale))
        # The gradient vanishes at the end: it is measured against what a point moved by 1 mm would change.
        out[f"pair_{name}_gradient_difference_mm"] = 1e3 * _worst(one.gradient, peers.b, np.abs(np.diag(peers.H)))
        out[f"pair_{name}_inlier_difference"] = abs(float(one.inliers) - peers.num_inliers)
    found = align(source, world, start=jaxlie.SE3.identity(), params=params.align)
    ours = np.asarray(found.pose.as_matrix())
    for name, pose, reference in (
        ("fixed_point_difference", ours, np.asarray(theirs.T_target_source)),
        ("error", ours, truth),
        ("small_gicp_error", np.asarray(theirs.T_target_source), truth),
    ):
        out[f"pair_{name}_m"], out[f"pair_{name}_deg"] = _between(reference, pose)
    out["pair_iterations"], out["pair_small_gicp_iterations"] = int(found.iterations), int(theirs.iterations)
    out["pair_cost"], out["pair_small_gicp_cost"] = float(found.cost), float(theirs.error)
    means = np.asarray(world.rows)[np.asarray(world.rows)[:, 9] > 0, :3] + np.asarray(world.origin)
    away, _ = cKDTree(np.asarray(peer.world.voxel_points())[:, :3]).query(means)
    out["pair_voxel_mean_difference_m"] = float(away.max())
    out["pair_voxels"], out["pair_small_gicp_voxels"] = len(means), int(peer.world.size())
    return out


def _features(study: RegistrationStudy, peer: Any, source: np.ndarray) -> dict[str, float]:
    """Normals on the peer's down-sampled points, and means of the raw points, in single precision."""
    params = as_arrays(study)
    theirs = np.asarray(peer.clouds[0].points())[:, :3]
    tree = cKDTree(theirs)
    cloud, _ = jax.jit(features)(_cloud(peer.clouds[0], jnp.float32), params.preprocess.features)
    valid = np.asarray(cloud.valid)
    _, same = tree.query(np.asarray(cloud.position).T[valid])
    cosine = np.abs((np.asarray(cloud.normal).T[valid] * np.asarray(peer.clouds[0].normals())[same, :3]).sum(1))
    raw = registration.padded(source, len(source))
    thinned, _ = jax.jit(downsample)(*map(jnp.asarray, raw), params=params.preprocess.downsample)
    away, _ = tree.query(np.asarray(thinned.position).T[np.asarray(thinned.valid)])
    return {
        "pair_points": int(np.asarray(thinned.valid).sum()),
        "pair_small_gicp_points": len(theirs),
        "pair_downsampled_same_share": float((away < 1e-3).mean()),
        "pair_normals_within_1_deg_share": float((cosine > np.cos(np.radians(1.0))).mean()),
    }


def _times(study: RegistrationStudy, peer: Any, points: tuple[np.ndarray, np.ndarray]) -> dict[str, float]:
    """Warm medians of both sides, compile times and memory of ours."""
    params, identity = as_arrays(study), jaxlie.SE3.identity()
    raw = tuple(jnp.asarray(x) for x in registration.padded(points[0], len(points[0])))
    source, target = (_cloud(cloud, jnp.float32) for cloud in peer.clouds)
    twists = np.random.default_rng(study.seed).normal(size=(study.starts, 6)) * [0.3, 0.3, 0.05, 0.01, 0.01, 0.03]
    starts = jax.vmap(jaxlie.SE3.exp)(jnp.asarray(twists, jnp.float32))
    # Where the processor is busy, threads wait for each other: one thread shows what the peer needs then.
    peers = {"small_gicp": peer, "small_gicp_one_thread": registration_speed.peer_of(study.replace(threads=1), *points)}
    out: dict[str, float] = {}

    def measure(name: str, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        seconds, program = timing.timed(lambda: jax.jit(function).lower(*arguments, **named).compile())
        memory: Any = program.memory_analysis()
        out[f"registration_{name}_compile_s"] = seconds
        out[f"registration_{name}_memory_mb"] = (memory.temp_size_in_bytes + memory.output_size_in_bytes) / 1e6
        run = functools.partial(program, *arguments, **named)
        result = run()
        out[f"registration_{name}_ms"] = 1e3 * timing.median(run, runs=study.repeats)
        for label, other in peers.items():
            call = functools.partial(other.call, name, np.asarray(starts.as_matrix(), float))
            call()
            out[f"{label}_{name}_ms"] = 1e3 * timing.median(call, runs=study.repeats)
        return result

    measure("preprocess", registration.preprocess, *raw, params=params.preprocess)
    world = measure("map", registration.build, target, params.map)
    measure("align", registration.align, source, world, start=identity, params=params.align)
    measure(
        f"align_{study.starts}_starts", registration.align_starts, source, world, starts=starts, params=params.align
    )
    return out


def table(numbers: dict[str, float]) -> dict[str, list[Any]]:
    """The rows of `registration_speed.table`, with compile times and memory of ours."""
    rows = registration_speed.table(numbers)
    names = next(iter(rows.values()))
    rows["small_gicp, one thread [ms]"] = [numbers[f"small_gicp_one_thread_{name}_ms"] for name in names]
    rows["ours, compiling [s]"] = [numbers[f"registration_{name}_compile_s"] for name in names]
    rows["ours, memory [MB]"] = [numbers[f"registration_{name}_memory_mb"] for name in names]
    return rows


def _worst(ours: Any, theirs: Any, scale: np.ndarray) -> float:
    return float((np.abs(np.asarray(ours) - np.asarray(theirs)) / scale).max())


def _between(reference: np.ndarray, pose: np.ndarray) -> tuple[float, float]:
    """Distance in m and angle in degrees."""
    away = np.linalg.inv(reference) @ pose
    return float(np.linalg.norm(away[:3, 3])), float(np.degrees(Rotation.from_matrix(away[:3, :3]).magnitude()))
