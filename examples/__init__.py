"""RoughTurning with other libraries, one script each: what they give is in docs/ecosystem.md."""

from turning_env.extras import tell_plainly

tell_plainly()
