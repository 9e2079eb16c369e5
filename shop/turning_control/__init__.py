"""The link to a real control: a shield around any policy, a controller of readings and commands, and LinuxCNC.

Nothing here changes the environment. Training and scoring of policies belong elsewhere.
"""
