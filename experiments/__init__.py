"""One thin entry point per question that a user asks."""
