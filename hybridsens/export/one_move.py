"""Files that are whole at any time."""

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path


def must_have_a_folder(path: Path, must: str) -> None:
    """Raise ValueError where no file can be: at a folder, or in none. `must` begins the sentence."""
    if path.is_dir() or not path.parent.is_dir():
        what = "is a folder" if path.is_dir() else "is in a folder that does not exist"
        raise ValueError(f"{must} in a folder that exists, but {path} {what}.")


@contextlib.contextmanager
def in_one_move(path: Path) -> Iterator[Path]:
    """A draft beside a file, which takes the file's place once it is written. Others may write the same file."""
    draft = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        yield draft
        os.replace(draft, path)
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
