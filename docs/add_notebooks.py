"""The folder of notebooks as pages of the site: it lies beside the documentation, not in it."""

from pathlib import Path

from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]


@event_priority(100)  # before the plugin that makes pages of notebooks looks for them
def on_files(files: Files, config) -> Files:
    """Notebooks, and the page that lists them."""
    for path in [*sorted((ROOT / "notebooks").glob("*.ipynb")), ROOT / "notebooks" / "README.md"]:
        place = str(path.relative_to(ROOT))
        files.append(File(place, str(ROOT), config.site_dir, config.use_directory_urls))
    return files


def on_page_markdown(markdown: str, page, **given) -> str:
    """Links out of the folder of the documentation, right where the repository is read, as links within the site."""
    up = "../" * page.file.src_uri.count("/")
    return markdown.replace(f"]({up}../notebooks/", f"]({up}notebooks/")
