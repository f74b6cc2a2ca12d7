"""A first run compiles in two processes: one answers, the other compiles the kernels of motions."""

import ast
import fcntl
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import pytest

from consilience.case import load_case
from consilience.engine import Question, load_engine
from consilience.engine.worker.client import Reply
from consilience.engine.worker.requests import perform
from consilience.reference.kernel.cache import SOURCES, digest, kernels_folder, one_process
from consilience.reference.steppers.driver import integrate
from consilience.reference.tree.solver import prepare
from consilience.reference.tree.system import system_record
from consilience.suite import QUICK, suite, warm_up
from kernels import copy_kernels, numba_folder

SOURCE = Path(suite.__file__).parents[1]


def test_kernels_count_as_compiled_with_those_of_motions_or_without_a_compiler(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not warm_up.compiled()
    folder = kernels_folder() / "tree"
    folder.mkdir(parents=True)
    (folder / "inertia.push-100.py311.nbi").touch()
    assert not warm_up.compiled()
    function = integrate.py_func
    file = f"{function.__module__.rpartition('.')[2]}.{function.__name__}-{function.__code__.co_firstlineno}.py311.nbi"
    (folder / file).touch()
    assert warm_up.compiled()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "another"))
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert warm_up.compiled()


def test_the_library_announces_compilation_once(tmp_path):
    code = "import consilience as cs, consilience.reference as r; cs.simulate, r.simulate, r.formulation"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    environment.pop("NUMBA_DISABLE_JIT", None)

    def said():
        command = [sys.executable, "-c", code]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr

    (line,) = said().splitlines()
    assert line.startswith("compiling the reference solver")
    assert str(tmp_path) in line
    (tmp_path / f"kernels-{digest(SOURCE)}" / "kernel.nbi").touch()
    assert said() == ""


def test_copied_kernels_lie_where_numba_looks_for_them(tmp_path):
    room = SOURCE / "reference" / "steppers"
    assert Path(integrate.stats.cache_path) == kernels_folder() / numba_folder(room)
    for name, text in (("one", "x = 1"), ("two", "x = 1"), ("another", "x = 2")):
        sources = tmp_path / name / "reference" / "steppers"
        sources.mkdir(parents=True)
        (sources / "driver.py").write_text(text)
    kernels = Path("reference") / "kernel" / "__pycache__" / f"kernels-{digest(tmp_path / 'one')}"
    compiled = tmp_path / "one" / kernels / numba_folder(tmp_path / "one" / "reference" / "steppers")
    compiled.mkdir(parents=True)
    for name in ("driver.nbi", "driver.1.nbc", "driver.nbi.tmp.1"):
        (compiled / name).write_text(name)
    assert copy_kernels(tmp_path / "one", tmp_path / "two") == 2
    copied = tmp_path / "two" / kernels / numba_folder(tmp_path / "two" / "reference" / "steppers")
    assert {file.name: file.read_text() for file in copied.iterdir()} == {n: n for n in ("driver.nbi", "driver.1.nbc")}
    assert copy_kernels(tmp_path / "one", tmp_path / "another") == 0


HEAD = "from consilience.reference.kernel.compiled import inner, kernel\n"
CALLEE = HEAD + "@inner\ndef times(x):\n    return {} * x\n"
CALLER = HEAD + (
    "from consilience.reference.tree.callee import times\n@kernel\ndef multiple(x):\n    return times(x)\n"
)
"""Two kernels in two files."""


