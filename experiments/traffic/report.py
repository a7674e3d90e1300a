"""Traffic analysis of logs, as in Tables III to VII."""

from experiments.traffic import (
    compare,
    exposure,
    figures,
    offset,
    platoon,
    platoon_figures,
    platoon_tables,
    sources,
    tables,
    teams,
)
from experiments.traffic.sources import Material
from experiments.traffic.study import TrafficStudy
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run

DIVERGENCE = (
    "Divergences are nearest-neighbour estimates (Eq. 31, corrected), never clamped. Samples of a drive lie along a "
    "curve at regular spacing, so equal drivers come out below 0: what tells is the excess over the same laps dealt "
    "out anew. Intervals keep half of the blocks of all teams per draw; bias is not part of them."
)
PLATOONS = (
    "Gain: the deviation of speed of the last vehicle over that of the first; above 1 a disturbance grows. Intervals "
    "by blocks of time drawn together for all vehicles. A standing start dominates short recordings, hence the gain "
    "while all drive beside it. Gaps are distances between positions less the length of a vehicle, looked at while all "
    "drive."
)
OFFSET = (
    "Teams drive one lap alike; the frame of the first is offset. Once routes are apart by more than the distance r to "
    "the k-th own neighbour, the divergence is about 2 log(apart / r) whatever else the teams do: the sample spacing "
    "decides the number. On a closed lap an offset frame is apart by the cosine of its angle to the road, on average "
    "of logarithms by half of the offset. Table III states no spacing; its 0.1 to 0.9 among the other teams would need "
    "routes within a few spacings of one another."
)


def compared(params: TrafficStudy, material: Material, run: Run) -> list[report.Section]:
    """Teams on a course: tables for the whole course and by area, figures."""
    with progress.bar("teams") as tick:
        tick("samples", 0.05)
        stacked = teams.stack(params, material)
        found = compare.compare(params, stacked, tick)
    rows, areas = tables.team_table(stacked, found), tables.area_summary(stacked, found)
    run.table("teams", rows)
    run.table("pairs", tables.pair_table(stacked, found))
    run.table("areas", tables.area_table(stacked, found))
    run.summary(tables.summary(stacked, found))
    progress.show_table("teams", {name: rows[name] for name in tables.SHORT})
    matrices = tables.matrices(stacked, found)
    for caption, columns in matrices.items():
        progress.show_table(caption, columns)
    figures.draw_matrices(stacked, found, run.path("matrices.png"))
    figures.draw_routes(stacked, run.path("routes.png"))
    figures.draw_distributions(stacked, run.path("distributions.png"))
    figures.draw_null(stacked, found, run.path("null.png"))
    every = ", ".join(f"{count} {why}" for why, count in stacked.dropped.items() if count) or "none"
    whole: list = [
        report.Table(f"What each team drove (left out: {every}).", rows),
        *(report.Table(caption, columns) for caption, columns in matrices.items()),
        report.Picture("The same as colours.", run.path("matrices.png")),
        report.Picture("As driven, and the same laps dealt out otherwise.", run.path("null.png")),
        report.Picture("Where routes coincide, and mean offsets (curves grey).", run.path("routes.png")),
        report.Picture("Distributions.", run.path("distributions.png")),
    ]
    caption = "As in Tables IV to VII; areas.csv holds every pair. RMSE to the nearest samples of all other teams."
    return [
        report.Section("The whole course (Table III)", [DIVERGENCE], whole),
        report.Section("By area (Tables IV to VII)", [], [report.Table(caption, areas)]),
    ]


def judged(material: Material, run: Run) -> report.Section:
    """What the logs are like, which were left out, and how the frame was found."""
    rows = sources.quality_table(material)
    run.table("logs", rows)
    text = [f"Left out: {name}: {why}." for name, why in material.left_out.items()]
    if material.alignment:
        text.append(f"Frame aligned to the reference line: {material.alignment.verdict}.")
        run.summary({"alignment_rms_m": material.alignment.rms, "alignment_median_m": material.alignment.median})
    run.summary({"logs": len(material.judged), "logs_left_out": len(material.left_out)})
    for line in text:
        print(line)
    return report.Section("The logs", text, [report.Table("Each log as it was read.", rows)])


def exposed(params: TrafficStudy, material: Material, run: Run) -> list[report.Section]:
    """What the ego vehicles of rollouts exposed themselves to."""
    if material.rollouts is None:
        return []
    rows = exposure.exposure_table(material.rollouts, exposure.exposures(material.rollouts, params.safety))
    run.table("safety", rows)
    progress.show_table("safety, medians over starts", rows)
    return [report.Section("Safety", [], [report.Table("Medians over the starts.", rows)])]


def followed(params: TrafficStudy, material: Material, run: Run) -> list[report.Section]:
    """Platoons: gains, headways, flow."""
    with progress.bar("platoons"):
        found = platoon.platoons(material.logs, params.platoon, float(params.safety.ttc_threshold), params.seed)
    rows, vehicles = platoon_tables.table(found), platoon_tables.vehicle_table(found)
    run.table("platoons", rows)
    run.table("vehicles", vehicles)
    run.summary(platoon_tables.summary(found))
    progress.show_table("platoons", {name: rows[name] for name in platoon_tables.SHORT})
    platoon_figures.draw_summary(found, run.path("platoons.png"))
    platoon_figures.draw_speeds(found, run.path("speeds.png"))
    items = [
        report.Table("Each recording.", rows),
        report.Picture("Stability, time gaps and flow.", run.path("platoons.png")),
        report.Picture("Speeds, head dark to tail bright.", run.path("speeds.png")),
        report.Table("Each vehicle.", vehicles),
    ]
    return [report.Section("Platoons", [PLATOONS], items)]


def explained(params: TrafficStudy, run: Run) -> list[report.Section]:
    """The sweep over sample spacings that explains Table III."""
    with progress.bar("spacings"):
        found = offset.sweep(params.offset, params.seed)
    rows = offset.table(found)
    run.table("spacings", rows)
    run.summary(offset.summary(found))
    progress.show_table("sample spacing", rows)
    offset.draw(found, run.path("table3.png"))
    k = found.ks[0]
    items = [
        report.Picture("Divergence over sample spacing; matrices at both ends.", run.path("table3.png")),
        report.Table("Each spacing.", rows),
        report.Table(f"The matrix at 0.06 m [nats], k = {k}.", offset.matrix(found, 0.06, k)),
    ]
    return [report.Section("What the size of Table III says", [OFFSET], items)]


def write(params: TrafficStudy, run: Run) -> None:
    """Read or drive, compare, write tables, figures and one report."""
    if params.analysis == "offset":
        sections = explained(params, run)
    else:
        with progress.bar("logs") as tick:
            material = sources.gather(params, tick)
        sections = [judged(material, run)]
        if params.analysis == "platoons":
            sections += followed(params, material, run)
        else:
            sections += compared(params, material, run) + exposed(params, material, run)
    report.write_report(
        run.path("report.html"), "Traffic analysis", sections=sections, manifest=run.manifest("complete")
    )
