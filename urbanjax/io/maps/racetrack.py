"""Racetracks from CSV: centre line and widths, as in the TUM racetrack database, and graph-ltpl's trajectory files."""

import math
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d, minimum_filter1d

from urbanjax.io.files import content
from urbanjax.io.maps import lanes
from urbanjax.io.maps.lanes import MapLane, RoadMap
from urbanjax.io.maps.xml import FARTHEST, LARGEST_FILE, MapError
from urbanjax.roadmap.graph import RoadType
from urbanjax.types import host_record

COLUMNS = ("x", "y", "right", "left")
SPELLINGS = {
    "x": ("x_m", "x_ref_m", "x"),
    "y": ("y_m", "y_ref_m", "y"),
    "right": ("w_tr_right_m", "width_right_m", "w_right"),
    "left": ("w_tr_left_m", "width_left_m", "w_left"),
}
LONGEST_STEP = 500.0  # m, between consecutive points
LONGEST = 50_000.0  # m, of a track
MOST_ROWS = 200_000
CLOSING = 20.0  # m, from the last point to the first, up to which a track is a circuit
TIGHTEST = 2.0  # m, radius of the centre line
WIDE = 30.0  # m to one side of the reference line, beyond which no track reaches where
FOLDED = 2.0  # times the radius of a bend would be exceeded on its inside
INNER = 0.9  # of the radius: the border on the inside of a bend stays so near
NARROWEST = 1.0  # m, width of a track
SAME = 1e-3  # m, between points that are one
FEWEST = 4  # points of a track
STEPS = 3  # times the median step, as CLOSING
SLOW = 0.05  # m of the curve per m of the line through the points: less, and it turns on the spot
STEADY = 10  # times: a change of bend from point to point counts as that much bend, where the track is cut
GRID = 1.0  # m, between points of the borders
SMOOTHING = 5.0  # m to either side, over which the widths are smoothed
SECTION = 80.0  # m, length of a link
SPEED = 40.0  # m/s: a racetrack has no limit of its own


@host_record
class Racetrack:
    """A racetrack as a file states it; n different points in driving direction."""

    position: np.ndarray  # [n, 2] m, reference line
    right: np.ndarray  # [n] m, to the right border
    left: np.ndarray  # [n] m
    line: np.ndarray  # [n] int, line of the file
    closed: bool


def read(path: str | Path) -> RoadMap:
    """The road graph of a racetrack: a chain of links with its borders; on a circuit the last leads to the first.

    The lane's middle is that of the track, smoothed; its borders lie within the track's, and on the inside of a bend at
    most 0.9 of the radius from its reference line, where normals would cross; beyond twice it (and 30 m) it is refused.
    Args: path of the file. Raises MapError, with line and column.
    """
    return road_map(Path(path), parse(Path(path)))


def road_map(path: Path, track: Racetrack) -> RoadMap:
    """The road graph of a track (see `read`).

    Args: path, named in errors; track, as parsed.
    """
    left, right = borders(path, track)
    breaks = _breaks(0.5 * (left + right))
    count = len(breaks) - 1
    names = [f"section {k}" for k in range(count)]
    following = [*names[1:], *(names[:1] if track.closed else [])]
    parts = [
        MapLane(
            id=names[k],
            left=left[breaks[k] : breaks[k + 1] + 1],
            right=right[breaks[k] : breaks[k + 1] + 1],
            successors=tuple(following[k : k + 1]),
            speed_limit=SPEED,
            road_type=RoadType.URBAN,
            paired=True,
        )
        for k in range(count)
    ]
    return lanes.assemble(path, "racetrack", lanes=parts)


