"""Odometry and localization on a folder of real scans: nothing is known of the vehicle but what the sensor saw."""

from pathlib import Path
from typing import Any

import jax
import jaxlie
import numpy as np

from experiments.common import timing
from experiments.localize.study import LocalizeStudy
from urbanjax import registration
from urbanjax.io.clouds import pointclouds
from urbanjax.io.clouds.poses import read_kitti, write_kitti
from urbanjax.io.figures.style import BAD, GOOD, figure
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.localization import odometry
from urbanjax.localization.capacity import fitted
from urbanjax.registration.register import size
from urbanjax.types import FileError, as_arrays

LOOKED_AT = 16  # scans that the capacity of all is chosen from, where none is set


def study(params: LocalizeStudy, run: Run) -> report.Section:
    """Odometry over all scans of the folder, written as KITTI poses; with known poses also its errors."""
    files = scans_in(Path(params.folder))
    truth = _truth(params, len(files))
    capacity = capacity_for(params, files)
    with progress.bar("odometry") as tick:
        poses, rows = drive(params, files, capacity, lambda k: tick(files[k].name, k / len(files)))
    write_kitti(run.path("poses.txt"), poses)
    columns: dict[str, Any] = {name: [row[name] for row in rows] for name in rows[0]}
    run.summary({"scans": len(files), "way_m": way(poses)[-1], "step_median_ms": np.median(columns["step [ms]"][1:])})
    lost = dropped(columns["dropped voxels"], capacity)
    run.summary({"capacity": capacity, "dropped_voxels": sum(columns["dropped voxels"])})
    if truth is not None:
        away = np.linalg.inv(truth) @ poses
        columns["error [m]"] = np.linalg.norm(away[:, :3, 3], axis=1).tolist()
        run.summary({"final_error_m": columns["error [m]"][-1], "largest_error_m": max(columns["error [m]"])})
    run.table("scans", columns)
    progress.show_table("odometry", {name: values[-10:] for name, values in columns.items()})
    _draw(poses, truth, run.path("odometry.png"))
    if lost:
        print(f"Warning: {lost}")
    text = [f"{len(files)} scans, {way(poses)[-1]:.1f} m. Poses are written to poses.txt in KITTI format."]
    text += [lost] if lost else []
    items = [report.Picture("The way, from above.", run.path("odometry.png")), report.Table("Scan by scan.", columns)]
    return report.Section(f"Odometry on {Path(run.config.get('folder', params.folder)).name}", text, items)


def scans_in(folder: Path) -> list[Path]:
    """The scans of a folder, by name. Raises FileError if there are fewer than two."""
    if not folder.is_dir():
        raise FileError(f"{folder}: there is no such folder; set folder= to one with scans")
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in pointclouds.READERS)
    if len(files) < 2:
        raise FileError(f"{folder}: holds {len(files)} scans ({', '.join(pointclouds.READERS)}); two are needed")
    return files


def capacity_for(params: LocalizeStudy, files: list[Path]) -> int:
    """Points of a thinned scan: as set, or what they need and some to spare, by a look at a few of the scans."""
    chosen = np.unique(np.linspace(0, len(files) - 1, LOOKED_AT).astype(int))
    return fitted(params.localizer, scans=[_near(params, files[k]) for k in chosen]).capacity


def dropped(counts: list[int], capacity: int) -> str:
    """One sentence on scans that lost voxels; empty if none did. Args: counts, voxels without a place by scan."""
    if not sum(counts):
        return ""
    return (
        f"{np.count_nonzero(counts)} of {len(counts)} scans have more voxels than localizer.preprocess.downsample."
        f"capacity={capacity}, up to {max(counts)} more; what found no place was left out: raise it, or leave it out."
    )


def _near(params: LocalizeStudy, file: Path) -> np.ndarray:
    """The points of a scan that are looked at."""
    points = pointclouds.read(file)
    return points[np.hypot(points[:, 0], points[:, 1]) < float(params.localizer.sensing_radius)]


def drive(
    params: LocalizeStudy, files: list[Path], capacity: int, tick: Any = lambda k: None
) -> tuple[np.ndarray, list[dict]]:
    """Poses [T, 4, 4] from the first scan on, and what happened scan by scan; the last motion predicts the next.

    Args: capacity, points of a thinned scan.
    """
    localizer = as_arrays(params.localizer)
    thinning = localizer.preprocess.downsample.replace(capacity=capacity)
    preparation = localizer.preprocess.replace(downsample=thinning)
    prepare, step = jax.jit(registration.preprocess), jax.jit(odometry.step)
    state = odometry.init(localizer.odometry, capacity)
    motion = jaxlie.SE3.identity()
    poses, rows = [], []
    for k, file in enumerate(files):
        points = _near(params, file)
        padded = registration.padded(points, size(len(points)))

        def one(padded: tuple = padded, state: Any = state, motion: Any = motion) -> Any:
            cloud, info = prepare(*padded, params=preparation)
            return cloud, info, *step(localizer.odometry, state, cloud, motion)

        seconds, (cloud, info, state, found) = timing.timed(one)
        motion = found.T_before_after
        poses.append(np.asarray(odometry.travelled(state).as_matrix(), float))
        rows.append(
            {
                "scan": file.name,
                "points": int(cloud.valid.sum()),
                "dropped voxels": int(info.dropped),
                "fits": bool(found.tracked) or k == 0,
                "inlier share": float(found.alignment.inlier_share),
                "iterations": int(found.alignment.iterations),
                "step [ms]": 1e3 * seconds,
            }
        )
        tick(k)
    return np.stack(poses), rows


def way(poses: np.ndarray) -> np.ndarray:
    """Length [T] m of the way up to each pose [T, 4, 4]."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _truth(params: LocalizeStudy, count: int) -> np.ndarray | None:
    if not params.poses:
        return None
    poses = read_kitti(params.poses)
    if len(poses) < count:
        raise FileError(f"{params.poses}: holds {len(poses)} poses for {count} scans")
    return np.linalg.inv(poses[0]) @ poses[:count]


def _draw(poses: np.ndarray, truth: np.ndarray | None, path: Path) -> None:
    with figure(path, 6.0, height=5.0) as canvas:
        axes = canvas.subplots()
        if truth is not None:
            axes.plot(truth[:, 0, 3], truth[:, 1, 3], ".-", color=BAD, label="given poses")
        axes.plot(poses[:, 0, 3], poses[:, 1, 3], ".-", color=GOOD, label="odometry")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(xlabel="x [m]", ylabel="y [m]", title="From above, in the frame of the first scan")
        axes.legend()
