"""Recipes for other libraries, one script per library; docs/ecosystem.md lists their results."""

from turning_env.extras import tell_plainly

tell_plainly()
