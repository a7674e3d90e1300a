"""What the house promises of its rooms, files and signatures."""

import ast
import re
from collections import Counter
from pathlib import Path

from tests.conftest import REPOSITORY

MOST_ARGUMENTS, MOST_LINES, LARGEST_ROOM = 7, 300, 0.25
PROTOCOLS = ("init", "step", "rollout")  # (params, course or lanes, state, ...): their order is the protocol
# Operators of arrays, whose order is that of the formula; everything else takes arguments past the second by keyword.
OPERATORS: set[str] = {
    "urbanjax.planning.basis.hat",
    "urbanjax.planning.basis.interpolate",
    "urbanjax.planning.basis.smooth",
    "urbanjax.planning.shape.from_plane",
    "urbanjax.planning.shape.to_plane",
    "urbanjax.numerics.lean.where",
    "urbanjax.numerics.lean.clip",
    "urbanjax.numerics.soft.above",
}


def files(*roots: str) -> list[Path]:
    return sorted(path for root in roots for path in (REPOSITORY / root).rglob("*.py"))


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")


def public_functions() -> list[tuple[str, ast.FunctionDef]]:
    return [
        (f"{module_of(path)}.{node.name}", node)
        for path in files("urbanjax")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    ]


FUNCTIONS = public_functions()


def positional(node: ast.FunctionDef) -> list[str]:
    return [argument.arg for argument in (*node.args.posonlyargs, *node.args.args)]


def test_arguments_past_the_second_are_keywords():
    long = {name for name, node in FUNCTIONS if len(positional(node)) > 2 and node.name not in PROTOCOLS}
    assert long == OPERATORS


def test_no_public_function_has_many_arguments():
    counts = {name: len(positional(node)) + len(node.args.kwonlyargs) for name, node in FUNCTIONS}
    assert {name: n for name, n in counts.items() if n > MOST_ARGUMENTS} == {}


def test_every_argument_is_explained():
    missing = []
    for name, node in FUNCTIONS:
        explained = re.search(r"Args:(.*)", ast.get_docstring(node) or "", re.DOTALL)
        text = explained.group(1) if explained else ""
        arguments = [*positional(node), *(argument.arg for argument in node.args.kwonlyargs)]
        missing += [f"{name}: {a}" for a in arguments if a != "params" and not re.search(rf"\b{a}\b", text)]
    assert missing == []


def test_a_class_name_stands_once():
    names = Counter(
        node.name
        for path in files("urbanjax", "experiments")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in names.items() if count > 1] == []


def test_files_stay_short_and_rooms_balanced():
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in files("urbanjax", "experiments")}
    assert {str(path): n for path, n in lines.items() if n > MOST_LINES} == {}
    rooms: Counter[str] = Counter()
    for path, n in lines.items():
        root, room, *_ = path.relative_to(REPOSITORY).parts
        rooms[root if root == "experiments" else room] += n
    shares = {room: n / sum(rooms.values()) for room, n in rooms.items() if room != "experiments"}
    assert {room: share for room, share in shares.items() if share > LARGEST_ROOM} == {}


def test_a_step_fits_on_one_screen():
    (step,) = (node for name, node in FUNCTIONS if name == "urbanjax.stack.step")
    assert step.end_lineno - step.lineno + 1 <= 45
    assert not [node for node in ast.walk(step) if isinstance(node, ast.BinOp) and not isinstance(node.op, ast.BitOr)]


def test_no_target_hides_in_a_config():
    """But in the plugins that Hydra itself makes, which name their own classes and nothing else."""
    presets = sorted((REPOSITORY / "configs").rglob("*.yaml"))
    assert presets
    assert [str(path) for path in presets if "_target_" in path.read_text(encoding="utf-8")] == []
    named = {}
    for path in files("urbanjax", "experiments", "hydra_plugins"):
        text = path.read_text(encoding="utf-8")
        if re.search(r"\b_target_\b", text):
            named[path.relative_to(REPOSITORY).as_posix()] = re.findall(r"\b_target_: str = \"([\w.]+)\"", text)
    assert named.pop("urbanjax/types/config.py") == []  # where it is refused
    assert named == {
        "hydra_plugins/urbanjax_sweeps/design_sweeper.py": [
            "hydra_plugins.urbanjax_sweeps.design_sweeper.DesignSweeper"
        ],
        "hydra_plugins/urbanjax_sweeps/vmap_launcher.py": ["hydra_plugins.urbanjax_sweeps.vmap_launcher.VmapLauncher"],
    }
