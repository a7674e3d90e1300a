"""Traffic analysis of any set of logs: teams on one course, platoons, and what an offset frame does."""
