"""What is read once, entry points and shipped cases, is read again when it changes."""

import sys

import pytest

from consilience.case import library
from consilience.engine import installed
from consilience.errors import InvalidInput


def test_an_adapter_installed_while_the_process_runs_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    assert "late" not in installed()
    folder = tmp_path / "late-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: late\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[consilience.engines]\nlate = late_engine:Engine\n")
    assert installed()["late"].value == "late_engine:Engine"
    installed().clear()
    assert "late" in installed()  # each caller has a dict of its own


def test_a_shipped_file_is_read_again_when_it_has_changed(tmp_path, monkeypatch):
    (source,) = [path for path in library.case_files() if path.stem == "double_pendulum"]
    copy = tmp_path / "group" / source.name
    copy.parent.mkdir()
    text = source.read_text()
    copy.write_text(text)
    monkeypatch.setattr(library, "case_folder", lambda: tmp_path)
    first = library.load_case("double_pendulum")
    assert library.load_case("double_pendulum") is first
    copy.write_text(text.replace(f'title = "{first.title}"', 'title = "Another title"'))
    assert library.load_case("double_pendulum").title == "Another title"
    copy.write_text("no case")
    with pytest.raises(InvalidInput):
        library.load_case("double_pendulum")
