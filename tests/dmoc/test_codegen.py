"""The cache of compiled stage functions: same bits, and every way a file can be bad."""

import os
import stat
import time
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from random_arms import random_model, random_problems, random_robot

from dmoc.errors import InputError
from dmoc.physics.dynamics import arm_model
from dmoc.programme import builder
from dmoc.programme.codegen import FLAGS, backend_report, find_compiler, library_for
from dmoc.programme.cost_stages import (
    electrical_rate,
    midpoint_cost_stage,
    quadratic_rate,
    spread_cost_stage,
)
from dmoc.programme.stages import dynamics_stage
from dmoc.robot.drive import ur_class_drive
from dmoc.solving.solver import solve

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("DMOC_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("DMOC_BACKEND", "c")
    monkeypatch.setattr(builder, "_STAGES", {})
    return tmp_path / "cache"


def small_functions():
    x = ca.SX.sym("x", 2)
    return [ca.Function("small", [x], [ca.sin(x[0]) * x[1] + 1 / 3])]


@needs_compiler
def test_compiled_and_virtual_machine_give_the_same_bits(cache) -> None:
    assert "-ffp-contract=off" in FLAGS
    rng = np.random.default_rng(0)
    arm = arm_model(random_model(rng, 3, tree=False))
    stages = [
        dynamics_stage(arm, True),
        midpoint_cost_stage(6, quadratic_rate()),
        midpoint_cost_stage(6, electrical_rate(6, ur_class_drive(), 0.05)),
        spread_cost_stage(arm, quadratic_rate(), True),
    ]
    for stage in stages:
        library = library_for(stage.parts)
        library.start(wait=True)
        compiled = library.load()
        assert compiled is not None
        for plain, fast in zip(stage.parts, compiled):
            for _ in range(100):
                args = [abs(rng.normal(size=plain.size_in(i))) for i in range(plain.n_in())]
                for a, b in zip(plain.call(args), fast.call(args)):
                    assert np.array(a).tobytes() == np.array(b).tobytes()


@needs_compiler
def test_whole_motions_do_not_depend_on_the_backend(cache, monkeypatch, tmp_path) -> None:
    robot = random_robot(1, tmp_path, 4)
    problems = random_problems(robot, 4, num_intervals=20)
    motions = {}
    for mode in ("vm", "c"):
        monkeypatch.setenv("DMOC_BACKEND", mode)
        motions[mode] = [solve(problem) for problem in problems]
    assert len(list(cache.glob("*.so"))) == 2
    for a, b in zip(motions["vm"], motions["c"]):
        assert a.trajectory.q_rad.tobytes() == b.trajectory.q_rad.tobytes()
        assert (a.cost, a.iterations, a.max_defect) == (b.cost, b.iterations, b.max_defect)


@needs_compiler
@pytest.mark.parametrize("damage", ["truncated", "text", "unsealed", "wrong seal"])
def test_a_damaged_library_is_not_loaded_and_is_built_again(cache, damage) -> None:
    library = library_for(small_functions())
    library.start(wait=True)
    good = library.path.read_bytes()
    seal = library.path.with_suffix(".sha256")
    if damage == "truncated":
        library.path.write_bytes(good[: len(good) // 2])
    elif damage == "text":
        library.path.write_text("not a library")
    elif damage == "unsealed":
        seal.unlink()
    else:
        seal.write_text("0" * 64)
    assert library.load() is None
    library.start(wait=True)
    compiled = library.load()
    assert compiled is not None
    assert float(compiled[0]([0.5, 2.0])) == float(small_functions()[0]([0.5, 2.0]))


@needs_compiler
def test_a_sealed_file_of_another_machine_is_not_loaded(cache) -> None:
    import hashlib

    library = library_for(small_functions())
    cache.mkdir()
    foreign = b"\x7fELF" + bytes(200)
    library.path.write_bytes(foreign)
    library.path.with_suffix(".sha256").write_text(hashlib.sha256(foreign).hexdigest())
    assert library.load() is None


@needs_compiler
def test_many_at_once_leave_one_library_and_no_scraps(cache) -> None:
    libraries = [library_for(small_functions()) for _ in range(6)]
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda library: library.start(True), libraries))
    assert libraries[0].load() is not None
    assert {p.suffix for p in cache.iterdir()} <= {".so", ".sha256", ".lock"}
    assert len(list(cache.glob("*.so"))) == 1


@needs_compiler
def test_a_compiler_in_the_background_finishes(cache) -> None:
    library = library_for(small_functions())
    library.start(wait=False)
    for _ in range(600):
        if library.ready():
            break
        time.sleep(0.05)
    assert library.load() is not None


def test_without_a_compiler_the_virtual_machine_answers(cache, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert backend_report().compiler is None
    robot = random_robot(2, tmp_path, 2)
    assert solve(random_problems(robot, 1, num_intervals=8)[0]).status.ok
    assert not cache.exists() or not list(cache.glob("*.so"))


@pytest.mark.parametrize("fault", ["read-only", "is a file", "parent is a file"])
def test_an_unusable_folder_is_no_obstacle(tmp_path, monkeypatch, fault) -> None:
    folder = tmp_path / "cache"
    if fault == "read-only":
        folder.mkdir()
        folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    else:
        folder.write_text("")
        folder = folder / "deeper" if fault == "parent is a file" else folder
    monkeypatch.setenv("DMOC_CACHE", str(folder))
    monkeypatch.setenv("DMOC_BACKEND", "c")
    monkeypatch.setattr(builder, "_STAGES", {})
    robot = random_robot(3, tmp_path, 2)
    assert solve(random_problems(robot, 1, num_intervals=8)[0]).status.ok


def test_an_unknown_backend_is_refused(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("DMOC_BACKEND", "gpu")
    robot = random_robot(4, tmp_path, 2)
    with pytest.raises(InputError, match="DMOC_BACKEND"):
        solve(random_problems(robot, 1, num_intervals=8)[0])


def test_report_names_the_folder(cache) -> None:
    report = backend_report()
    assert report.folder == cache
    assert report.mode == "c"
    assert report.libraries == 0


@needs_compiler
@pytest.mark.parametrize("thing", ["folder", "library", "seal"])
@pytest.mark.parametrize("fault", ["others can write", "another owner", "a link"])
def test_what_others_could_have_planted_is_not_loaded(cache, tmp_path, thing, fault) -> None:
    """A library is code: root ran one that somebody else had put into a folder for all."""
    library = library_for(small_functions())
    library.start(wait=True)
    assert library.load() is not None
    path = {
        "folder": cache,
        "library": library.path,
        "seal": library.path.with_suffix(".sha256"),
    }[thing]
    if fault == "others can write":
        path.chmod(path.stat().st_mode | stat.S_IWOTH)
    elif fault == "another owner":
        if os.geteuid() != 0:
            pytest.skip("only root can give a file away")
        os.chown(path, 65534, 65534)
    else:
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    assert library.load() is None
    if thing == "folder":
        assert not backend_report().writable
        before = sorted(cache.iterdir())
        library_for([small_functions()[0].wrap()]).start(wait=True)
        assert sorted(cache.iterdir()) == before


@needs_compiler
def test_a_new_cache_folder_is_ours_alone(cache) -> None:
    library_for(small_functions()).start(wait=True)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
