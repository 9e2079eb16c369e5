"""Throughput measurements against peers."""
