"""The lattice of a racetrack and the cheapest lap through it."""
