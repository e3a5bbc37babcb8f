"""Metadata that hatchling asks for: the project's address, and a README whose links and pictures lead there.

GitHub's workflows name their repository in the environment. Elsewhere there is no address, and links stay as they are.
"""

import os
import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

README = Path(__file__).parents[1] / "README.md"


def absolute(text: str, address: str, commit: str) -> str:
    """README whose pictures and links to files lead to those of a commit."""
    picture, link = r"(!\[[^\]]*\]\()(?!https?:|#)", r"((?<!!)\[[^\]]*\]\()(?!https?:|#)"
    text = re.sub(picture, rf"\g<1>{address}/raw/{commit}/", text)
    return re.sub(link, rf"\g<1>{address}/blob/{commit}/", text)


class ReleaseMetadata(MetadataHookInterface):
    """The hook of `[tool.hatch.metadata.hooks.custom]` in `pyproject.toml`."""

    def update(self, metadata: dict) -> None:
        """Add `readme` and, where the address is known, `urls`."""
        text = README.read_text(encoding="utf-8")
        if repository := os.environ.get("GITHUB_REPOSITORY"):
            address = f"{os.environ.get('GITHUB_SERVER_URL', 'https://github.com')}/{repository}"
            text = absolute(text, address, os.environ.get("GITHUB_SHA", "HEAD"))
            owner, _, name = repository.partition("/")
            metadata["urls"] = {
                "Source": address,
                "Documentation": f"https://{owner}.github.io/{name}/",
                "Changes": f"{address}/blob/HEAD/.github/CHANGELOG.md",
                "Issues": f"{address}/issues",
            }
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
