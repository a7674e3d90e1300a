"""The lattice of macro planning, and of a whole course: nodes, edges, what they cost, the cheapest way through."""
