"""Libraries that only tuning needs: imported where one is used, so that nobody else has to have them."""

import importlib
from types import ModuleType

from urbanjax.types.errors import TuningError


def library(name: str) -> ModuleType:
    """The library of that name.

    Args: name, as it is imported. Raises TuningError where it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise TuningError(f'{name} is not installed: pip install "urbanjax[tuning]"') from error
