"""The paper's Table I, a factorial study of its parameters, and the covariance: `python -m experiments.register`."""

import time

from urbanjax.io import cli, progress, report
from urbanjax.io.runs import Run
from urbanjax.io.studies.register import calibration, factorial, figures, pair, rows, stretch
from urbanjax.io.studies.register.bench import Bench
from urbanjax.io.studies.register.study import RegisterStudy

STATED = (
    "A made-up stretch of 0.4 km with buildings, walls, trees, poles and parked cars, driven at up to 60 km/h "
    "through a left turn at an intersection; a 128-channel sensor with rolling shutter, 3 cm of range noise and 5 "
    "% drop-out; 20 moving cars that are not in the map; a map from a drive of its own, with errors of its poses "
    "of 1 cm. Scans are thinned to voxels of {thin:g} m, and the motion during a sweep is taken out with wheel "
    "speed and yaw rate, bias and all. A point may belong to any of {neighbours} voxels. NDT takes its "
    "covariances from a denser map."
)
OUTCOME = (
    "Our outcome, since the paper defines none: fail (lost) if the planar error is above {lost:g} m from some "
    "scan on to the end, fail (slow) if the median scan takes more than {period:g} ms with pre-processing, window "
    "and registration. Means are over the scans before the loss. Matching error: Eq. 1. Threads do not apply to "
    "us: rows 5 to 7 are one and the same here. Where the paper prints a dash: {iterations} iterations, epsilon "
    "{epsilon:g} m, any correspondence distance."
)


def table1(study: RegisterStudy, bench: Bench, run: Run) -> report.Section:
    """The rows as printed along the drive."""
    with progress.bar("Table I") as tick:
        tracks = rows.drive(bench, study.rows, study.seed, tick)
    speed = rows.speeds(bench, study.rows)
    found = rows.table(tracks, speed, float(study.lost), bench.period)
    run.table("table1", found)
    run.summary(rows.summary(found))
    progress.show_table("Table I", {name: found[name] for name in SHOWN})
    figures.draw_rows(tracks, speed, bench.period, float(study.lost), run.path("table1.png"))
    caption = OUTCOME.format(
        lost=study.lost, period=1e3 * bench.period, iterations=rows.OPEN_ITERATIONS, epsilon=rows.OPEN_EPSILON
    )
    text = STATED.format(thin=study.localizer.preprocess.downsample.resolution, neighbours=study.neighbours)
    picture = report.Picture("Errors along the drive (a cross: lost), the speed, and the time.", run.path("table1.png"))
    return report.Section("Table I", [text], [report.Table(caption, found), picture])


SHOWN = ("row", "method", "paper", "start", "ours", "lost at [km/h]", "mean error [m]", "scan [ms]")


def full(study: RegisterStudy, bench: Bench, run: Run) -> report.Section:
    """The factorial study."""
    with progress.bar("factorial") as tick:
        grid = factorial.run(bench, study.factorial, study.seed, tick)
    lost, period = float(study.lost), bench.period
    effects, alarms = factorial.effects(grid, lost, period), factorial.thresholds(grid, lost)
    run.table("factorial_cells", factorial.cells(grid, lost, period))
    run.table("factorial_registrations", factorial.records(grid))
    run.table("factorial_effects", effects)
    run.table("factorial_thresholds", alarms)
    run.summary(factorial.summary(grid, lost, period))
    progress.show_table("factorial: main effects", effects)
    figures.draw_effects(grid, lost, period, run.path("factorial_effects.png"))
    figures.draw_cells(grid, lost, run.path("factorial_cells.png"))
    figures.draw_thresholds(grid, lost, run.path("factorial_thresholds.png"))
    text = [
        f"{grid.distance.size} registrations: each of {len(grid.speed)} scans in every cell, from the same start, "
        f"which is where the vehicle was one period before at a speed drawn evenly up to "
        f"{3.6 * float(study.factorial.speed):.0f} km/h. Success is a planar error below {lost:g} m. A registration "
        f"that converged within a smaller limit of iterations is not repeated with a larger one: it would be the same. "
        f"Up to {grid.dropped.max()} voxels of a scan or window found no place in its capacity."
    ]
    items = [
        report.Table("Main effects: over all other axes and scans.", effects),
        report.Picture(
            "Main effects by method, and against the speed of the start.", run.path("factorial_effects.png")
        ),
        report.Picture("All cells.", run.path("factorial_cells.png")),
        report.Table("What the matching error tells of a wrong pose.", alarms),
        report.Picture("Matching errors of right and wrong poses.", run.path("factorial_thresholds.png")),
    ]
    return report.Section("Every combination", text, items)


