"""Notebooks of the documentation run from top to bottom in a kernel of Jupyter, and show what they speak of."""

from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"

SHOWN = {
    "first_comparison": ("<svg", "<td>✓ 1", "<td>≈ 3", "differs: discretisation"),
    "your_own_mechanism": ("<svg", "<iframe srcdoc=", "image/png", "✓"),
    "formulations_side_by_side": ("<svg", "descriptor_euler_angles", "image/png"),
    "finding_a_defect": ("body.lower.inertia[0,2]    0.9",),
    "parameter_study": ("1000 motions of &#x27;double_pendulum&#x27;", "image/png", "xarray.DataArray"),
}
"""What the outputs hold, by notebook. The planted product of inertia explains nine tenths of the difference or more."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_runs_and_shows_what_it_speaks_of(name, tmp_path):
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code), "outputs are not kept"
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    found = [output for cell in code for output in cell.outputs]
    assert not any(output.output_type == "error" for output in found)
    shown = "\n".join(f"{kind}: {text}" for output in found for kind, text in output.get("data", {}).items())
    assert [part for part in SHOWN[name] if part not in shown] == []


def test_every_notebook_is_run():
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(SHOWN)
