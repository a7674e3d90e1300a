"""The road graph: build, locate, route, extend."""