def covariance(study: RegisterStudy, bench: Bench, run: Run) -> report.Section:
    """The calibration of the covariance."""
    with progress.bar("calibration") as tick:
        found = calibration.calibrate(bench, study.calibration, study.seed, tick)
    numbers = calibration.summary(found)
    run.summary(numbers)
    run.table("calibration", calibration.table(found))
    progress.show_table("calibration", {"": list(numbers), "value": list(numbers.values())})
    figures.draw_calibration(found, run.path("calibration.png"))
    text = [
        f"The sandwich covariance of the localizer's registration times s^2, which is fitted so that "
        f"{100 * found.level:g} % of {len(found.fit.nees)} planar errors lie inside their ellipsoid, and tested on "
        f"{len(found.test.nees)} others with poses, starts and noise drawn anew: s^2 = {found.scale:.4g}, "
        f"coverage {100 * found.coverage():.1f} % (unscaled {100 * found.coverage(scale=1.0):.1f} %). The map and its "
        f"errors are the same for all of them."
    ]
    picture = report.Picture("Normalised squared errors, coverage, and each error apart.", run.path("calibration.png"))
    return report.Section("Covariance", text, [picture])


def real(study: RegisterStudy, run: Run) -> report.Section:
    """The real pair beside small_gicp, or why not."""
    reason = pair.missing(study.pair)
    if reason:
        print(reason)
        return report.Section("A real pair", [reason])
    with progress.bar("real pair") as tick:
        agreement, times = pair.compare(study.pair, tick)
    run.summary(agreement | times)
    speed = pair.table(times)
    run.table("pair_speed", speed)
    progress.show_table("real pair", speed)
    columns = {"": list(agreement), "value": list(agreement.values())}
    progress.show_table("agreement with small_gicp", columns)
    text = [f"small_gicp on {study.pair.speed.threads} threads, on the same clouds; agreement in double precision."]
    return report.Section(
        "A real pair", text, [report.Table("Warm medians.", speed), report.Table("Agreement.", columns)]
    )


@cli.experiment("register", RegisterStudy)
def main(study: RegisterStudy, run: Run) -> None:
    """Run all parts and write the report as far as it goes."""
    factorial.checked(study.factorial)
    with progress.bar("world") as tick:
        world = stretch.build(study.world, study.localizer, tick)
    bench = Bench(world, study.localizer, study.world.sensor, study.neighbours)
    sections = []
    for part in (table1, full, covariance):
        began = time.perf_counter()
        sections.append(part(study, bench, run))
        run.summary({f"{part.__name__}_wall_s": time.perf_counter() - began})
    made = bench.programs.count()
    run.summary({"programs": sum(made.values()), "programs_compile_s": bench.programs.seconds})
    sections.append(real(study, run))
    text = f"{sum(made.values())} programs were compiled in {bench.programs.seconds:.0f} s, one for each set of shapes."
    counts = report.Table("Programs by function.", {"function": list(made), "programs": list(made.values())})
    sections.append(report.Section("Programs", [text], [counts]))
    report.write_report(run.path("report.html"), "Registration (Table I)", sections, run.manifest("complete"))


if __name__ == "__main__":
    main()
