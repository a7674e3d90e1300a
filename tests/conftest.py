"""Strict mode for the whole suite: checked shapes, no silent rank promotion; warnings are errors (pyproject.toml)."""

import gc
import os
from pathlib import Path

# Tests marked gpu run with JAX_PLATFORMS=cuda,cpu; everything else is a claim about the CPU.
os.environ.setdefault("JAX_PLATFORMS", "cpu")

# Programs started by a test neither use nor fill the user's folder of compiled ones (tests/experiments/commands.py has
# one of its own).
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ.setdefault("JAX_ENABLE_COMPILATION_CACHE", "false")

# Most programs here are compiled once and run a few times, so compiling is what costs: it takes a quarter of the time
# without optimisation, and a quarter less without looking at loops. What XLA_FLAGS already says stays.
# `laws/test_batch.py` compares with optimised programs.
LOOPS = "simplify-while-loops,while-loop-invariant-code-motion,while-loop-constant-sinking"
QUICK = {
    "xla_backend_optimization_level": "0",
    "xla_cpu_use_fusion_emitters": "false",
    "xla_cpu_parallel_codegen_split_count": "1",
    "xla_disable_hlo_passes": LOOPS,
}
if os.environ["JAX_PLATFORMS"] == "cpu":
    given = os.environ.get("XLA_FLAGS", "")
    added = [f"--{name}={value}" for name, value in QUICK.items() if name not in given]
    os.environ["XLA_FLAGS"] = " ".join([given, *added]).strip()

from jaxtyping import install_import_hook  # noqa: E402

install_import_hook(["urbanjax", "experiments"], "beartype.beartype")

import jax  # noqa: E402
import pytest  # noqa: E402

jax.config.update("jax_numpy_rank_promotion", "raise")
# Tracing allocates much and leaves few cycles: a fifth of its time went into looking for them.
gc.set_threshold(50_000, 20, 100)

REPOSITORY = Path(__file__).resolve().parent.parent
# Begun first, so that all workers end together.
LONG = (
    "grads",
    "laws",
    "test_docs.py",
    "io",
    "planning",
    "registration",
    "localization",
    "sim",
    "traffic",
    "roadmap",
    "real_data",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="also run the tests marked slow")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    no_slow = not config.getoption("--slow") and "slow" not in config.getoption("markexpr")
    left_out = [item for item in items if no_slow and item.get_closest_marker("slow")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("slow")]
    items.sort(key=lambda item: next((i for i, part in enumerate(LONG) if part in item.path.parts), len(LONG)))
    if any(item.get_closest_marker("gpu") for item in items) and jax.default_backend() == "cpu":
        for item in items:
            if item.get_closest_marker("gpu"):
                item.add_marker(pytest.mark.skip(reason="no accelerator (run with JAX_PLATFORMS=cuda,cpu)"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real data: $URBANJAX_DATA, or shared/data beside the repository."""
    path = Path(os.environ.get("URBANJAX_DATA", REPOSITORY.parent / "shared" / "data"))
    if not path.is_dir():
        pytest.skip(f"no data at {path} (set URBANJAX_DATA)")
    return path


@pytest.fixture
def x64():
    """Double precision for one test."""
    with jax.enable_x64(True):
        yield
