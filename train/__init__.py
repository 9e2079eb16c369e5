"""Training of agents: one readable file per algorithm.

The package also has run folders, tuning, learning curves and export.
"""

from turning_env.extras import tell_plainly

tell_plainly()
