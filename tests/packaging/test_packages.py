"""package.xml and setup.py of each package are sound, agree, and name what the package imports."""

import configparser
import importlib.util
import re
import sys
from collections.abc import Iterable
from fnmatch import fnmatch
from pathlib import Path

import pytest
from tests.packaging.packages import (
    EXTRAS,
    FOLDERS,
    PACKAGES,
    ROOT,
    Module,
    launch_files_of,
    manifest_of,
    modules_of,
    setup_of,
)

from iptm_core.program import PROGRAMS

# Import name -> (key in package.xml, name on the package index). ROS packages are their own key.
LIBRARIES = {
    "asn1tools": ("python3-asn1tools-pip", "asn1tools"),
    "casadi": ("casadi-pip", "casadi"),
    "gymnasium": ("python3-gymnasium-pip", "gymnasium"),
    "jinja2": ("python3-jinja2", "jinja2"),
    "markupsafe": ("python3-jinja2", "jinja2"),  # comes with it
    "lz4": ("python3-lz4", "lz4"),
    "matplotlib": ("python3-matplotlib", "matplotlib"),
    "mcap": ("python3-mcap-pip", "mcap"),
    "numpy": ("python3-numpy", "numpy"),
    "pandas": ("python3-pandas", "pandas"),
    "pyarrow": ("python3-pyarrow-pip", "pyarrow"),
    "rich": ("python3-rich", "rich"),
    "rosbags": ("python3-rosbags-pip", "rosbags"),
    "scipy": ("python3-scipy", "scipy"),
    "yaml": ("python3-yaml", "pyyaml"),
    "zstandard": ("python3-zstandard-pip", "zstandard"),
}


def outside_imports(package: str, modules: Iterable[Module]) -> dict[str, str]:
    """Top-level names imported from outside the standard library and the package, with one importer each."""
    found: dict[str, str] = {}
    for module in modules:
        for name in module.imports:
            top = name.split(".")[0]
            if top and top != package and top not in sys.stdlib_module_names:
                found[top] = module.name
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_is_complete_and_setup_agrees_with_it(package: str) -> None:
    manifest, setup = manifest_of(package), setup_of(package)
    assert manifest.get("format") == "3"
    assert setup["name"] == manifest.findtext("name") == package
    assert setup["version"] == manifest.findtext("version")
    assert len(manifest.findtext("description", "").split()) >= 5
    assert setup["license"] == manifest.findtext("license") == "Apache-2.0"
    assert manifest.findtext("export/build_type") == "ament_python"
    # A malformed address silently drops the package's ament hooks from a colcon build.
    (maintainer,) = manifest.findall("maintainer")
    assert re.fullmatch(r"[\w.+-]+@[\w-]+(\.[\w-]+)+", maintainer.get("email", ""))
    assert setup["maintainer"] == maintainer.text
    assert setup["maintainer_email"] == maintainer.get("email")
    assert setup["extras_require"]["test"]
    installed = {(folder, name) for folder, names in setup["data_files"] for name in names}
    assert ("share/ament_index/resource_index/packages", f"resource/{package}") in installed
    assert (f"share/{package}", "package.xml") in installed
    for _, name in installed:
        assert (FOLDERS[package] / name).is_file(), f"{package}/setup.py installs {name}"


def test_one_version_and_one_maintainer() -> None:
    manifests = [manifest_of(package) for package in PACKAGES]
    assert len({manifest.findtext("version") for manifest in manifests}) == 1
    assert len({manifest.find("maintainer").get("email") for manifest in manifests}) == 1


