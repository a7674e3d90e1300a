import subprocess
import sys

PROGRAM = """
import importlib, pathlib, sys
import urbanjax
from jax._src import xla_bridge

top = pathlib.Path(urbanjax.__file__).parent
for path in top.rglob("*.py"):
    parts = path.relative_to(top.parent).with_suffix("").parts
    if parts[1] != "io":
        importlib.import_module(".".join(parts))
heavy = {"hydra", "omegaconf", "matplotlib", "gymnasium", "highway_env", "pyarrow", "jinja2"}
heavy |= {"cmaes", "optax", "optuna"}
print(*sorted(heavy & set(sys.modules)), *(["a device"] if xla_bridge.backends_are_initialized() else []))
"""


def test_importing_everything_but_io_touches_no_device_and_no_heavy_library():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
