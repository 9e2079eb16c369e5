"""Long and violent use: programs killed at any moment, and lathes that run for months; ``python -m benchmarks.soak``."""
