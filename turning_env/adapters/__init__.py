"""The batch behind other libraries' interfaces, one file per library, which imports that library.

Nothing else imports these files, so that ``import turning_env`` stays light.
"""