def test_a_kernel_never_runs_with_kernels_of_other_sources(tmp_path):
    """A caller in a file that did not change is compiled anew when a kernel that it calls changes."""
    source = tmp_path / "src" / "consilience"
    shutil.copytree(SOURCE, source, ignore=shutil.ignore_patterns("__pycache__", "*.nb?"))
    (source / "reference" / "tree" / "caller.py").write_text(CALLER)

    def result():
        environment = os.environ | {"PYTHONPATH": str(tmp_path / "src"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        command = [sys.executable, "-c", "from consilience.reference.tree.caller import multiple; print(multiple(3.0))"]
        return float(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)

    (source / "reference" / "tree" / "callee.py").write_text(CALLEE.format(2))
    assert result() == 6.0
    # Python takes a file of the same length, changed within a second, for the same
    (source / "reference" / "tree" / "callee.py").write_text(CALLEE.format(50))
    assert result() == 150.0


def test_the_same_sources_have_the_same_folder_of_kernels(tmp_path):
    """Whatever their times; another source, or the name of one, changes the folder."""
    for folder in ("mechanism", "reference"):
        shutil.copytree(SOURCE / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    assert digest(tmp_path) == digest(SOURCE)
    changed = tmp_path / "another"
    shutil.copytree(tmp_path / "reference", changed / "reference")
    shutil.copytree(tmp_path / "mechanism", changed / "mechanism")
    source = changed / "reference" / "kernel" / "vectors.py"
    source.write_text(source.read_text() + "# another line\n")
    assert digest(changed) != digest(SOURCE)


def test_what_kernels_take_from_elsewhere_is_of_files_that_the_folder_is_named_after():
    """Every name that a compiled function uses, and its file imports, is defined in a file of the digest."""
    sources = {file for pattern in SOURCES for file in SOURCE.glob(pattern)}
    used = set()
    for file in sources:
        tree = ast.parse(file.read_text())
        imported = {
            name.asname or name.name: node.module
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for name in node.names
        }
        for function in (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.decorator_list):
            names = {
                node.id for statement in function.body for node in ast.walk(statement) if isinstance(node, ast.Name)
            }
            used |= {(imported[name], name) for name in names & set(imported)}
    used = {(module, name) for module, name in used if module.startswith("consilience")}
    assert ("consilience.mechanism", "RANK_TOLERANCE") in used
    outside = {name for module, name in used if not module.startswith("consilience.reference")}
    defined = "".join(file.read_text() for file in sources if file.parent.name == "mechanism")
    assert [name for name in sorted(outside) if f"\n{name} = " not in defined] == []
    rooms = {module.split(".")[2] for module, _ in used if module.startswith("consilience.reference")}
    assert rooms <= {file.parent.name for file in sources}


def test_the_second_process_is_asked_for_all_compiled_motions_of_the_first_formulation(monkeypatch):
    asked, all_asked = [], Event()

    class Recorder:
        def __init__(self, engine, limit, memory):
            self.engine = load_engine(engine)

        def ask(self, request):
            asked.append(request)
            value = perform(self.engine, request)
            if len(asked) == 6:
                all_asked.set()
            return Reply(value, True)

        def stop(self):
            asked.append("stopped")

    monkeypatch.setattr(warm_up, "Worker", Recorder)
    with warm_up.compiled_beside([load_case("double_pendulum"), load_case("four_bar")], 60.0, 2**30):
        assert all_asked.wait(120.0)
    assert asked.pop() == "stopped"
    motions = [request for request in asked if request.question is Question.TRAJECTORY]
    assert [(one.mechanism.name, one.method.name) for one in motions] == [
        (name, method) for name in ("four_bar", "double_pendulum") for method in ("relative, Gauss", "relative")
    ]
    assert all(len(one.times) == 1 for one in motions)


def test_a_motion_by_series_compiles_no_derivative():
    """Compilation takes a first run most of its time, and Taylor's method asks the mechanism for no derivative."""
    code = (
        "from consilience.case import load_case\nfrom consilience.reference import simulate\n"
        "from consilience.reference.tree import system\ncase = load_case('double_pendulum')\n"
        "simulate(case.mechanism, case.initial_state, case.times[:2], formulation='relative')\n"
        "print(len(system.serve_states._compiled), len(system.serve._compiled))"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"}
    found = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["1", "0"]


@pytest.mark.parametrize(("name", "elements"), [("four_bar", False), ("adams_rot_spring", True), ("gear_pair", True)])
def test_kernels_of_space_have_no_elements_where_the_mechanism_has_none(name, elements):
    arrays = prepare(load_case(name).mechanism, in_space=True).tree_system
    assert (system_record(arrays, tree_alone=False).elements is not None) == elements


def test_a_kernel_is_compiled_by_one_process_at_a_time(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    entered = []

    def another():
        with one_process("kernel"):
            entered.append("another")

    with one_process("kernel"):
        (file,) = kernels_folder().iterdir()
        with file.open("w") as lock, pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        thread = Thread(target=another)
        thread.start()
        with one_process("another kernel"):
            entered.append("first")
    thread.join()
    assert entered == ["first", "another"]


def test_a_folder_that_cannot_be_made_has_no_locks(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    (tmp_path / "file").touch()
    with one_process("kernel"):
        assert not kernels_folder().exists()


@pytest.mark.parametrize(("jobs", "warm", "beside"), [(2, False, 1), (2, True, 0), (1, False, 0)])
def test_a_suite_compiles_beside_only_where_it_has_two_processes_and_no_kernels(monkeypatch, jobs, warm, beside):
    entered = []

    @contextmanager
    def recorded(cases, limit, memory):
        entered.append([case.name for case in cases])
        yield

    monkeypatch.setattr(suite, "compiled", lambda: warm)
    monkeypatch.setattr(suite, "compiled_beside", recorded)
    cases = [load_case("simple_pendulum-small").with_span(0.1, None)]
    asked, given = [Question.TRAJECTORY], suite.Resources(jobs)
    results = suite.run_suite(cases, ["reference", "mujoco"], asked, given, thoroughness=QUICK)
    assert entered == [["simple_pendulum-small"]] * beside
    assert not results.missing
