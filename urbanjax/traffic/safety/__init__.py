"""Surrogate safety measures: how near to a collision traffic came. docs/safety.md defines them and their edge cases."""
