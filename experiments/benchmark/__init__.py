"""Speed of stack and simulator on this machine."""