@pytest.mark.parametrize("package", PACKAGES)
def test_everything_is_installed(package: str) -> None:
    """Each folder with Python in it is a package that is installed, and so is each data file."""
    setup = setup_of(package)
    code = FOLDERS[package] / package
    files = [
        path.relative_to(code.parent)
        for path in code.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    with_python = {".".join(path.parent.parts) for path in files if path.suffix == ".py"}
    assert set(setup["packages"]) == with_python, (
        "a folder lacks __init__.py or is not found by setup.py"
    )

    patterns = [
        str(Path(*name.split("."), pattern))
        for name, globs in setup["package_data"].items()
        for pattern in globs
    ]
    # `**` in package_data also stands for no folder at all.
    patterns += [pattern.replace("**/", "") for pattern in patterns]
    left_out = [
        str(path)
        for path in files
        if path.suffix != ".py" and not any(fnmatch(str(path), pattern) for pattern in patterns)
    ]
    assert left_out == [], f"package_data in {package}/setup.py does not name {left_out}"
    assert (code / "py.typed").is_file()


@pytest.mark.parametrize("package", PACKAGES)
def test_executables_exist(package: str) -> None:
    entry_points = setup_of(package).get("entry_points", {})
    programs = [line.split(" = ") for line in entry_points.get(PROGRAMS, [])]
    # Each starts at a module that reports a missing library in one line.
    assert entry_points.get("console_scripts", []) == [
        f"{executable} = iptm_core.program:main" for executable, _ in programs
    ]
    for executable, target in programs:
        module, function = target.split(":")
        spec = importlib.util.find_spec(module)
        assert spec is not None, f"executable {executable}: no module {module}"
        assert spec.origin is not None
        source = Path(spec.origin).read_text(encoding="utf-8")
        assert f"def {function}(" in source, (
            f"executable {executable}: {module} has no {function}()"
        )
    config = (FOLDERS[package] / "setup.cfg").read_text(encoding="utf-8")
    # `ros2 run` looks for executables in lib/<package>.
    assert f"script_dir=$base/lib/{package}\n" in config
    assert f"install_scripts=$base/lib/{package}\n" in config


def test_no_two_executables_have_one_name() -> None:
    lines = [
        line
        for package in PACKAGES
        for line in setup_of(package).get("entry_points", {}).get(PROGRAMS, [])
    ]
    names = [line.split(" = ")[0] for line in lines]
    assert len(set(names)) == len(names) > 0


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_names_exactly_what_is_imported(package: str) -> None:
    imported = outside_imports(package, [*modules_of(package), *launch_files_of(package)])
    needed = {LIBRARIES.get(name, (name,))[0]: name for name in imported}
    needed |= {"ros2launch": "its launch files"} if launch_files_of(package) else {}
    manifest = manifest_of(package)
    declared = {entry.text for entry in manifest.findall("exec_depend")}
    # A package that starts another one's executables needs it without importing it.
    started = {name for name in declared if name in PACKAGES} if package == "iptm.runner" else set()
    lacking = [
        f"{key} (imported by {imported[name]})"
        for key, name in needed.items()
        if key not in declared
    ]
    assert lacking == [], f"{package}/package.xml lacks exec_depend on {lacking}"
    assert declared - started - set(needed) == set(), (
        f"{package}/package.xml names what is never imported"
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_setup_requires_exactly_the_imported_libraries(package: str) -> None:
    imported = outside_imports(package, modules_of(package))
    needed = {LIBRARIES[name][1] for name in imported if name in LIBRARIES}
    required = {
        re.split(r"[^\w-]", line)[0].lower() for line in setup_of(package)["install_requires"]
    }
    assert required - {"setuptools"} == needed


@pytest.mark.parametrize("package", PACKAGES)
def test_colcon_test_runs_the_tests_of_the_package(package: str) -> None:
    """`colcon test` starts pytest with the test folder that `setup.cfg` of the package names."""
    settings = configparser.ConfigParser()
    settings.read(FOLDERS[package] / "setup.cfg")
    (folder,) = settings["tool:pytest"]["testpaths"].split()
    tests = ROOT / "tests" / ("extras" if package in EXTRAS else "") / package
    assert (FOLDERS[package] / folder).resolve() == tests
    assert (FOLDERS[package] / settings["tool:pytest"]["pythonpath"]).resolve() == ROOT
    assert list(tests.glob("test_*.py"))
