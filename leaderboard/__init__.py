"""The leaderboard: plays policies on common draws, computes statistics, writes results and the page."""

from baselines.extras import tell_plainly

tell_plainly()
