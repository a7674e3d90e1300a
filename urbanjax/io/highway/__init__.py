"""highway-env: a simulator that we did not write, as a place to drive in and as a renderer."""
