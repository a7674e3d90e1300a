"""Parameters of the stack tuned by gradient, from recorded drivers or from closed loops, and failures found by it."""
