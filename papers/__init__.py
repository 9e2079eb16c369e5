"""The five papers: their claims checked (``papers.reproduce``) and their figures drawn anew (``papers.figures``).

The papers' controllers belong in ``baselines``; their equations belong in ``turning_env/physics``.
"""

from turning_env.extras import tell_plainly

tell_plainly()
