"""Localization on a made-up district with a known truth (Table II), under injected failures, and on real scans."""
