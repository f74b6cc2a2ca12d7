# Commands of everyday work: `pip install rust-just`, then `just`. Each recipe is what CI or a page would have you type.

bin := env("VENV", ".venv") / "bin"
export OMP_NUM_THREADS := "1"

# list the recipes
default:
    @just --list --unsorted

# install everything into .venv with the locked versions, and the hooks of git where pre-commit is there
setup:
    test -d .venv || python3 -m venv .venv
    .venv/bin/pip install -q -c requirements.lock -e '.[slow,lint,docs]'
    if command -v pre-commit >/dev/null; then pre-commit install; fi

# all tests on all cores, or those given: `just test tests/unit/test_cli.py -x`
test *arguments:
    {{ bin }}/pytest -n auto {{ arguments }}

# tests of single modules, up to the first failure
quick *arguments:
    {{ bin }}/pytest -n auto -q -x tests/unit {{ arguments }}

# lay out all code
format:
    {{ bin }}/ruff format .

# lint
lint:
    {{ bin }}/ruff format --check .
    {{ bin }}/ruff check .

# check types
types:
    {{ bin }}/mypy

# the site, in build/site, with warnings as errors
docs:
    {{ bin }}/python -m sphinx -W --keep-going -q docs build/site

# execute every command and example of the documentation, or of the pages given
pages *pages:
    {{ bin }}/python tests/pages.py {{ pages }}

# speed beside the engines
bench *arguments:
    {{ bin }}/python tests/benchmarks {{ arguments }}

# long campaigns: planted errors, random mechanisms, hostile files and messages, suites killed at random
campaign:
    {{ bin }}/consilience mutate -o build/mutate
    {{ bin }}/consilience fuzz -n 500 -o build/fuzz
    for kind in cases extreme reports wire; do {{ bin }}/python tests/hostile/campaign.py --kind $kind --inputs 50000; done
    {{ bin }}/python tests/harness/contacts.py --mechanisms 300
    {{ bin }}/python tests/harness/kills.py --kills 200
    {{ bin }}/python tests/harness/false_verdicts.py --mechanisms 500
    {{ bin }}/python tests/harness/release_campaign.py

# the README's report, in report
report *arguments:
    {{ bin }}/consilience run --tag tour -o report {{ arguments }}

# ask all engines about the whole library in full, and keep the report in reports/agreement; goes on where it was stopped
agreement:
    {{ bin }}/consilience run -o build/agreement || [ $? -ne 2 ]
    {{ bin }}/python tests/agreement.py keep build/agreement

# build the distribution, and check that it is complete
wheel *arguments:
    {{ bin }}/pip install -q -c requirements.lock -e '.[release]'
    {{ bin }}/python tests/wheel.py {{ arguments }}

# install the wheel in an empty environment of each Python that is there, and run the tour from it
pythons: (wheel "--tour" "python3.11" "python3.12" "python3.13")

# freeze the list of cases as it is, in cases/edition-NAME.toml
edition name:
    test ! -e cases/edition-{{ name }}.toml
    mkdir -p build
    {{ bin }}/python -c "import datetime, consilience.case.editions as e; print(e.edition_text('{{ name }}', datetime.date.today()), end='')" > build/edition.toml
    mv build/edition.toml cases/edition-{{ name }}.toml

# draw the pictures of the README anew
pictures:
    {{ bin }}/consilience run --tag tour -o build/tour || [ $? -ne 2 ]
    {{ bin }}/python docs/draw_report.py build/tour
    {{ bin }}/python docs/draw_motion.py

# compile the kernels that the tests use
kernels:
    {{ bin }}/python tests/kernels.py

# delete all compiled kernels, those of earlier sources too
forget:
    rm -rf src/consilience/reference/kernel/__pycache__

# resolve all dependencies anew into requirements.lock (needs uv)
lock:
    uv pip compile -q pyproject.toml --all-extras --python-version 3.11 --universal --upgrade \
        --no-header --no-annotate --no-emit-index-url --no-emit-find-links -o requirements.lock
    sed -i '1i # Exact versions of every dependency, for CI and `just setup`; `just lock` writes this file anew.' requirements.lock

# everything that CI checks, from nothing
ci:
    .ci/run
