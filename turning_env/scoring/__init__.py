"""Play a policy on given seeds, compare returns, and spread the plays over processes.

Controllers belong in ``baselines``; files of results and their ranking belong in ``leaderboard``.
"""
