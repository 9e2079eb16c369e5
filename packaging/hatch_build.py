"""Links of the package, which follow from the repository's address.

The address is ``[tool.hatch.metadata.hooks.custom]`` in pyproject.toml.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class Links(MetadataHookInterface):
    """Adds the README, with absolute links, and the package's addresses.

    Without an address, links stay relative.
    """

    def update(self, metadata: dict[str, Any]) -> None:
        repository, version = self.config["repository"].rstrip("/"), metadata["version"]
        text = (Path(self.root) / "README.md").read_text("utf-8")
        if repository:
            links = rf"\1({repository}/raw/v{version}/\2)", rf"\1({repository}/blob/v{version}/\2)"
            for link, absolute in zip(
                (r"(!\[[^\]]*\])\((?!https?:|#)(.*?)\)", r"(\])\((?!https?:|#)(.*?)\)"),
                links,
                strict=True,
            ):
                text = re.sub(link, absolute, text)
            pages = {
                "Documentation": "blob/{}/docs",
                "Changelog": "blob/{}/CHANGELOG.md",
                "Issues": "issues",
            }
            metadata["urls"] = {"Source": repository} | {
                name: f"{repository}/{page.format(f'v{version}')}" for name, page in pages.items()
            }
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
