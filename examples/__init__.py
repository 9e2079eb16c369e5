"""Recipes for other libraries, one script per library; docs/ecosystem.md lists their results."""
