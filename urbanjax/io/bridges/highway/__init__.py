"""highway-env: a simulator that we did not write, as a place to drive in and as a renderer."""

import os
import tempfile

os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.gettempdir())  # highway-env's renderer complains without one
