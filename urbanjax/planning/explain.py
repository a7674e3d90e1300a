"""Why a plan was chosen, for people (host side)."""

from typing import Any

import numpy as np

from urbanjax.planning.macro import MACRO_TERMS
from urbanjax.planning.micro import MICRO_TERMS, REASONS
from urbanjax.planning.plan import Plan

NONE = "-"
FEASIBLE = 0.5  # degree from which a plan counts as feasible


def explain(plan: Plan) -> dict[str, list[Any]]:
    """A table by column: every quantity of the chosen candidate and of the runner-up, and of the macro plan.

    End states, every cost term, the sum, the clearance; then for each limit the margin's verdict, with the number of
    candidates that break it. Args: plan, one (not a batch), on the host or the device.
    """
    micro, end = plan.micro, plan.fan.end
    pair = [int(micro.chosen), int(micro.runner_up)]
    terms, cost, reasons = (np.asarray(x, float) for x in (micro.terms, micro.cost, micro.reasons))
    macro_terms: dict[str, float] = dict(zip(MACRO_TERMS, np.asarray(plan.macro.terms, float), strict=True))
    rows: list[tuple[Any, ...]] = [("candidate", *pair, NONE, len(cost))]
    for name, values in (
        ("end offset beside the macro plan [m]", end.beside),
        ("end speed [m/s]", end.speed),
        ("end acceleration [m/s^2]", end.acceleration),
        ("duration [s]", end.duration),
    ):
        rows.append((name, *(float(values[k]) for k in pair), NONE, NONE))
    for i, name in enumerate(MICRO_TERMS):
        rows.append((name, *(terms[k, i] for k in pair), macro_terms.pop(name, NONE), NONE))
    rows += [(name, NONE, NONE, value, NONE) for name, value in macro_terms.items()]
    rows.append(("cost", *(cost[k] for k in pair), float(plan.macro.value), NONE))
    rows.append(("clearance [m]", *(float(micro.margin[k]) for k in pair), float(plan.macro.clearance), NONE))
    for i, name in enumerate(REASONS):
        verdicts = ("rejected" if reasons[k, i] else "kept" for k in pair)
        rows.append((f"limit: {name}", *verdicts, NONE, int(reasons[:, i].sum())))
    any_broken = np.max(reasons, axis=1) > 0
    feasible = "kept" if float(plan.macro.feasible) > FEASIBLE else "rejected"
    rows.append(
        ("all limits", *("rejected" if any_broken[k] else "kept" for k in pair), feasible, int(any_broken.sum()))
    )
    columns = ("quantity", "chosen", "runner-up", "macro plan", "candidates rejected")
    return {name: [row[i] for row in rows] for i, name in enumerate(columns)}
