"""Other programs, driven or used from here."""
