"""From a path and a speed to a command."""
