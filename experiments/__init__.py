"""One folder per question that a user asks, each with a command line: `python -m experiments.<question>`."""

import os

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA's alarm at long compilations, before it is loaded
