"""Closed loop in highway-env, beside highway-env's own IDM vehicle."""

from experiments.highway import figures
from experiments.highway import study as highway
from experiments.highway.study import HighwayStudy
from urbanjax.io.bridges.highway.environment import FREQUENCY
from urbanjax.io.figures import animation
from urbanjax.io.runs import progress, report
from urbanjax.io.runs.directory import Run

LEFT_OUT = ("drives", "collisions [%]", "median TTC [s]")  # of the printed table, for want of room
CAPTION = (
    "Mean speed is distance over nominal duration, crashes included; time to collision (TTC) is that of the boxes at "
    "constant velocity, to any vehicle: the least of all drives, and the median over drives of the least of each. "
    "Arrived: on the last road of the route that an environment with a goal gives its ego. "
    "Brackets are 95 % intervals: bootstrap of means, Wilson of rates. "
    "Steps are medians of warm ones. The IDM vehicle keeps its lane on the racetrack and changes lanes elsewhere."
)


def section(params: HighwayStudy, run: Run) -> report.Section:
    """Drive, write tables, figure and GIFs into the run; returns what the report shows of it."""
    episodes, items = [], []
    with progress.bar("highway-env") as tick:
        for episode in highway.drives(params, tick):
            episodes.append(episode)
            run.table("highway", highway.scores(episodes, params.duration))
            if episode.frames:
                path = run.path(f"{episode.env}.gif")
                animation.write_gif(path, episode.frames, rate=2.5 * FREQUENCY / params.gif_every)
                items.append(report.Picture(f"{episode.env}, seed {episode.seed}, 2.5 times as fast", path))
    rows = highway.scores(episodes, params.duration)
    run.table("highway_tracks", highway.tracks(episodes))
    figures.draw(rows, run.path("highway.png"))
    run.summary(highway.summary(rows))
    table = report.Table(CAPTION, highway.table(rows))
    shown = {name: column for name, column in table.columns.items() if name not in LEFT_OUT}
    progress.show_table(f"highway-env, {params.seeds} drives each", shown)
    figure = report.Picture("Mean speed of every drive; a cross is a collision.", run.path("highway.png"))
    return report.Section("Driving in highway-env", [], [table, figure, *items])


def write(params: HighwayStudy, run: Run) -> None:
    """Run the study and write its report."""
    shown = section(params, run)
    report.write_report(
        run.path("report.html"), "urbanjax in highway-env", sections=[shown], manifest=run.manifest("complete")
    )
