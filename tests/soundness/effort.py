"""How many inputs a property is tried on."""

from typing import Any

from hypothesis import HealthCheck, settings


def tried(short: int, soak: int) -> Any:
    """Settings for a property: ``short`` inputs in the suite, ``soak`` where ``HYPOTHESIS_PROFILE`` is ``soak``.

    A file in pytest's ``tmp_path`` is written anew for every input, so the folder may be shared.
    """
    soaking = settings.get_current_profile_name() == "soak"
    return settings(
        max_examples=soak if soaking else short,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
