"""The first bad release of an engine whose versions pip finds: one changes the mass, one cannot be installed."""

import json
import os
import zipfile

import pytest

from consilience.cli.commands.bisect import versions_of
from consilience.cli.main import command_of
from consilience.errors import InvalidInput

FACTORS = {"1.9": 1.0, "1.10": 1.0, "2.0": 1.0, "2.1": 1.001, "3.0": 1.0}
"""Factor of the mass, by version: 1.10 comes after 1.9, and the mass has been wrong since 2.1."""

NOT_INSTALLABLE = "2.0"


def wheel(folder, version, factor):
    """Build a distribution of one module; one version needs what nobody has."""
    info = f"graded_engine-{version}.dist-info"
    needs = "Requires-Dist: graded-engine-lacks-this\n" if version == NOT_INSTALLABLE else ""
    files = {
        "graded_engine.py": f"VERSION = '{version}'\nFACTOR = {factor}\n",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: graded-engine\nVersion: {version}\n{needs}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/RECORD": "",
    }
    with zipfile.ZipFile(folder / f"graded_engine-{version}-py3-none-any.whl", "w") as file:
        for name, text in files.items():
            file.writestr(name, text)


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """A folder where pip finds all versions, and an empty cache of environments."""
    folder = tmp_path_factory.mktemp("published")
    for version, factor in FACTORS.items():
        wheel(folder, version, factor)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        patch.setenv("PIP_FIND_LINKS", f"{os.environ.get('PIP_FIND_LINKS', '')} {folder}")
        patch.setenv("UV_FIND_LINKS", str(folder))
        yield folder


def called(capsys, *words):
    code = command_of("bisect").main([*words], "bisect", standalone_mode=False)
    return code, capsys.readouterr().out


def test_the_planted_version_is_named_and_the_one_that_does_not_install_is_said(published, tmp_path, capsys):
    words = ("double_pendulum", "-e", "graded@1.9..2.1", "-q", "model", "-o", str(tmp_path), "-f", "json")
    code, told = called(capsys, *words)
    found = json.loads(told)
    assert code == 1
    assert (found["last_good"], found["first_bad"], found["not_asked_between"]) == ("1.10", "2.1", ["2.0"])
    (change,) = found["changes"]
    assert change["kind"] == "verdict"
    assert "mass" in change["why"]
    assert "graded-engine-lacks-this" in next(t["why"] for t in found["trials"] if t["version"] == "2.0")
    # a report of each version asked
    assert sorted(f.parent.name for f in tmp_path.glob("*/report.html")) == ["1.10", "1.9", "2.1"]


def test_a_range_without_a_version_is_answered_with_what_pip_finds(published):
    with pytest.raises(InvalidInput, match=r"pip finds no version from 4\.0 to 5\.0; it finds 1\.9 to 3\.0"):
        versions_of("graded@4.0..5.0")
    with pytest.raises(InvalidInput, match=r"Invalid version: 'new'; write a range such as"):
        versions_of("graded@1.9..new")
    with pytest.raises(InvalidInput, match="it is no range of versions"):
        versions_of("graded@1.9")
