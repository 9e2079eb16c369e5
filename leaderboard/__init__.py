"""The leaderboard: plays policies on held-out seeds, verifies and ranks results, writes the page.

What a policy is and how it plays an episode belong to ``turning_env.scoring``; training belongs to
``train``.
"""

from turning_env.extras import tell_plainly

tell_plainly()
