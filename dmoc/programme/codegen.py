"""Stage functions as machine code: generated to C, compiled once, kept on disk.

The name of a library is a hash of the functions themselves (so of model, cost and the code that
wrote them), the compiler flags, CasADi's version and the machine. While a compiler works, or where
there is none, CasADi's virtual machine evaluates the same operations in the same order: with
`-ffp-contract=off` both give the same bits (tested), so that no result depends on when a compiler
finishes.

`DMOC_BACKEND` chooses: `auto` (default; compile in the background), `c` (wait for the compiler),
`vm` (never compile). `DMOC_CACHE` names the folder, else `$XDG_CACHE_HOME/dmoc` or
`~/.cache/dmoc`.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import casadi as ca

from dmoc.errors import InputError
from dmoc.programme.c_source import c_files
from dmoc.programme.stages import Stage

# Programmes solved before a compiler is started in `auto`, about a dozen motions: compiling costs
# as much CPU as it saves in some hundred, and one-off robots are not worth it.
SOLVES_BEFORE_COMPILING = 60


@dataclass
class StageSet:
    """The stages of one robot and cost and the state of their libraries in this process.

    Every stage has a library of its own: the dynamics serve every cost.
    """

    stages: tuple[Stage, ...]
    libraries: tuple[Library, ...] = ()
    compiled: tuple[Stage, ...] | None = None
    uses: int = 0
    started: bool = False

    def current(self) -> Backend:
        """The stages to use for the next solve."""
        mode = backend_mode()
        if mode == "vm":
            return Backend("vm", self.stages)
        if self.compiled is None:
            self._advance(wait=mode == "c")
        if self.compiled is None:
            return Backend("vm", self.stages)
        return Backend("c", self.compiled)

    def _advance(self, wait: bool) -> None:
        self.uses += 1
        if not self.libraries:
            self.libraries = tuple(library_for(stage.parts) for stage in self.stages)
        if self._load():
            return
        if not self.started and (wait or self.uses > SOLVES_BEFORE_COMPILING):
            self.started = True
            start_libraries([item for item in self.libraries if item.load() is None], wait)
            if wait:
                self._load()

    def _load(self) -> bool:
        found = [library.load() for library in self.libraries]
        if any(parts is None for parts in found):
            return False
        self.compiled = tuple(
            replace(stage, parts=(parts[0], parts[1], parts[2]))
            for stage, parts in zip(self.stages, found)
            if parts is not None
        )
        return True


@dataclass(frozen=True)
class Backend:
    """`name` is `c` or `vm`; both give the same bits."""

    name: str
    stages: tuple[Stage, ...]


# The passes left out find nothing in straight-line code and take a fifth of the compiler's time.
FLAGS = ("-O1", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-fno-tree-pta")
COMPILE_TIMEOUT_S = 300

BackendName = Literal["c", "vm"]


@dataclass(frozen=True)
class BackendReport:
    """What `dmoc doctor` shows: the compiler, the folder and how many libraries are in it."""

    mode: str
    compiler: str | None
    folder: Path
    writable: bool
    libraries: int


@dataclass(frozen=True)
class Library:
    """Functions and where their compiled form is, or will be."""

    functions: tuple[ca.Function, ...]
    path: Path

    def ready(self) -> bool:
        """Whether the compiled form is on disk, where nobody else can have put it."""
        return all(_is_ours(path) for path in (self.path.parent, self.path, _seal(self.path)))

    def load(self) -> tuple[ca.Function, ...] | None:
        """The compiled functions, or None if they are missing, damaged or of another machine."""
        if not self.ready() or not _is_sound(self.path):
            return None
        try:
            return tuple(ca.external(f.name(), str(self.path)) for f in self.functions)
        except RuntimeError:  # what CasADi raises when dlopen refuses a file
            return None

    def start(self, wait: bool) -> None:
        """`start_libraries` of this one."""
        start_libraries((self,), wait)


def start_libraries(libraries: Sequence[Library], wait: bool) -> None:
    """Compile side by side, for this process if `wait`, else in others that may outlive it."""
    compiler = find_compiler()
    jobs = []
    for library in libraries:
        folder = library.path.parent
        if compiler is None or not _make_folder(folder):
            return
        sources = _write_sources(library.functions, folder)
        if sources is not None:
            jobs.append((sources, library.path, compiler))
    if wait and jobs:
        with ThreadPoolExecutor(len(jobs)) as pool:
            list(pool.map(lambda job: compile_library(*job), jobs))
        return
    quiet = subprocess.DEVNULL
    for job in jobs:
        subprocess.Popen(
            [sys.executable, "-m", "dmoc.programme.codegen", *map(str, job)],
            stdin=quiet,
            stdout=quiet,
            stderr=quiet,
            start_new_session=True,
            close_fds=True,
        )


def backend_mode() -> str:
    """`auto`, `c` or `vm`, from DMOC_BACKEND."""
    mode = os.environ.get("DMOC_BACKEND", "auto")
    if mode not in ("auto", "c", "vm"):
        raise InputError.of(
            "backend",
            field="DMOC_BACKEND",
            value=mode,
            legal="auto, c or vm",
            fix="unset it for the default",
        )
    return mode


def library_for(functions: Sequence[ca.Function]) -> Library:
    """Where the compiled form of `functions` lives."""
    digest = hashlib.sha256()
    for function in functions:
        digest.update(function.serialize().encode())
    for text in (*FLAGS, ca.CasadiMeta.version(), platform.machine(), sys.platform):
        digest.update(text.encode())
    return Library(tuple(functions), cache_folder() / f"{digest.hexdigest()[:40]}.so")


def cache_folder() -> Path:
    """The folder of the compiled libraries."""
    named = os.environ.get("DMOC_CACHE")
    if named:
        return Path(named)
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "dmoc"


def find_compiler() -> str | None:
    """A C compiler: $CC, cc, gcc or clang."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        found = shutil.which(name) if name else None
        if found:
            return found
    return None


