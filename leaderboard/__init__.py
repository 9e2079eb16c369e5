"""The leaderboard: plays policies on common draws, computes statistics, writes results and the page."""
