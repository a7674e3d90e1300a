"""What a parameter file is good for, on one page that stands beside it."""

import numpy as np

from experiments.tune import tested
from experiments.tune.search import Searched
from experiments.tune.study import TuneStudy
from experiments.tune.tested import MEASURES, HeldBackDrives
from urbanjax.tuning import SceneParams
from urbanjax.tuning.tune import Tuned

WORSE = 5  # drives that got worse, named
LIMITS = (
    "Weights and limits that guard safety were pinned and are as before. The score is `evaluation.score`: progress, "
    "clearance, comfort; who wants something else has to tune for it. Simulated traffic is IDM and MOBIL in the "
    "manners named; real drivers were not seen. Gradients are of relaxed choices: they are a guide, and every number "
    "here is of hard ones."
)


def card(params: TuneStudy, found: Searched, *, tuned: Tuned, result: HeldBackDrives | None) -> str:
    """The card as Markdown. Args: params; found, the search; tuned, its outcome; result, of the tests, if any."""
    lines = ["# Tuned parameters", ""]
    beside = ", and the layers of a learned cost" if params.network else ""
    lines += [f"- tuned: {found.search.space.size} numbers ({', '.join(params.tuned)}{beside})"]
    lines += [f"- learned from: {_told(params.learned)}", f"- judged by: {_told(params.judged)}"]
    lines += [
        f"- search: {params.training.optimiser}, {found.search.generation} generations of {params.training.scenes} "
        f"scenes, {np.sum(found.seconds):.0f} s; a gradient costs {found.multiple:.1f} forward passes",
        f"- gain in the scenes that it was judged by (hopeful): {tuned.gain.text(3)}",
    ]
    if result is not None:
        lines += _test_lines(params, result)
    return "\n".join([*lines, "", "## Limits", "", LIMITS, ""])


def _test_lines(params: TuneStudy, result: HeldBackDrives) -> list[str]:
    first, name = result.names
    which = params.tested
    head = f"{len(result.rows[first])} whole drives of {', '.join(which.missions)} among {', '.join(which.traffic)}"
    lines = [
        "",
        "## Tested",
        "",
        f"{head}, paired:",
        "",
        f"| | {first} | {name} | difference |",
        "|---|---|---|---|",
    ]
    table = tested.table(result)
    rows = [k for k, traffic in enumerate(table["traffic"]) if traffic == "all"]
    for k, (title, _) in zip(rows, MEASURES.values(), strict=True):
        lines.append(f"| {title} | {table[first][k]} | {table[name][k]} | {table[f'{name} - {first}'][k]} |")
    lines += ["", "## Drives that got worse", ""]
    for before, after in tested.worse(result, name, WORSE):
        ended = f"; now: {after['cause_name']}" if after.get("cause_name") else ""
        lines.append(
            f"- {after['mission']}, seed {after['seed']}, {after['traffic']} traffic: score {before['score']:.2f} to "
            f"{after['score']:.2f}{ended}"
        )
    return lines


def _told(which: SceneParams) -> str:
    names, traffic = ", ".join(which.missions), ", ".join(which.traffic)
    return f"{which.count} scenes of {names} among {traffic} traffic, on {len(which.roads)} roads of each"
