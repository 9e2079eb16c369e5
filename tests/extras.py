"""Check that messages for missing packages name an extra that brings them."""

import functools
from importlib.metadata import packages_distributions
from typing import Any

from tests.test_constraints import distribution_of
from turning_env.extras import missing


@functools.cache
def modules_of() -> dict[str, list[str]]:
    """Return the modules of each installed distribution."""
    modules: dict[str, list[str]] = {}
    for module, distributions in packages_distributions().items():
        for distribution in distributions:
            modules.setdefault(distribution.lower().replace("_", "-"), []).append(module)
    return modules


def check_extra(project: dict[str, Any], extra: str) -> None:
    """Check the messages for the packages of an extra of a distribution.

    A message may name another extra, or the distribution itself, if that brings the package.
    """
    modules = modules_of()
    extras = project["project"]["optional-dependencies"]
    own_name = project["project"]["name"]
    for need in extras[extra]:
        # Some distributions bring private modules beside the one that is imported.
        messages = [
            missing(ModuleNotFoundError(name=module)) for module in modules[distribution_of(need)]
        ]
        texts = [text for text in messages if text is not None]
        assert texts, need
        needs = {name: extras[name] for name in extras if f"[{name}]" in texts[0]}
        if texts[0].endswith(f" {own_name}"):
            needs[own_name] = project["project"]["dependencies"]
        bringing = {distribution_of(other) for some in needs.values() for other in some}
        assert distribution_of(need) in bringing, texts[0]
