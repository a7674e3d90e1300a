"""How vehicles move together: string stability, flow and density, passages, lane changes and travel times."""
