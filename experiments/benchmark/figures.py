"""The figure of the divergence's speed: time and memory against the number of points."""

from pathlib import Path

from experiments.benchmark.divergence_points import KINDS
from urbanjax.io.figures.style import GOOD, OTHER, figure

LINES = (
    ("divergence", GOOD, "o-", "urbanjax"),
    ("ckdtree", OTHER, "^-", "cKDTree"),
    ("ckdtree_unbalanced", OTHER, "v--", "cKDTree, unbalanced"),
    ("package", OTHER, "s:", "package divergence 1.1.0"),
)


def draw(numbers: dict[str, float], path: Path) -> None:
    """Milliseconds of one pair of teams for each kind of points, and bytes per point, against the points of a team."""
    ending = "_bytes_per_point"
    names = [key.removeprefix("divergence_").removesuffix(ending) for key in numbers if key.endswith(ending)]
    sizes = sorted({int(key.split("_")[2]) for key in numbers if _is_time_of_pair(key)})
    with figure(path, 10.0, height=3.6) as canvas:
        first, second, third = canvas.subplots(1, 3)
        for axes, kind, title in ((first, "gaussian", "N(0, I) in N(0, 4 I)"), (second, "course", "Laps of a course")):
            for who, colour, style, label in LINES:
                there = [n for n in sizes if f"{who}_{kind}_{n}_ms" in numbers]
                if there:
                    times = [numbers[f"{who}_{kind}_{n}_ms"] for n in there]
                    axes.loglog(there, times, style, color=colour, ms=4, label=label)
            axes.set(title=title, xlabel="points of each team", ylabel="time of one pair [ms]")
            axes.legend()
        there = sorted(int(name) for name in names if name.isdigit())
        third.loglog(there, [numbers[f"divergence_{n}{ending}"] for n in there], "o-", color=GOOD, ms=4)
        third.set(title="Memory of the program", xlabel="points of each team", ylabel="bytes per point")
        third.set_ylim(bottom=10)


def _is_time_of_pair(key: str) -> bool:
    parts = key.split("_")
    return (
        parts[0] == "divergence"
        and len(parts) == 4
        and parts[1] in KINDS
        and parts[2].isdigit()
        and key.endswith("_ms")
    )
