"""Versions of MuJoCo that pip finds, and a release with a planted error: ``python tests/harness/release_campaign.py``.

The planted releases are the wheel of the last version under other numbers, with accelerations 0.1 % too large. `bisect`
must name the first, and the site of the reports, five versions at least, must show it in the history of the cell.
"""

import json
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

FIRST, LAST, PLANTED = "3.15.0", "4.0.0", ("4.0.0.post1", "4.0.0.post2", "4.0.0.post3")
CASE, ENGINE = "four_bar", "mujoco"
ERROR = """
_mj_forward = mj_forward
def mj_forward(model, data):
    _mj_forward(model, data)
    data.qacc *= 1.001
"""
PROGRAM = (sys.executable, "-c", "from consilience.cli.main import main; main()")


def said(*command, codes=(0,), **options):
    """Return the output of a command, which must end with one of the exit codes."""
    done = subprocess.run([*map(str, command)], stdout=subprocess.PIPE, text=True, check=False, **options)
    assert done.returncode in codes, f"{command}: exit code {done.returncode}\n{done.stdout}"
    return done.stdout


def plant(source, version):
    """Write the wheel of a version with the planted error, under another number."""
    target = source.with_name(source.name.replace(LAST, version, 1))
    folder = f"mujoco-{LAST}.dist-info"
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as new:
        for info in old.infolist():
            content = old.read(info)
            if info.filename == f"{folder}/METADATA":
                content = content.replace(f"\nVersion: {LAST}\n".encode(), f"\nVersion: {version}\n".encode())
            elif info.filename == f"{folder}/RECORD":
                content = b""  # its digests are those of the files as they were
            elif info.filename == "mujoco/__init__.py":
                content += f"{ERROR}__version__ = '{version}'\n".encode()
            new.writestr(info.filename.replace(folder, f"mujoco-{version}.dist-info"), content)


def main():
    with tempfile.TemporaryDirectory() as name:
        room = Path(name)
        said(sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", room / "wheels", f"mujoco=={LAST}")
        (wheel,) = (room / "wheels").iterdir()
        for version in PLANTED:
            plant(wheel, version)
        links = f"{os.environ.get('PIP_FIND_LINKS', '')} {room / 'wheels'}"
        env = os.environ | {"XDG_CACHE_HOME": str(room / "cache"), "PIP_FIND_LINKS": links}
        asked = ("bisect", CASE, "-e", f"{ENGINE}@{FIRST}..{PLANTED[-1]}", "-q", "instant", "--quick", "-f", "json")
        found = json.loads(said(*PROGRAM, *asked, "-o", room / "reports", codes=(1,), env=env))
        print(json.dumps({name: found[name] for name in ("first_bad", "last_good", "changes")}, indent=1))
        assert (found["first_bad"], found["last_good"]) == (PLANTED[0], LAST)
        print(said(*PROGRAM, "site", room / "reports", "-o", room / "site", env=env))
        (cell,) = json.loads((room / "site" / "site.json").read_text())["cells"]
        verdicts = {point["version"]: point["model"] for point in cell["history"]}
        print(json.dumps(verdicts, indent=1))
        assert len(verdicts) >= 5
        assert {version for version, verdict in verdicts.items() if verdict != "agrees"} == set(PLANTED) & set(verdicts)
        assert (room / "site" / cell["address"] / "index.html").is_file()


if __name__ == "__main__":
    main()
