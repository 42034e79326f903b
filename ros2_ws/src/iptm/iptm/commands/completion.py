"""Print the tab completion of `iptm` for bash: ``source <(iptm completion)``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from iptm.commands.run import build_parser
from iptm.commands.tree import all_commands
from iptm_core.program import EXIT_OK

_SCRIPT = """\
_iptm() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}"
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{commands} --version --help" -- "$word"))
    elif [ "${{COMP_WORDS[1]}}" = run ] && [[ "$word" == -* ]]; then
        COMPREPLY=($(compgen -W "{options}" -- "$word"))
    elif [ "${{COMP_WORDS[COMP_CWORD-1]}}" = --set ]; then
        COMPREPLY=($(compgen -W "{settings}" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
    fi
}}
complete -F _iptm iptm scripts/iptm
"""


def main(arguments: Sequence[str] | None = None) -> int:  # noqa: ARG001
    """Print the script; returns 0."""
    from iptm.trip_settings import HOME  # noqa: PLC0415  takes a moment

    options = [name for action in build_parser()._actions for name in action.option_strings]  # noqa: SLF001
    settings = [f"{group}.{name}=" for name, group in HOME.items()]
    listed = {"commands": all_commands(), "options": options, "settings": settings}
    print(_SCRIPT.format(**{key: " ".join(names) for key, names in listed.items()}))
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
