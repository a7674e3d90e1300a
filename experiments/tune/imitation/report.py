"""The reports of imitation: of the micro plan's choices, and of ways through the lattice."""

from typing import Any

import numpy as np

from experiments.tune.imitation import figures, paths, recovery, tables
from experiments.tune.imitation.fit import FAN, WEIGHTS
from experiments.tune.imitation.predictors import CONSTANT, LINEAR, NETWORK, study
from experiments.tune.imitation.task import RecordedDrivers, chosen_from, drivers, with_fan
from urbanjax.evaluation import statistics
from urbanjax.io.runs import parameter_file, progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.networks import save_learned
from urbanjax.tuning import space

CAPTION = (
    "Displacement of the candidate of least cost from the driver 3 s later, along the candidate's own times: the "
    "speeds are those that the planner assumes of its fan, which the velocity planner does not drive. Each "
    "recording is predicted by parameters that have not seen it. 'Printed': Eq. 22-24 as printed, all weights 1, so "
    "that distance to obstacles is a cost. 'Default' has the deployed fan of end speeds 0.5 and 1 times free flow; "
    "'wide fan' has the end speeds of this task, as all that follow, since nobody drives just half or all of free "
    "flow. 'Likely weights' are of greatest likelihood, 'tuned weights' of least expected displacement, both with a "
    "cost of accelerating, which is 0 by default; 'tuned linear' also has end speeds, acceleration and deceleration at "
    "free flow, speed in curves and the clearance that is enough, by the gradient through the planner. Log density of "
    "what was driven (two dimensions, comparable over fans), log share of the nearest candidate that breaks no limit "
    "(of one fan only); each at the temperature that suits the training files. Brackets: 95 %, bootstrap by driver. "
)
LATTICE_CAPTION = (
    "Held-out log-likelihood of the driven path per layer that the record reaches; layers beyond are summed over. "
    "Left out: paths whose nodes collide with what was predicted or break what no weight pays for, whose price is "
    "pinned. Both sets of weights at the temperature that suits the training files. Brackets: 95 %, bootstrap by "
    "driver. "
)


def write(params: Any, run: Run) -> None:
    """Tune the micro plan from recorded drivers; tables, figures and report."""
    task, loop = params.imitation, params.loop()
    with progress.bar("imitation") as tick:
        seen = drivers(task, loop, tick)
        found = study(task, loop, seen, tick)
        tick("planted weights")
        wide = with_fan(loop, task)
        planted = recovery.demonstrated(wide, recovery.situations(wide, task))
        known = {"candidates": recovery.of_candidates(task, wide, choices_of(wide, planted))}
        known["lattice"] = recovery.of_paths(task, wide, paths.driven_paths(wide, planted))
        tick("figures")
        before = {number.key: number.value for number in space(wide, (*WEIGHTS, *FAN)).numbers}
        shown = {
            "predictors": tables.predictors(found, seen),
            "differences": tables.paired_rows(found, seen),
            "files": tables.by_file(found, seen),
            "weights": tables.weights(found, before),
            "planted": tables.recovered(known),
        }
        for name, columns in shown.items():
            run.table(name, columns)
        _summary(run, seen, found, known)
        _keep(run, found)
        pictures = _pictures(run, seen, found, wide, shown["weights"])
    for name in ("predictors", "differences"):
        progress.show_table(name, shown[name])
    captions = (
        CAPTION + tables.verdict(found, seen),
        "Paired differences",
        "FDE by recording [m]",
        "What was tuned",
        "Planted drivers",
    )
    items = [report.Table(c, shown[name]) for c, name in zip(captions, shown, strict=True)]
    _report(run, "Imitation of recorded drivers", [*items[:3], *pictures, *items[3:], *_left_out(seen)])


def choices_of(loop: Any, every: Any) -> Any:
    """What the fan offers at simulated starts."""
    return chosen_from(loop, every)


