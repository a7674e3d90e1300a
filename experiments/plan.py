"""One plan of one moment, drawn and explained: `python -m experiments.plan`."""

from urbanjax.io import cli, progress, report
from urbanjax.io.report import cell
from urbanjax.io.runs import Run
from urbanjax.io.studies import planned
from urbanjax.io.studies.planned import PlanStudy
from urbanjax.planning.explain import explain


@cli.experiment("plan", PlanStudy)
def main(params: PlanStudy, run: Run) -> None:
    """Drive up to the moment, plan, draw, and print why this plan."""
    with progress.bar("plan") as tick:
        found = planned.moment(params, tick)
    columns = explain(found.hard)
    run.table("explanation", {name: [cell(value) for value in column] for name, column in columns.items()})
    progress.show_table("why this plan", columns)
    planned.draw(found, run.path("plan.png"))
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
        run.path("report.html"), "One plan", [report.Section("Why this plan", [], items)], run.manifest("complete")
    )


if __name__ == "__main__":
    main()
