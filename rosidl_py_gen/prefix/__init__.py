"""Ament prefix of source packages, made without a build, and launch files that run with one."""
