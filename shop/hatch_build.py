"""Links of the shop's package, which follow from the repository's address.

The address is ``[tool.hatch.metadata.hooks.custom]`` in pyproject.toml. Without it, the links of
the README stay relative, and lead nowhere on a package index.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

RELATIVE_LINK = re.compile(r"\]\((?!\w+:|#)([^)]+)\)")


class Links(MetadataHookInterface):
    """Adds the README, with absolute links, and the address of the source."""

    def update(self, metadata: dict[str, Any]) -> None:
        readme = (Path(self.root) / "README.md").read_text("utf-8")
        repository = self.config["repository"].rstrip("/")
        if repository:
            files = f"{repository}/blob/v{metadata['version']}"

            def absolute(link: re.Match[str]) -> str:
                """Return the link with the address of its file in the repository."""
                path = posixpath.normpath(posixpath.join("shop", link[1]))
                return f"]({files}/{path})"

            readme = RELATIVE_LINK.sub(absolute, readme)
            metadata["urls"] = {"Source": repository, "Documentation": f"{files}/shop/docs"}
        metadata["readme"] = {"content-type": "text/markdown", "text": readme}
