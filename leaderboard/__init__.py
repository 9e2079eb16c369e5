"""The leaderboard: plays policies on held-out seeds, verifies and ranks results, and writes the page.

What a policy is and how an episode is played belong to ``turning_env.scoring``, training to ``train``.
"""

from turning_env.extras import tell_plainly

tell_plainly()
