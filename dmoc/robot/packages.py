"""Where the files of a ROS package lie, and xacro files expanded to URDF."""

from __future__ import annotations

import contextlib
import filecmp
import io
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path

from dmoc.errors import DmocError, RobotError
from dmoc.input_file import confined
from dmoc.robot.xml_file import read_xml


class Packages:
    """Finds packages around a robot file, in `folders`, and where the ROS environment points.

    Looked at, in this order: `folders` (a package, or a folder of packages); every folder above
    the file (the package itself, or a sibling of it); `ROS_PACKAGE_PATH`; `AMENT_PREFIX_PATH`.
    """

    def __init__(self, urdf: Path, folders: Sequence[str | Path] = ()) -> None:
        self.folder = urdf.resolve().parent
        self.folders = [Path(folder).resolve() for folder in folders]

    def _places(self) -> Iterator[Path]:
        yield from self.folders
        yield from (self.folder, *self.folder.parents)
        for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
            if entry:
                yield Path(entry)
        for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if entry:
                yield Path(entry) / "share"

    def find(self, name: str) -> Path | None:
        """The package's folder: so called, or with a package.xml that says so."""
        if not name or "/" in name or name.startswith("."):
            return None
        for place in self._places():
            if place.name == name and place.is_dir():
                return place
            if (place / name).is_dir():
                return place / name
            if _name_of(place) == name:
                return place
        return None

    @property
    def own(self) -> Path:
        """The package that the file belongs to (its folder, if it belongs to none)."""
        inside = (self.folder, *self.folder.parents)
        return next((p for p in inside if (p / "package.xml").is_file()), self.folder)

    def mesh(self, name: str, file: str, field: str) -> Path:
        """The file that a mesh name means; it may lie in its package or the file's only.

        Errors: `DmocError` (path-outside, package-missing).
        """
        if not name.startswith(("package://", "model://")):
            plain = name.removeprefix("file://")
            try:
                return confined(plain, self.folder, file, field)
            except DmocError:
                inside = os.path.relpath(self.folder / plain, self.own)
                return confined(inside, self.own, file, field)
        inner = name.split("://", 1)[1]
        package, _, rest = inner.partition("/")
        if (self.folder / inner).is_file():  # as `dmoc init` copies it
            return confined(inner, self.folder, file, field)
        found = self.find(package)
        if found is None and rest and not (self.own / "package.xml").is_file():
            # A folder torn out of its package: urdf/ beside meshes/, or all in one.
            torn = (self.folder, self.folder.parent)
            found = next((place for place in torn if (place / rest).is_file()), None)
        if found is None:
            raise RobotError.of(
                "package-missing",
                file,
                field,
                package,
                "a package beside the file or in ROS_PACKAGE_PATH, AMENT_PREFIX_PATH",
                "say where the package lies: --package-path FOLDER",
            )
        return confined(rest, found, file, field)


def with_meshes(text: bytes, meshes: Mapping[str, Path], folder: Path) -> bytes:
    """A robot file's text for `folder`: its meshes (name → file) are copied there.

    Names that would lead out of the folder are changed, to files of their own in its meshes/.
    """
    plain = {name: Path(name.split("://", 1)[-1]) for name in meshes}
    out = {name for name, to in plain.items() if to.is_absolute() or ".." in to.parts}
    out |= {name for name in meshes if name.startswith("file://")}
    for name in sorted(meshes, key=out.__contains__):
        path, target = meshes[name], folder / plain[name]
        if name in out:
            tries = (folder / "meshes" / f"{k}_{path.name}"[0 if k else 2 :] for k in count())
            target = next(t for t in tries if not t.exists() or filecmp.cmp(path, t, False))
            for quote in "\"'":
                new = f'"{target.relative_to(folder).as_posix()}"'
                text = text.replace(f"{quote}{name}{quote}".encode(), new.encode())
        copy_file(path, target)
    return text


def copy_file(source: Path, target: Path) -> None:
    """A copy, its folder made first; nothing where both are one file."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.resolve() != target.resolve():
        shutil.copyfile(source, target)


def _name_of(folder: Path) -> str:
    """What the package.xml of a folder calls the package, or nothing."""
    if not (folder / "package.xml").is_file():
        return ""
    try:
        element = read_xml(folder / "package.xml").first("name")
    except DmocError:
        return ""
    return "" if element is None else element.text.strip()


def expanded(path: Path, packages: Packages, arguments: Mapping[str, object]) -> str:
    """The URDF text of a xacro file with `arguments`; `RobotError` for what goes wrong in it."""
    import xacro
    from xacro import substitution_args

    def find(name: str) -> str:
        found = packages.find(name)
        if found is None:
            raise LookupError(f"no package {name}")
        return str(found)

    kept = substitution_args._eval_find
    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            texts = {name: str(value) for name, value in arguments.items()}
            return str(xacro.process_file(str(path), mappings=texts).toprettyxml(indent="  "))
    # A xacro file is a programme: what goes wrong in it is an error of any kind.
    except Exception as error:
        text = " ".join(str(error).split())[:200]
        raise RobotError.of(
            "urdf-xacro",
            str(path),
            value=f"{type(error).__name__}: {text}",
            legal="a xacro file that expands with its arguments",
            fix="mend it, give its arguments: --xacro-arg NAME:=VALUE, or say where its packages "
            "lie: --package-path FOLDER",
        ) from error
    finally:
        substitution_args._eval_find = substitution_args._eval_dict["find"] = kept
