"""Studies: comparisons as data (``*.toml``), speed, bounds, exploits.

Code that backs a number or a guarantee of the documentation belongs here; code that users or other
packages call does not.
"""

from turning_env.extras import tell_plainly

tell_plainly()
