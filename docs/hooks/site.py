"""MkDocs hooks: they add the generated pages, and refuse a page that loads from another site."""

import re
from pathlib import Path
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

from docs.hooks.reference import PAGES

ROOT = Path(__file__).resolve().parents[2]

PAGES_BESIDE = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
"""Pages of the project that are outside docs/."""

SHOWN = (*PAGES_BESIDE, "LICENSE", "CITATION.cff", "scenarios/*.toml", "examples/*.*")
"""Files of the project that pages link to; the site has a copy of each."""

IN_THE_SITE = {
    **{
        f"](../harness/scenario/{name}.py)": "](reference/keys.md)"
        for name in ("sections", "pedestrians", "traffic")
    },
    "](hooks/reference.py)": "](reference/columns.md)",
}
"""Links of the files in docs/, with the generated pages that replace them in the site."""

LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio)\b[^>]*\bsrc=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|<link\b(?![^>]*rel=["']?canonical)[^>]*\bhref=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|url\(["']?((?:https?:)?//[^"')]+)|@import ["']((?:https?:)?//[^"']+)""",
    re.IGNORECASE,
)
"""Content that a page loads from another site; plain links are allowed."""


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages, and the files of the project that pages lead to."""
    for path, make in PAGES.items():
        files.append(File.generated(config, path, content=make()))
    for pattern in SHOWN:
        for found in sorted(ROOT.glob(pattern)):
            name = found.relative_to(ROOT).as_posix()
            if found.suffix == ".md":
                text = found.read_text(encoding="utf-8")
                files.append(File.generated(config, name.lower(), content=text))
            else:
                files.append(File.generated(config, name, abs_src_path=str(found)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links that leave docs/ lead to the site's copies."""
    place = page.file.src_uri
    beside = place.upper() in {name.upper() for name in PAGES_BESIDE}
    here = "" if beside else "../"
    for name in PAGES_BESIDE:
        markdown = markdown.replace(f"]({here}{name}", f"]({here}{name.lower()}")
    if beside:
        return markdown.replace("](docs/", "](")
    for file, made in IN_THE_SITE.items():
        markdown = markdown.replace(file, made)
    return markdown if "/" in place else markdown.replace("](../", "](")


def on_post_build(config: Any) -> None:
    """Refuse a site that loads anything from elsewhere: it is read offline, too."""
    for path in sorted(Path(config["site_dir"]).rglob("*")):
        if path.suffix not in (".html", ".css"):
            continue
        outside = LOADED.search(path.read_text(encoding="utf-8"))
        if outside:
            raise PluginError(f"{path} loads {outside[0]}")
