"""What is put into a recording beside the events, so that it can be read without the machine that it was made on."""

from collections.abc import Iterable

from bridge.edges.class_files import class_files
from bridge.edges.recording import Attachment


def attached_classes(paths: Iterable[str]) -> list[Attachment]:
    """The class files of files and folders, as they are. OSError when one cannot be read."""
    return [
        Attachment(file.name, file.read_bytes(), f"application/{'toml' if file.suffix.lower() == '.toml' else 'xml'}")
        for file in class_files(paths)
    ]
