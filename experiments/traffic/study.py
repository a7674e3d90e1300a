"""What the traffic analysis is asked: whose logs, on which course, compared how."""

from typing import ClassVar

from experiments.common.overtaking import OvertakeStudy
from urbanjax.io.logs import LogFormat
from urbanjax.io.logs.align import LogAlignParams
from urbanjax.io.logs.quality import QualityParams
from urbanjax.traffic.course.laps import LapParams
from urbanjax.traffic.course.sections import SectionParams
from urbanjax.traffic.divergence.estimate import DivergenceParams
from urbanjax.traffic.resampling import ResamplingParams
from urbanjax.traffic.safety.measure import SafetyParams
from urbanjax.types import SEED, Unread, field, pytree, static

ANALYSES = ("teams", "platoons", "offset")
BLOCKS = ("stations", "runs")


@pytree
class CourseStudy:
    """The reference line that logs are measured along."""

    # A CSV of x, y (m) and widths, here or below the data folder; without one the first drive is the line.
    line: str = static(default="", metadata={"path": True})
    closed: bool = static(default=True)
    align: bool = static(default=False)  # bring the frame that all logs share to that of the line
    frame: LogAlignParams = LogAlignParams()
    laps: LapParams = LapParams(tolerance=60.0)
    areas: tuple[str, ...] = static(default=())  # name:from:to [m]; none: straights and curves of the line
    sections: SectionParams = SectionParams()


@pytree
class TeamStudy:
    """How the drives of teams are compared."""

    spacing: float = field(default=2.0, metadata={"range": (0.0, 1e3)})  # m between samples of a drive; 0: as logged
    raw_only: bool = static(default=False)  # leave interpolated samples out before
    longest_gap: float = field(default=2.0, metadata={"range": (1e-3, 1e6)})  # s between samples that is bridged
    divergence: DivergenceParams = DivergenceParams(ks=(1, 5, 10), ties="dedupe")
    bin_length: float = field(default=50.0, metadata={"range": (0.1, 1e5)})  # m, of P(x | z)
    resampling: ResamplingParams = ResamplingParams()
    blocks: str = static(default="stations", metadata={"choices": BLOCKS})  # what intervals keep or leave together
    deals: int = static(default=50, metadata={"range": (2, 100_000)})  # of laps, at most
    paired: bool = static(default=False)  # run k of all teams belongs together (rollouts: always), and is only swapped


@pytree
class PlatoonStudy:
    """How the vehicles of a platoon are compared."""

    period: float = field(default=0.1, metadata={"range": (1e-3, 1e3)})  # s between samples
    moving: float = field(default=2.0, metadata={"range": (0.0, 1e3)})  # m/s, that all drive at least
    length: float = field(default=4.5, metadata={"range": (0.1, 100.0)})  # m of each vehicle, which logs do not hold
    segment: int = static(default=256, metadata={"range": (8, 1_000_000)})  # samples of Welch's segments
    block: float = field(default=20.0, metadata={"range": (0.1, 1e6)})  # s of the bootstrap's blocks
    cell: tuple[float, float] = (20.0, 100.0)  # s and m, of the fundamental diagram
    resampling: ResamplingParams = ResamplingParams(draws=300)


@pytree
class OffsetStudy:
    """Teams that drive alike on one lap, one of them in a frame of its own, sampled ever more densely."""

    teams: int = static(default=5, metadata={"range": (3, 20)})
    offset: float = field(default=2.0, metadata={"range": (1e-3, 1e3)})  # m, of the frame of the first team
    apart: float = field(default=0.02, metadata={"range": (1e-4, 10.0)})  # m, standard deviation of the others
    length: float = field(default=200.0, metadata={"range": (10.0, 1e4)})  # m of the lap
    spacings: tuple[float, ...] = field(  # m
        default=(1.0, 0.3, 0.1, 0.06, 0.03, 0.01, 0.003, 0.001), metadata={"range": (1e-4, 100.0)}
    )
    ks: tuple[int, ...] = static(default=(1, 5))


# What only logs in files have, what only teams are compared by, and what concerns logs at all.
FILES = ("format", "course.line", "course.closed")
COMPARED = ("spacing", "longest_gap", "divergence", "bin_length", "resampling", "blocks", "deals", "paired")
TEAMS = ("course.laps", "course.areas", "course.sections", *(f"teams.{name}" for name in COMPARED))
LOGS = tuple(f"{name}*" for name in ("files", "format", "quality", "course", "teams", "rollouts", "safety"))


@pytree
class TrafficStudy:
    """Teams on a course, platoons of a road, or what an offset frame does; from files or from rollouts of the stack."""

    UNREAD: ClassVar[dict[str, Unread | None]] = {
        "rollouts.gif_every": Unread("no pictures are made of rollouts"),
        "rollouts": Unread("the logs are those of 'files'", lambda p: bool(p.files)),
        **dict.fromkeys(FILES, Unread("the logs are rollouts, see 'files'", lambda p: not p.files)),
        "safety": Unread("only rollouts show all vehicles, see 'files'", lambda p: p.files and p.analysis == "teams"),
        **dict.fromkeys(TEAMS, Unread("no teams are compared, see 'analysis'", lambda p: p.analysis != "teams")),
        "platoon": Unread("no platoons are looked at, see 'analysis'", lambda p: p.analysis != "platoons"),
        "offset": Unread("no frame is set off, see 'analysis'", lambda p: p.analysis != "offset"),
        # Patterns of their own, beside those above.
        **dict.fromkeys(LOGS, Unread("no logs are read, see 'analysis'", lambda p: p.analysis == "offset")),
    }

    analysis: str = static(default="teams", metadata={"choices": ANALYSES})
    files: tuple[str, ...] = static(default=())  # paths or patterns, also below the data folder; none: rollouts
    format: LogFormat = LogFormat()
    quality: QualityParams = QualityParams()
    course: CourseStudy = CourseStudy()
    teams: TeamStudy = TeamStudy()
    platoon: PlatoonStudy = PlatoonStudy()
    safety: SafetyParams = SafetyParams()
    rollouts: OvertakeStudy = OvertakeStudy(starts=12, gif_every=0)
    offset: OffsetStudy = OffsetStudy()
    seed: int = static(default=0, metadata=SEED)
