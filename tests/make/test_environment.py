"""The Makefile's environment: a broken or too old one is said with the command to type, and is mended afterwards."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from tests.packages import not_installed

ROOT = Path(__file__).parents[2]
MAKE_ENVIRONMENT, INSTALL = ROOT / "requirements" / "environment.sh", ROOT / "requirements" / "install.sh"
TOO_OLD = '#!/bin/sh\ncase "$1" in --version) echo Python 3.10.9;; *) exit 1;; esac\n'
NO_ENSUREPIP = f'#!/bin/sh\ncase "$2" in *ensurepip*) exit 1;; esac\nexec {sys.executable} "$@"\n'
NO_INDEX = (
    "#!/bin/sh\necho 'NewConnectionError: Failed to establish a new connection: Name or service not known'\nexit 1\n"
)

NOT_TRUSTED = (
    "#!/bin/sh\necho 'Max retries exceeded (Caused by SSLError(SSLCertVerificationError(1, "
    '"[SSL: CERTIFICATE_VERIFY_FAILED] certificate verify failed: self-signed certificate"\'\nexit 1\n'
)


def _script(path: Path, text: str) -> Path:
    path.write_text(text)
    path.chmod(0o755)
    return path


def _made(folder: Path, python: Path | str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["/bin/sh", str(MAKE_ENVIRONMENT), str(folder / "venv")],
        env={**os.environ, "PYTHON": str(python)}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def _typed(said: str) -> str:
    """Return the line that is to be typed, which a shell takes as it stands."""
    (typed,) = re.findall(r"-> type: (.*)", said)
    read = subprocess.run(["/bin/sh", "-n", "-c", typed], capture_output=True, text=True, check=False)
    assert read.returncode == 0, read.stderr
    return str(typed)


def test_a_python_that_is_too_old_is_named_with_the_command_that_brings_another(tmp_path: Path) -> None:
    made = _made(tmp_path, _script(tmp_path / "python3", TOO_OLD))
    assert made.returncode == 1
    assert "needs Python 3.11 to 3.13; found is Python 3.10.9" in made.stderr
    assert "apt-get install -y python3.11" in made.stderr
    assert not (tmp_path / "venv").exists()


def test_without_ensurepip_the_package_is_named_and_nothing_half_made_is_left(tmp_path: Path) -> None:
    made = _made(tmp_path, _script(tmp_path / "python3", NO_ENSUREPIP))
    assert made.returncode == 1
    version = ".".join(str(part) for part in sys.version_info[:2])
    assert f"apt-get install -y python{version}-venv" in made.stderr
    assert not (tmp_path / "venv").exists()


@pytest.mark.parametrize(
    ("name", "text", "packages"),
    [
        ("absent", None, "python3-venv"), ("python3", TOO_OLD, "python3.11 python3.11-venv"),
        ("python3", TOO_OLD.replace("3.10.9", "3.14.0"), "python3.13 python3.13-venv"),
    ],
)  # fmt: skip
def test_what_brings_another_python_is_pasted_as_it_stands(
    tmp_path: Path, name: str, text: str | None, packages: str
) -> None:
    python = tmp_path / name if text is None else _script(tmp_path / name, text)
    typed = _typed(_made(tmp_path, python).stderr)
    assert re.sub("sudo ", "", typed) == f"apt-get update && apt-get install -y {packages}"


def test_a_wheel_is_for_the_same_pythons_as_the_makefile() -> None:
    (low, high), *_ = re.findall(
        r"\(3, (\d+)\) <= sys.version_info\[:2\] <= \(3, (\d+)\)", MAKE_ENVIRONMENT.read_text()
    )
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == f">=3.{low},<3.{int(high) + 1}"
    assert f"(3, {low}) <= sys.version_info[:2] <= (3, {high})" in (ROOT / "Makefile").read_text()
    told = {one.rpartition(" ")[2] for one in project["classifiers"] if "Python :: 3." in one}
    assert told == {f"3.{minor}" for minor in range(int(low), int(high) + 1)}


def test_what_only_tests_need_is_said_as_a_line_that_is_pasted_as_it_stands() -> None:
    typed = _typed(not_installed("chromium"))
    assert re.sub("sudo ", "", typed) == "apt-get update && apt-get install -y chromium"
    other = re.compile(r"\bapt(?:-get)? install\b")
    said_otherwise = [
        file for file in (ROOT / "tests").rglob("*.py")
        if file.name not in ("packages.py", Path(__file__).name)
        and any(other.search(line) and "apt-get install -y" not in line for line in file.read_text().splitlines())
    ]  # fmt: skip
    assert said_otherwise == []


def test_the_systems_own_python_lacks_the_package_that_the_readme_names(tmp_path: Path) -> None:
    _script(tmp_path / "python3", NO_ENSUREPIP)
    made = subprocess.run(
        ["/bin/sh", str(MAKE_ENVIRONMENT), str(tmp_path / "venv")],
        env={"PATH": f"{tmp_path}:{os.environ['PATH']}"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert _typed(made.stderr).endswith("apt-get install -y python3-venv")
    assert "apt-get update && apt-get install -y python3-venv" in (ROOT / "README.md").read_text()


@pytest.mark.parametrize("left", ["an empty folder", "a Python that is gone", "no pip"])
def test_what_was_left_half_made_is_made_anew(tmp_path: Path, left: str) -> None:
    venv = tmp_path / "venv"
    if left == "an empty folder":
        venv.mkdir()
    else:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True)
    if left == "a Python that is gone":
        for python in (venv / "bin").glob("python*"):
            python.unlink()
        (venv / "bin" / "python").symlink_to(tmp_path / "gone")
    made = _made(tmp_path, sys.executable)
    assert made.returncode == 0, made.stderr
    assert "it is made anew" in made.stdout
    assert subprocess.run([venv / "bin" / "python", "-m", "pip", "--version"], check=False).returncode == 0
    again = _made(tmp_path, sys.executable)
    assert (again.returncode, again.stdout) == (0, ""), "a good one is left alone"


@pytest.mark.parametrize(
    ("trouble", "told"),
    [
        (NO_INDEX, "look at cable, name server and proxy first"), (NOT_TRUSTED, "export PIP_CERT="),
        (NO_INDEX.replace("NewConnectionError", "No space left"), "df -h"), (TOO_OLD, "make clean"),
    ],
)  # fmt: skip
def test_an_index_that_cannot_be_reached_is_told_with_what_to_do(tmp_path: Path, trouble: str, told: str) -> None:
    pip = _script(tmp_path / "python", trouble)
    said = subprocess.run(["/bin/sh", str(INSTALL), str(pip), "-r", "x"], capture_output=True, text=True, check=False)
    assert said.returncode == 1
    assert told in said.stderr
    assert _typed(said.stderr)


def test_while_pip_is_silent_a_line_says_that_it_goes_on(tmp_path: Path) -> None:
    """Minutes without a word look like a hang."""
    waits = f"#!/bin/sh\necho Collecting numpy\nwhile [ ! -e {tmp_path}/seen ]; do sleep 0.05; done\n"
    pip = _script(tmp_path / "python", f"{waits}echo Successfully installed numpy\n")
    with subprocess.Popen(
        ["/bin/sh", str(INSTALL), str(pip), "-r", "x"], stdout=subprocess.PIPE, text=True,
        env={**os.environ, "EVERY_S": "0.1"},
    ) as installing:  # fmt: skip
        assert installing.stdout is not None
        told = next(line for line in installing.stdout if "Collecting numpy" in line)
        (tmp_path / "seen").touch()
        *_, last = installing.stdout
    assert told.startswith("make: pip goes on, ")
    assert (last, installing.returncode) == ("Successfully installed numpy\n", 0)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP])
def test_told_to_end_it_ends_pip_and_leaves_no_file(tmp_path: Path, how: signal.Signals) -> None:
    pip = _script(tmp_path / "python", f"#!/bin/sh\necho $$ >{tmp_path}/pid\nexec sleep 600\n")
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    # Of a run that was started by nohup a shell could not catch it: what is ignored at its start stays so.
    before = signal.signal(how, signal.SIG_DFL)
    try:
        installing = subprocess.Popen(
            ["/bin/sh", str(INSTALL), str(pip), "-r", "x"],
            env={**os.environ, "TMPDIR": str(temporary), "EVERY_S": "0.1"}, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
    finally:
        signal.signal(how, before)
    with installing:
        try:
            assert installing.stdout is not None
            next(line for line in installing.stdout if (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
            installing.send_signal(how)
            assert installing.wait(60.0) == 128 + signal.SIGTERM
        finally:
            installing.kill()
    with pytest.raises(ProcessLookupError):  # noqa: PT012  # asked until it is gone
        while True:
            os.kill(int((tmp_path / "pid").read_text()), 0)
            time.sleep(0.02)
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("lacking", ["", "3.12 aarch64", "3.13 x86_64"])
def test_the_check_of_requirements_names_each_python_and_processor_that_cannot_have_them(
    tmp_path: Path, lacking: str
) -> None:
    """What is asked is: all hashes, wheels alone. Nothing is installed."""
    version, _, machine = lacking.partition(" ")
    asked_for = f"--python-version {version} --python-platform {machine}-"
    refuse = f'case "$*" in *"{asked_for}"*) echo "no wheel of it"; exit 1;; esac'
    asked = 'case "$*" in *--dry-run*--require-hashes*--only-binary*) ;; *) exit 1;; esac'
    uv = _script(tmp_path / "uv", f"#!/bin/sh\n{asked}\n{refuse if lacking else ''}\n")
    (tmp_path / "some.txt").touch()
    resolve = ["/bin/sh", str(INSTALL.with_name("resolve.sh")), str(uv), str(tmp_path / "some.txt")]
    done = subprocess.run(resolve, capture_output=True, text=True, check=False)
    assert done.returncode == (1 if lacking else 0)
    good = {line.removeprefix("some.txt: Python ").removesuffix(": good") for line in done.stdout.splitlines()}
    promised = {f"{python} on {cpu}" for python in ("3.11", "3.12", "3.13") for cpu in ("x86_64", "aarch64")}
    assert good == promised - {lacking.replace(" ", " on ")}
    if lacking:
        assert f"Python {version} on {machine}: cannot be had\n    no wheel of it" in done.stderr


def test_a_stamp_over_a_broken_environment_counts_no_longer(tmp_path: Path) -> None:
    """Make would think all is installed, and the command would fail with a traceback of Python's."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "requirements").mkdir()
    for name in ("dev.txt", "bench.txt"):
        (tmp_path / "requirements" / name).touch()
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / ".installed").touch()
    make = shutil.which("make")
    assert make is not None
    planned = subprocess.run([make, "-n", "lint"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert "requirements/environment.sh .venv" in planned