def backend_report() -> BackendReport:
    """What is there to compile with and to."""
    folder = cache_folder()
    nearest = next(p for p in (folder, *folder.parents) if p.exists())
    return BackendReport(
        backend_mode(),
        find_compiler(),
        folder,
        os.access(nearest, os.W_OK) and (nearest != folder or _is_ours(folder)),
        len(list(folder.glob("*.so"))) if folder.is_dir() else 0,
    )


def compile_library(sources: Path, target: Path, compiler: str) -> bool:
    """Compile the files in `sources` to `target` unless another process is at it; remove them.

    The library appears under its name only when it is whole; a `.sha256` beside it seals it.
    """
    with open(target.with_suffix(".lock"), "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            shutil.rmtree(sources, ignore_errors=True)
            return False
        for left in target.parent.glob(f"{target.stem}.*.tmp"):
            left.unlink(missing_ok=True)  # of a compiler that was killed
        handle, name = tempfile.mkstemp(".tmp", f"{target.stem}.", target.parent)
        os.close(handle)
        fresh = Path(name)
        objects = {path: path.with_suffix(".o") for path in sorted(sources.glob("*.c"))}
        steps = [[*FLAGS, "-c", "-o", str(made), str(path)] for path, made in objects.items()]
        link = ["-shared", "-o", str(fresh), *map(str, objects.values()), "-lm"]

        def run(arguments: list[str]) -> bool:
            command = [compiler, *arguments]
            done = subprocess.run(
                command, check=False, capture_output=True, timeout=COMPILE_TIMEOUT_S
            )
            return done.returncode == 0

        try:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                made = all(pool.map(run, steps)) and run(link)
            if made:
                seal = hashlib.sha256(fresh.read_bytes()).hexdigest()
                os.chmod(fresh, 0o600)  # whatever the umask leaves to others
                os.replace(fresh, target)
                draft = fresh.with_suffix(".seal")
                draft.write_text(seal)
                os.chmod(draft, 0o600)
                os.replace(draft, _seal(target))
            return made
        except (subprocess.TimeoutExpired, OSError):
            return False
        finally:
            fresh.unlink(missing_ok=True)
            shutil.rmtree(sources, ignore_errors=True)


def _seal(path: Path) -> Path:
    return path.with_suffix(".sha256")


def _is_ours(path: Path) -> bool:
    """Whether a file or folder is this user's and nobody else can write it: its code is run."""
    try:
        found = path.lstat()
    except OSError:
        return False
    return found.st_uid == os.geteuid() and not found.st_mode & 0o022 and not path.is_symlink()


def _is_sound(path: Path) -> bool:
    """Whether the library is byte for byte what the compiler wrote; loading half of one crashes."""
    try:
        return _seal(path).read_text() == hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return False


def _make_folder(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK) and _is_ours(folder)


def _write_sources(functions: tuple[ca.Function, ...], folder: Path) -> Path | None:
    files = c_files(functions)
    if files is None:
        return None
    try:
        sources = Path(tempfile.mkdtemp(".c", dir=folder))
        for i, text in enumerate(files):
            (sources / f"{i}.c").write_text(text)
    except OSError:
        return None
    return sources


if __name__ == "__main__":
    compile_library(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
