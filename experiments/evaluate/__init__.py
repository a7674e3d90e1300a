"""How good drivers are, on how many drives you like."""
