"""Play a policy on given seeds, compare returns, and distribute the episodes over processes.

Controllers belong in ``baselines``; files of results and their ranking belong in ``leaderboard``.
"""
