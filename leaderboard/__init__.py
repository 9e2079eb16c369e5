"""The leaderboard: plays policies on common draws, computes statistics, writes results and the page."""

from turning_env.extras import tell_plainly

tell_plainly()
