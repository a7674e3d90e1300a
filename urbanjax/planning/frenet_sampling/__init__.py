"""Planning over time in the Frenet frame of a reference line: a grid of end states, what each costs, and the choice."""