def write_lattice(params: Any, run: Run) -> None:
    """Tune the macro lattice from driven paths; tables, figure and report."""
    task, loop = params.imitation, params.loop()
    with progress.bar("lattice") as tick:
        seen = drivers(task, loop, tick)
        found = paths.study_paths(task, loop, seen, tick)
        start = {number.key: number.value for number in space(loop, paths.LATTICE_WEIGHTS).numbers}
        table = tables.paths(found, seen)
        run.table("lattice", table)
        weights = {"weight": list(start), "before": list(start.values())}
        weights |= {f"without {name}": list(values.values()) for name, values in found.weights.items()}
        weights["weight"] += ["temperature [m]", "temperature of default weights [m]"]
        weights["before"] += [np.nan, np.nan]
        for name, (default, tuned) in found.temperature.items():
            weights[f"without {name}"] += [tuned, default]
        run.table("lattice_weights", weights)
        some = found.use
        for name, values in (("default", found.default), ("tuned", found.tuned), ("gain", found.tuned - found.default)):
            value = statistics.mean(values[some], groups=seen.driver[some])
            run.summary(value.flat(f"{name}_log_likelihood_nat_per_layer"))
        run.summary({"paths": int(some.sum()), "paths_left_out": int((~some).sum())})
        figures.draw_paths(found, start, run.path("lattice.png"))
    progress.show_table("lattice", table)
    picture = report.Picture("The searches, and what they came to", run.path("lattice.png"))
    items = [
        report.Table(LATTICE_CAPTION + tables.verdict_of_paths(found, seen), table),
        picture,
        report.Table("Weights", weights),
        *_left_out(seen),
    ]
    _report(run, "Imitation of driven paths", items)


def _summary(run: Run, seen: RecordedDrivers, found: Any, known: dict[str, recovery.Recovered]) -> None:
    run.summary({"drivers": len(set(seen.driver)), "moments": len(seen.driver), "files": len(seen.files)})
    for name, one in found.predictions.items():
        key = name.replace(", ", "_").replace(" ", "_")
        for what, value in tables.measured(one, seen).items():
            run.summary(value.flat(f"{key}_{what}"))
    for name, value in tables.differences(found, seen).items():
        key = name.replace(", ", "_").replace(" ", "_")
        run.summary(value.flat(f"{key}_less_default_wide_fan_fde_m"))
    against = tables.differences(found, seen, LINEAR)
    run.summary(against[NETWORK].flat("tuned_network_less_linear_fde_m"))
    run.summary(against[CONSTANT].flat("constant_velocity_less_linear_fde_m"))
    for name, one in known.items():
        run.summary({f"planted_{name}_cosine": one.cosine, f"planted_{name}_regret_share": one.regret})


def _keep(run: Run, found: Any) -> None:
    """What was tuned without each file, as parameter files and networks."""
    for name, (_, fan, linear) in found.fits.items():
        values = fan.space.values(np.asarray(fan.z, np.float32)) | linear.space.values(np.asarray(linear.z, np.float32))
        about = {"what": f"tuned linear costs, without {name}"}
        parameter_file.write_parameters(run.path(f"without_{name}.yaml"), values, about=about)
        save_learned(run.path(f"without_{name}.safetensors"), found.networks[name])


def _pictures(run: Run, seen: RecordedDrivers, found: Any, wide: Any, weights: dict[str, list]) -> list[report.Picture]:
    figures.draw_errors(found, seen, run.path("errors.png"))
    figures.draw_losses(found, run.path("losses.png"))
    figures.draw_weights(weights, run.path("weights.png"))
    figures.draw_examples(found, seen, wide, run.path("examples.png"))
    captions = {
        "errors": "Displacement by horizon; bands: 95 %, bootstrap by driver",
        "examples": "Where tuning gains most over the default of the same fan, and last where it loses most",
        "losses": "The searches, without each file",
        "weights": "What was tuned, over what it was",
    }
    return [report.Picture(caption, run.path(f"{name}.png")) for name, caption in captions.items()]


def _left_out(seen: RecordedDrivers) -> list[report.Table]:
    if not seen.left_out:
        return []
    return [report.Table("Left out", {"who": list(seen.left_out), "why": list(seen.left_out.values())})]


def _report(run: Run, title: str, items: list) -> None:
    section = report.Section(title, [], items)
    report.write_report(run.path("report.html"), title, sections=[section], manifest=run.manifest("complete"))