def parse(path: Path) -> Racetrack:
    """The rows of the file, checked. Comma or semicolon separated; comments begin with # and may name the columns.

    Args: path of the file.
    """
    data = content(path)
    if len(data) > LARGEST_FILE:
        raise MapError(f"{path}: {len(data)} bytes are more than the {LARGEST_FILE} that a map may have")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise MapError(f"{path}: line {line}: byte {data[error.start]:#04x} is no text: save it as UTF-8") from error
    if text.lstrip().startswith("<"):
        raise MapError(f"{path}: line 1: is XML, and a racetrack is a CSV of x, y and the widths to right and left")
    rows = [(k, row.strip()) for k, row in enumerate(text.splitlines(), 1)]
    data_rows = [(k, row) for k, row in rows if row and not row.startswith("#")]
    if len(data_rows) > MOST_ROWS:
        raise MapError(f"{path}: line {data_rows[MOST_ROWS][0]}: more than {MOST_ROWS} rows")
    if len(data_rows) < FEWEST:
        raise MapError(
            f"{path}: line {rows[-1][0] if rows else 1}: {len(data_rows)} points, a track has {FEWEST} or more"
        )
    separator = ";" if ";" in data_rows[0][1] else ","
    place, size = _columns(path, [row for _, row in rows if row.startswith("#")], data_rows[0], separator)
    values = np.array([_numbers(path, k, row.split(separator), place, size) for k, row in data_rows])
    line = np.array([k for k, _ in data_rows])
    step = np.hypot(*np.diff(values[:, :2], axis=0).T)
    if step.max() > LONGEST_STEP:
        k = int(np.argmax(step > LONGEST_STEP)) + 1
        raise MapError(
            f"{path}: line {line[k]}, columns x and y: {step[k - 1]:.0f} m from the point before, "
            f"more than {LONGEST_STEP:.0f}"
        )
    keep = np.concatenate([[True], step > SAME])
    values, line = values[keep], line[keep]
    gap = float(np.hypot(*(values[0] - values[-1])[:2]))
    again = int(gap < SAME and len(values) > 1)  # some files end with the point that they began with
    values, line = values[: len(values) - again], line[: len(line) - again]
    if len(values) < FEWEST:
        raise MapError(f"{path}: line {line[-1]}: {len(values)} different points, a track has {FEWEST} or more")
    closed = gap < max(CLOSING, STEPS * float(np.median(step)))
    return Racetrack(values[:, :2], values[:, 2], values[:, 3], line, closed)


def _columns(path: Path, comments: list[str], first: tuple[int, str], separator: str) -> tuple[dict[str, int], int]:
    """Index of each of COLUMNS, by the names in the comments or else the first four, and the number of columns."""
    size = len(first[1].split(separator))
    for comment in reversed(comments):
        names = [name.strip().lower() for name in comment.lstrip("#").split(separator)]
        found = {c: next((names.index(n) for n in SPELLINGS[c] if n in names), None) for c in COLUMNS}
        if found["x"] is None or found["y"] is None:
            continue
        missing = [c for c in COLUMNS if found[c] is None]
        if missing:
            raise MapError(
                f"{path}: line {first[0]}, column {missing[0]!r}: the header names none of "
                f"{', '.join(SPELLINGS[missing[0]])}"
            )
        if len(names) == size:
            return {c: int(k) for c, k in found.items() if k is not None}, size
    if size < len(COLUMNS):
        raise MapError(
            f"{path}: line {first[0]}, column {size + 1}: is missing; a track has x, y and its widths to the right "
            "and left (a race line is none)"
        )
    return dict(zip(COLUMNS, range(4), strict=True)), size


def _numbers(path: Path, line: int, cells: list[str], place: dict[str, int], size: int) -> list[float]:
    """Values of COLUMNS in one row."""
    if len(cells) != size:
        column = min(len(cells), size) + 1
        raise MapError(f"{path}: line {line}, column {column}: has {len(cells)} columns, the first row has {size}")
    out = []
    for column, k in place.items():
        where = f"{path}: line {line}, column {k + 1} ({column})"
        try:
            value = float(cells[k])
        except ValueError as error:
            raise MapError(f"{where}: {cells[k].strip()[:40]!r} is no number") from error
        if not math.isfinite(value) or abs(value) > FARTHEST:
            raise MapError(f"{where}: {value} is not within +-{FARTHEST:g} m")
        if column in ("right", "left") and not -LONGEST_STEP <= value <= LONGEST_STEP:
            raise MapError(f"{where}: a width of {value} m is not within +-{LONGEST_STEP:.0f}")
        out.append(value)
    if out[2] + out[3] < NARROWEST:
        raise MapError(
            f"{path}: line {line}, columns {place['right'] + 1} and {place['left'] + 1} (right and left): "
            f"the track is {out[2] + out[3]:g} m wide, less than {NARROWEST:g}"
        )
    return out


