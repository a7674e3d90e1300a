"""What the experiments compute, tabulate and draw."""
