"""The leaderboard: plays policies on the same held-out seeds, verifies and ranks results, writes the page and the cards."""

from turning_env.extras import tell_plainly

tell_plainly()
