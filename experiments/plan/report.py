"""One plan of one moment, drawn and explained."""

from experiments.plan import figures
from experiments.plan import study as planned
from experiments.plan.study import PlanStudy
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run
from urbanjax.io.runs.report import cell
from urbanjax.planning.explain import explain


def write(params: PlanStudy, run: Run) -> None:
    """Drive up to the moment, plan, draw, and print why this plan."""
    with progress.bar("plan") as tick:
        found = planned.moment(params, tick)
    columns = explain(found.hard)
    run.table("explanation", {name: [cell(value) for value in column] for name, column in columns.items()})
    progress.show_table("why this plan", columns)
    figures.draw(found, run.path("plan.png"))
    micro = found.hard.micro
    run.summary(
        {
            "candidates": len(micro.cost),
            "candidates_rejected": int(micro.reasons.any(axis=1).sum()),
            "cost_m": float(micro.cost[micro.chosen]),
            "runner_up_cost_m": float(micro.cost[micro.runner_up]),
            "clearance_m": float(micro.clearance),
            "macro_cost_m": float(found.hard.macro.value),
        }
    )
    caption = (
        "Costs in metres of way. A limit is broken by so many candidates in all; the macro plan has terms of its own."
    )
    items = [
        report.Picture("The fan and the lattice", run.path("plan.png")),
        report.Table(caption, columns),
    ]
    report.write_report(
        run.path("report.html"),
        "One plan",
        sections=[report.Section("Why this plan", [], items)],
        manifest=run.manifest("complete"),
    )
