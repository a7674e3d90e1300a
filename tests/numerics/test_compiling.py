import jax
import jax.numpy as jnp

from urbanjax import compiler_options
from urbanjax.numerics import compiling


def test_the_options_are_taken_and_leave_the_answer():
    x = jnp.linspace(0.0, 1.0, 7)
    plain, tuned = jax.jit(jnp.cos)(x), jax.jit(jnp.cos, compiler_options=compiler_options())(x)
    assert jnp.allclose(plain, tuned, atol=1e-6)


def test_options_that_the_installed_compiler_does_not_know_are_left_out(monkeypatch):
    monkeypatch.setattr(compiling, "_WISHES", {"xla_no_such_option": True, "xla_backend_optimization_level": 1})
    compiling._known.cache_clear()
    try:
        assert compiler_options() == {"xla_backend_optimization_level": 1}
    finally:
        compiling._known.cache_clear()


def test_options_of_the_cpu_stay_there(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert compiler_options() == {}


def test_a_caller_may_change_what_it_got():
    compiler_options()["xla_no_such_option"] = True
    assert "xla_no_such_option" not in compiler_options()
