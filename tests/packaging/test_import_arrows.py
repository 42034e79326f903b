"""The arrows of the architecture: allowed imports between packages, and packages free of ROS."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from tests.packaging.packages import EXTRAS, FOLDERS, PACKAGES, ROOT, SOURCE, modules_of

# Package -> the packages of this project that its modules may import.
ALLOWED = {
    "iptm_core": set(),
    "iptm_ros": {"iptm_core"},
    "iptm_plant_sim": {"iptm_core", "iptm_ros"},
    "iptm_v2x_bridge": {"iptm_core", "iptm_ros"},
    "iptm_controller": {"iptm_core", "iptm_ros"},
    "iptm": {
        "iptm_core",
        "iptm_ros",
        "iptm_plant_sim",
        "iptm_v2x_bridge",
        "iptm_controller",
    },
}
CORE = sorted(set(ALLOWED))
# An extra may import all of the core, and the extras that its package.xml names (test_packages.py).
ALLOWED |= {extra: set(PACKAGES) for extra in EXTRAS}

# All of these run without ROS, but for the node modules of those that have one.
PURE = {
    "iptm_core",
    "iptm_plant_sim",
    "iptm_v2x_bridge",
    "iptm_controller",
    "iptm.faults",
}
# So do these extras, where they are installed.
PURE |= {"iptm_drives", "iptm_its", "iptm_vehicle_interface", "iptm_traffic"} & set(EXTRAS)

# Nodes with faults inside are the nodes themselves but for that; the table of faults shows what the
# controller node reports in trips without it. The sender stands where the
# bridge expects the leader at the start.
MAY_KNOW_THE_NODE_OF = {
    ("iptm_its.node_sender", "iptm_v2x_bridge"),
    ("iptm_faults.node_controller", "iptm_controller"),
    ("iptm_faults.node_plant", "iptm_plant_sim"),
    ("iptm.runner.one_process", "iptm_controller"),
    ("iptm.runner.one_process", "iptm_plant_sim"),
    ("iptm.runner.one_process", "iptm_v2x_bridge"),
}

ROS = {
    "rclpy",
    "ament_index_python",
    "launch",
    "launch_ros",
    "rcl_interfaces",
    "builtin_interfaces",
}


def is_ros(top: str) -> bool:
    return top in ROS or top.endswith(("_msgs", "_srvs"))


def our_packages(imports: frozenset[str]) -> set[str]:
    return {top for name in imports if (top := name.split(".")[0]) in ALLOWED}


def test_no_package_is_forgotten() -> None:
    assert set(PACKAGES) == set(ALLOWED)


@pytest.mark.parametrize("package", CORE)
def test_the_core_neither_imports_nor_names_an_extra(package: str) -> None:
    extra = re.compile(rf"\b({'|'.join(EXTRAS)})\b")
    named = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in FOLDERS[package].rglob("*")
        if path.suffix in {".py", ".xml", ".yaml"}
        for name in extra.findall(path.read_text(encoding="utf-8"))
    ]
    assert named == []


@pytest.mark.parametrize("package", ALLOWED)
def test_imports_follow_the_arrows(package: str) -> None:
    for module in modules_of(package):
        against = our_packages(module.imports) - {package} - ALLOWED[package]
        assert against == set(), f"{module.name} must not import {against}"


@pytest.mark.parametrize("package", sorted(PURE))
def test_pure_parts_know_no_ros(package: str) -> None:
    for module in modules_of(package.split(".", maxsplit=1)[0]):
        if module.is_node or not f"{module.name}.".startswith(f"{package}."):
            continue
        ros = {name for name in module.imports if is_ros(name.split(".")[0])}
        assert ros == set(), f"{module.name} must run without ROS, but imports {ros}"
        # The interfaces import rclpy and the recording uses them, so a pure part cannot use them either.
        assert our_packages(module.imports).isdisjoint({"iptm_ros"}), (
            f"{module.name} imports what needs ROS"
        )


@pytest.mark.parametrize("package", ALLOWED)
def test_nodes_meet_only_in_messages(package: str) -> None:
    """Only node modules of the same package import a node module."""
    for module in modules_of(package):
        for name in module.imports:
            owner, _, rest = name.partition(".")
            if (
                owner not in ALLOWED
                or owner == "iptm_ros"
                or not re.match(r"(faults\.)?node(_\w+)?(\.|$)", rest)
            ):
                continue
            if (module.name, owner) in MAY_KNOW_THE_NODE_OF:
                continue
            assert owner == package, f"{module.name} imports the inside of a node: {name}"
            assert module.is_node, f"the pure {module.name} imports {name}"


@pytest.mark.parametrize("package", ALLOWED)
def test_no_folder_imports_itself_through_others(package: str) -> None:
    """What a folder needs from the rest of its package must not need the folder in turn."""
    needs = {module.name: module.imports for module in modules_of(package)}
    folders = {".".join(name.split(".")[:2]) for name in needs if name.count(".") > 1}
    for folder in folders:
        inside = {name for name in needs if f"{name}.".startswith(f"{folder}.")}
        outside = set().union(*(needs[name] for name in inside)) & (set(needs) - inside)
        while more := set().union(*(needs[name] for name in outside)) & set(needs) - outside:
            assert not more & inside, (
                f"{folder} needs {outside}, one of which needs {more & inside}"
            )
            outside |= more


def test_a_class_name_has_one_owner() -> None:
    owners: dict[str, list[str]] = {}
    for path in SOURCE.rglob("*.py"):
        if not {"build", "install"} & {*path.relative_to(SOURCE).parts}:
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.ClassDef):
                    owners.setdefault(node.name, []).append(str(path.relative_to(SOURCE)))
    assert {name: found for name, found in owners.items() if len(found) > 1} == {}


def imported(path: Path) -> set[str]:
    """Modules that a file imports at run time, inside functions, too."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse(path.read_text("utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
        waiting += ast.iter_child_nodes(node)
    return found


METHODS_OF_A_RUN = {"iptm.explanation", "iptm.repetition", "iptm.run_file"}
"""They drive or read runs; `iptm.run` imports each in the one method that needs it."""


def test_no_files_import_each_other_in_a_circle() -> None:
    paths = {
        module.name: FOLDERS[package] / Path(*module.name.split("."))
        for package in PACKAGES
        for module in modules_of(package)
    }
    graph = {
        name: imported(path / "__init__.py" if path.is_dir() else path.with_suffix(".py"))
        & (paths.keys() - {name, name.rpartition(".")[0]})
        for name, path in paths.items()
    }
    graph["iptm.run"] -= METHODS_OF_A_RUN
    TopologicalSorter(graph).prepare()
