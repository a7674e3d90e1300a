"""One thin entry point per question that a user asks."""

import os

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA's alarm at long compilations, before it is loaded
