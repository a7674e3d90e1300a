"""Differentiable urban driving: from road graph to steering as one jitted JAX function."""
