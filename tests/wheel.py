"""The distribution, by hand and in CI: ``python tests/wheel.py [--tour PYTHON ...]``.

Builds the source distribution and, from it, the wheel; checks their metadata; compares its files with those
of the repository. With ``--tour``, installs the wheel with all engines in an empty environment of each Python that is
there, and runs the tour and a site of it from an empty folder.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]

PACKED = {
    "src/consilience/": "consilience/",
    "adapters/": "",
    "cases/": "consilience/cases/",
    "reports/findings/": "consilience/findings/",
}
"""Folders of the repository whose files are in the wheel, and where."""


def said(*command, folder=ROOT, codes=(0,)):
    """Return the output of a command, which must end with one of the exit codes."""
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode not in codes:
        raise SystemExit(f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def expected():
    """Names in the wheel of all files that git has, or is about to have."""
    files = said("git", "ls-files", "--cached", "--others", "--exclude-standard", *PACKED).splitlines()
    for file in files:
        folder = next(folder for folder in PACKED if file.startswith(folder))
        if (ROOT / file).is_file() and (folder != "adapters/" or file.count("/") > 1):
            yield PACKED[folder] + file.removeprefix(folder)


def built(folder):
    """Build, check and compare; return the wheel."""
    said(sys.executable, "-m", "build", "--outdir", folder, ROOT)
    print(said(sys.executable, "-m", "twine", "check", "--strict", *folder.iterdir()).strip())
    (wheel,) = folder.glob("*.whl")
    found = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    wanted = set(expected())
    if found != wanted:
        raise SystemExit(f"lacking: {sorted(wanted - found)}\ntoo much: {sorted(found - wanted)}")
    print(f"{wheel.name}: all {len(found)} files, {wheel.stat().st_size / 1e6:.1f} MB")
    return wheel


def tour(wheel, python, folder):
    """Install the wheel in an empty environment, and run the tour from an empty folder."""
    said(python, "-m", "venv", folder / "venv")
    own = folder / "venv" / "bin"
    said(own / "pip", "install", "--quiet", "-c", ROOT / "requirements.lock", f"{wheel}[engines]", folder=folder)
    version = said(own / "python", "--version").split()[1]
    said(own / "consilience", "run", "--tag", "tour", "-o", "report", folder=folder, codes=(0, 1))
    told = said(own / "consilience", "site", "report", "-o", "site", folder=folder)
    if not (folder / "site" / "index.html").is_file():
        raise SystemExit(f"Python {version}: there is no site\n{told}")
    print(f"Python {version}: {told.splitlines()[0]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tour", nargs="*", metavar="PYTHON", default=[], help="interpreters; absent ones are said")
    with tempfile.TemporaryDirectory() as place:
        wheel = built(Path(place) / "dist")
        for number, python in enumerate(parser.parse_args().tour):
            if found := shutil.which(python):
                folder = Path(place) / f"tour-{number}"
                folder.mkdir()
                tour(wheel, found, folder)
            else:
                print(f"{python} is not there")


if __name__ == "__main__":
    main()
