"""Optional packages of the shop: what installs them, for the message when one is missing."""

from turning_env.extras import TABLES

EXTRAS = {
    "rough-turning-shop": ("matplotlib", "scipy", "tqdm"),
    "'rough-turning-shop[programs]'": ("ezdxf", "shapely"),
    "'rough-turning-shop[opcua]'": ("asyncua",),
    "'rough-turning-shop[xlsx]'": ("openpyxl",),
}
"""Arguments of ``pip install``, and the import names of the packages that it brings."""


def register() -> None:
    """Let messages for missing packages name the extras of the shop."""
    if EXTRAS not in TABLES:
        TABLES.insert(0, EXTRAS)
