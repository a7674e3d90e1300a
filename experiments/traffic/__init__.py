"""Traffic analysis of logs, as in Tables III to VII."""
