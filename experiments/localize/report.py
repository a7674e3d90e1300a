"""Localization over the whole district (Table II), under injected failures, or on a folder of real scans."""

import numpy as np

from experiments.common import district
from experiments.common.district import World
from experiments.localize import faults, figures, folder, loop, methods
from experiments.localize.study import LocalizeStudy
from experiments.localize.track import LocalizedTrack, LocalizerPrograms
from urbanjax.evaluation import statistics, survey
from urbanjax.io.clouds import pointmap
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.localization import capacity
from urbanjax.localization.lidar import LidarLocalizerParams
from urbanjax.types import as_arrays

STATED = (
    "A made-up district of 5.2 km with buildings, walls, trees, poles and parked cars; a 128-channel sensor with "
    "rolling shutter, 3 cm of range noise and 5 % drop-out; 20 moving cars that are not in the map; wheel speed and "
    "yaw rate with bias and noise; a map made from a drive of its own, with errors of its poses. Coverage is the share "
    "of scans with an error below 0.5 m. Brackets are 95 % intervals, of means from drawing stretches of the drive."
)
DROPPED = (
    "Up to {scan} voxels of a scan and {window} of the map's window found no place and were left out: raise "
    "localizer.preprocess.downsample.capacity, or localizer.sliding.cut.capacity."
)


def table2(study: LocalizeStudy, world: World, run: Run) -> tuple[report.Section, dict[str, LocalizedTrack]]:
    """All methods over the drive: table, figures, numbers."""
    period = float(study.world.drive.period)
    with progress.bar("localization") as tick:
        found, tracks = methods.compare(study, world, tick)
    rows = methods.table(found, period)
    run.table("table2", rows)
    outputs = methods.between_scans(world, tracks["proposed"], float(study.output_rate), period)
    run.summary(methods.summary(found, period))
    scan, window = np.max([track.rows.dropped.max(0) for track in tracks.values()], axis=0).tolist()
    run.summary({"most_dropped_voxels_of_a_scan": scan, "most_dropped_voxels_of_a_window": window})
    text = [STATED]
    if scan or window:
        text.append(DROPPED.format(scan=scan, window=window))
        print(f"Warning: {text[-1]}")
    run.summary({"output_rate_hz": float(study.output_rate)})
    run.summary(statistics.mean(outputs.mean(1), groups=statistics.stretches(len(outputs))).flat("output_mean_error_m"))
    shown = methods.as_printed(rows)
    progress.show_table("Table II", shown)
    figures.draw_fig7(world, found, run.path("fig7.png"))
    figures.draw_errors(world, found, tracks, run.path("errors.png"))
    items = [
        report.Table("Every method on the same scans.", shown),
        report.Picture("Paths over the point-cloud map, as in Fig. 7.", run.path("fig7.png")),
        report.Picture("Along the drive.", run.path("errors.png")),
    ]
    return report.Section("Localization over the whole course", text, items), tracks


def failures(study: LocalizeStudy, world: World, tracks: dict[str, LocalizedTrack], run: Run) -> report.Section:
    """Injected failures: what the localizer says while it is wrong, and the detector beside Eq. 8."""
    period = float(study.world.drive.period)
    localizer = survey.mounted(study.localizer, study.world.sensor, period=study.world.drive.period)
    programs = LocalizerPrograms(world, *as_arrays((localizer, study.search, study.world.sensor)))
    total = len(faults.KINDS) * study.faults.seeds
    with progress.bar("failures") as tick:
        count = iter(range(1, total + 1))
        found = faults.inject(programs, study.faults, study.seed, lambda kind: tick(kind, next(count) / total))
    rows = faults.table(found, period)
    seen = faults.detection([*tracks.values(), *(fault.track for fault in found)])
    run.table("failures", rows)
    run.summary(seen)
    run.summary(faults.unnoticed(found, period).flat("wrong_but_normal_for_1_s_share"))
    for row in zip(*rows.values(), strict=True):
        run.summary({f"{row[0]}_{name}": value for name, value in zip(FAULT_NAMES, row[2:], strict=True)})
    searches = np.concatenate([fault.track.relocalize_ms for fault in found])
    if len(searches) > 1:
        run.summary({"relocalization_median_ms": float(np.median(searches[1:]))})
    progress.show_table("injected failures", rows)
    figures.draw_faults(found, period, run.path("failures.png"))
    text = [
        f"Wrong means more than {faults.WRONG} m off. Of {seen['registrations']} registrations "
        f"{seen['registrations_wrong']} were wrong; the detector missed {seen['detector_missed']} of them and refused "
        f"{seen['detector_false_alarms']} right ones. Area under its ROC curve: {report.cell(seen['detector_auc'])}; "
        f"of Eq. 8, read as a failure test: {report.cell(seen['literal_gate_auc'])}, which exceeded its threshold "
        f"{seen['literal_gate_fires']} times."
    ]
    items = [
        report.Table("Failures on drawn stretches.", rows),
        report.Picture("Each failure.", run.path("failures.png")),
    ]
    return report.Section("Injected failures", text, items)


def closed_loop(study: LocalizeStudy, world: World, run: Run) -> report.Section:
    """Overtaking in the district on poses from scans alone."""
    with progress.bar("closed loop") as tick:
        driven = loop.drive(study.loop, world, study.localizer, study.world.sensor, tick)
    rows = loop.table(driven)
    run.table("closed_loop", rows)
    run.summary(loop.summary(driven))
    progress.show_table("closed loop on poses from scans", rows)
    loop.draw(driven, run.path("closed_loop.png"))
    items = [
        report.Table(f"{study.loop.starts} starts for each tau.", rows),
        report.Picture("Overtaking where the car believes to be.", run.path("closed_loop.png")),
    ]
    return report.Section("Closed loop", ["Scan to steering: no pose is given."], items)


FAULT_NAMES = (
    "wrong_but_normal_s",
    "largest_error_while_normal_m",
    "recovered",
    "recovery_median_s",
    "recovery_longest_s",
    "not_normal_percent",
)


def _fitted(study: LocalizeStudy, world: World) -> LidarLocalizerParams:
    """The localizer with room for the map and the scans of this world, where none is set."""
    here = survey.mounted(study.localizer, study.world.sensor, period=study.world.drive.period)
    scans = survey.some_scans(here, study.world.sensor, surroundings=world.surroundings, way=world.tour)
    return capacity.fitted(study.localizer, world=world.course.map, scans=scans)


def write(params: LocalizeStudy, run: Run) -> None:
    """Run the study, or odometry on a folder, and write a report."""
    if params.folder:
        sections = [folder.study(params, run)]
    else:
        with progress.bar("world") as tick:
            world = district.build(params.world, params.localizer, tick, params.map)
        if not params.map:
            pointmap.save(run.path("map.npz"), world.points)
        params = params.replace(localizer=_fitted(params, world))
        faults.checked(params.faults, world.tour, float(params.world.drive.period))
        loop.checked(params.loop, world.course.graph)
        section, tracks = table2(params, world, run)
        sections = [section]
        if params.faults.seeds:
            sections.append(failures(params, world, tracks, run))
        if params.loop.starts:
            sections.append(closed_loop(params, world, run))
    report.write_report(run.path("report.html"), "Localization", sections=sections, manifest=run.manifest("complete"))
