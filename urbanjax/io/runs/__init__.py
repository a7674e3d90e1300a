"""Runs of experiments: command line, configuration, directory, progress, report."""
