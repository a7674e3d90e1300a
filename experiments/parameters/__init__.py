"""Which numbers of the closed loop may be tuned, and how."""
