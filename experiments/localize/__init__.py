"""Localization over the whole district (Table II), under injected failures, or on a folder of real scans."""
