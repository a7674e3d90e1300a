"""How the programs of this project are best compiled."""

import functools

import jax

# Kernels from the elemental emitters instead of the fusion emitters. A step is some hundred small kernels: they compile
# in about two thirds of the time, and so does a gradient, and they run no slower.
_WISHES: dict[str, bool | int | str] = {"xla_cpu_use_fusion_emitters": False}


def compiler_options() -> dict[str, bool | int | str]:
    """Options for `jax.jit(function, compiler_options=...)` of a step, a rollout or its gradient, on the CPU.

    Results are equal to rounding. Not for few large kernels (the simulator alone, registration, sampled candidates):
    the compiler's own choice runs those faster. An option unknown to the installed XLA, and on another device all of
    them, are left out.
    """
    return dict(_known()) if jax.default_backend() == "cpu" else {}


@functools.cache
def _known() -> dict[str, bool | int | str]:
    return {name: value for name, value in _WISHES.items() if _accepted(name, value)}


def _accepted(name: str, value: bool | int | str) -> bool:
    try:
        jax.jit(lambda x: x, compiler_options={name: value}).lower(0.0).compile()
    except (RuntimeError, ValueError):  # what jax raises for an unknown option
        return False
    return True
