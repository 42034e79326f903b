"""The README names commands and files that exist, and messages that are really printed."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_commands_and_links_exist() -> None:
    for command in set(re.findall(r"\bscripts/([\w.]+\w)", README)):
        assert (ROOT / "scripts" / command).is_file(), f"no scripts/{command}"
    for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", README):
        assert (ROOT / target).exists(), f"broken link to {target}"


def test_every_command_is_described() -> None:
    commands = {path.name for path in (ROOT / "scripts").iterdir() if path.is_file()}
    missing = {name for name in commands if f"scripts/{name}" not in README}
    assert missing == set(), f"the README does not mention {missing}"


def test_rosdep_skips_exactly_what_comes_with_pip() -> None:
    manifests = (ROOT / "ros2_ws" / "src").glob("*/package.xml")
    keys = {
        key
        for manifest in manifests
        for key in re.findall(r"<exec_depend>([\w-]+-pip)<", manifest.read_text(encoding="utf-8"))
    }
    skipped = re.search(r'--skip-keys "([^"]+)"', README)
    assert skipped is not None
    assert skipped[1].split() == sorted(keys)


def test_messages_of_the_troubleshooting_table_are_real() -> None:
    printed = " ".join(
        (ROOT / "scripts" / name).read_text(encoding="utf-8") for name in ("setup", "env.sh")
    )
    for message in (
        "found no ",
        "lacks the venv module (ensurepip)",
        "comes as wheels for Linux on x86-64 only",
        "the Python package index could not be reached",
        "is not the one in the lock",
        ".venv was made for a sourced ROS 2 Jazzy, but none is sourced",
        "another set-up of this folder is running",
        "cannot fetch a C compiler",
    ):
        assert message in printed, message
        assert message in README, message
