"""Rule-based controllers, one file each, a catalogue of them, and their tuned parameters as data.

Models that several controllers share belong in ``models``; the bound and the oracle, which no
policy can match, in ``oracles``.
"""

from turning_env.extras import tell_plainly

tell_plainly()