def borders(path: Path, track: Racetrack) -> tuple[np.ndarray, np.ndarray]:
    """Left and right border [m, 2], at the same places about 1 m apart; on a circuit the last is the first.

    Args: path, named in errors; track, as parsed. Raises MapError where the line is longer than a track can be or turns
    on the spot.
    """
    points = np.concatenate([track.position, track.position[:1]]) if track.closed else track.position
    station = lanes.stations(points)
    if station[-1] > LONGEST:
        raise MapError(f"{path}: line {track.line[-1]}: the track is {station[-1]:.0f} m long, more than {LONGEST:.0f}")
    curve = CubicSpline(station, points, bc_type="periodic" if track.closed else "natural")
    grid = np.linspace(0.0, station[-1], max(math.ceil(station[-1] / GRID), 8) + 1)
    position, tangent, bend = curve(grid), curve(grid, 1), curve(grid, 2)
    speed = np.hypot(*tangent.T)
    tight = (speed < SLOW) | (np.abs(tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]) > speed**3 / TIGHTEST)
    if tight.any():
        k = int(np.searchsorted(station, grid[np.argmax(tight)]).clip(0, len(track.line) - 1))
        raise MapError(
            f"{path}: line {track.line[k]}, columns x and y: the line turns on less than {TIGHTEST:g} m of radius there"
        )
    curvature = (tangent[:, 0] * bend[:, 1] - tangent[:, 1] * bend[:, 0]) / speed**3
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], -1) / speed[:, None]
    sides = []
    for width, sign in ((track.left, 1.0), (track.right, -1.0)):
        given = np.interp(grid, station, np.append(width, width[0]) if track.closed else width)
        folded = (given > WIDE) & (given * sign * curvature > FOLDED)
        if folded.any():
            k = int(np.argmax(folded))
            row = int(np.searchsorted(station, grid[k]).clip(0, len(track.line) - 1))
            raise MapError(
                f"{path}: line {track.line[row]}, column {'left' if sign > 0 else 'right'}: a width of {given[k]:.0f} "
                f"m on the inside of a bend of {1 / abs(curvature[k]):.0f} m radius: correct it, or its unit"
            )
        sides.append(np.minimum(given, INNER / np.maximum(sign * curvature, 1e-9)))
    middle, half = _within(sides[0], sides[1], track.closed)
    if half.min() < NARROWEST / 2:
        k = int(np.searchsorted(station, grid[half.argmin()]).clip(0, len(track.line) - 1))
        raise MapError(
            f"{path}: line {track.line[k]}, columns right and left: only {2 * half.min():.2f} m of width "
            f"are left there, less than {NARROWEST:g}"
        )
    left, right = (position + (middle + sign * half)[:, None] * normal for sign in (1.0, -1.0))
    if track.closed:
        left[-1], right[-1] = left[0], right[0]
    return left, right


def _breaks(middle: np.ndarray) -> np.ndarray:
    """Indices at which the track is cut into links: about SECTION apart, where it bends least and most evenly.

    There the headings of two links, each told by its own points, agree best.
    """
    heading = np.unwrap(np.arctan2(*np.gradient(middle, axis=0).T[::-1]))
    bend = np.gradient(heading)
    unrest = np.abs(bend) + STEADY * np.abs(np.gradient(bend))
    count = max(round(len(middle) * GRID / SECTION), 3)
    even = np.linspace(0, len(middle) - 1, count + 1).astype(int)
    reach = max((even[1] - even[0]) // 4, 1)
    inner = [k - reach + int(np.argmin(unrest[k - reach : k + reach + 1])) for k in even[1:-1]]
    return np.array([0, *inner, len(middle) - 1])


def _within(left: np.ndarray, right: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half width of a lane with smooth borders that lies within the given distances to both sides.

    The mean of a running minimum over the same reach is nowhere above the values themselves.
    """
    reach = round(SMOOTHING / GRID)
    kernel = 1 + np.cos(np.pi * np.arange(-reach, reach + 1) / (reach + 1))
    kernel, mode = kernel / kernel.sum(), "wrap" if closed else "nearest"
    cut = slice(0, -1) if closed else slice(None)  # the last point of a circuit is its first
    left, right = left[cut], right[cut]
    middle = convolve1d((left - right) / 2, kernel, mode=mode)
    room = np.minimum(left - middle, right + middle)
    half = convolve1d(minimum_filter1d(room, 2 * reach + 1, mode=mode), kernel, mode=mode)
    return (np.append(middle, middle[0]), np.append(half, half[0])) if closed else (middle, half)
