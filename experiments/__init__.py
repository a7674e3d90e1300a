"""Entry points: one thin module per question that a user asks."""
