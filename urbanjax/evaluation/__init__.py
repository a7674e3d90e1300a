"""What drives come to: metrics, collisions, scores; drives in the place of recorded drivers."""
