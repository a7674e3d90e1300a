import subprocess
import sys

INNER = "types numerics geometry vehicle roadmap localization planning control behavior sim stack".split()
OUTER = "hydra omegaconf matplotlib gymnasium highway_env pyarrow jinja2".split()


def test_importing_the_stack_touches_no_device_and_no_heavy_library():
    program = "\n".join(
        [
            "import sys",
            "import urbanjax",
            *(f"import urbanjax.{room}" for room in INNER),
            f"print(*(name for name in {OUTER} if name in sys.modules))",
            "from jax._src import xla_bridge",
            "print('backend' if xla_bridge.backends_are_initialized() else '')",
        ]
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
