"""The link to a real control: LinuxCNC and OPC UA, and a shield around any policy.

Nothing here changes the environment. Training and scoring of policies belong elsewhere.
"""

from turning_shop.extras import register

register()
