"""Fuzzing of all that reads files from elsewhere: ``python -m benchmarks.fuzz``."""
