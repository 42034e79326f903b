# Shared by the commands in scripts/; sourced, never run. Needs bash.
#
# Gives: iptm_say, iptm_die, iptm_help, iptm_ready, iptm_prepare, iptm_module, iptm_start.
# shellcheck shell=bash disable=SC2119,SC2120

IPTM_ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd -P)"

iptm_say() { printf 'iptm: %s\n' "$*" >&2; }

iptm_die() {
    iptm_say "$*"
    exit 1
}

# Print the comment at the head of the calling script: its usage text has one home.
iptm_help() { sed -n -e '1d' -e '/^#/!q' -e 's/^# \{0,1\}//p' "$0"; }

# True when the arguments ask for help (up to "--", behind which they belong to someone else).
iptm_wants_help() {
    local argument
    for argument in "$@"; do
        case "$argument" in
            -h | --help) return 0 ;;
            --) return 1 ;;
        esac
    done
    return 1
}

# True when the environment is complete; installs nothing.
iptm_ready() { "$IPTM_ROOT/scripts/setup" --check; }

# Make the environment (instant when it is there), then enter it. Arguments go to scripts/setup.
iptm_prepare() {
    "$IPTM_ROOT/scripts/setup" "$@" || exit $?
    # shellcheck source=scripts/env.sh
    source "$IPTM_ROOT/scripts/env.sh"
}

# iptm_module MODULE ARGUMENTS...: run the program MODULE in the environment, in place of this shell.
# A call for help prints the script's own text first, and installs nothing to do so.
iptm_module() {
    local module="$1"
    shift
    if iptm_wants_help "$@"; then
        iptm_help
        if ! iptm_ready; then
            echo
            echo "The options of $module are listed here too once scripts/setup has run."
            exit 0
        fi
        echo
    fi
    iptm_start "$module" "$@"
}

# iptm_start MODULE ARGUMENTS...: the same without the script's own text.
iptm_start() {
    iptm_prepare
    # A file of the current folder must not take the place of a library's (Python 3.11 on; see iptm_core/__main__.py).
    export PYTHONSAFEPATH=1
    # Ctrl-C is held back until iptm_core can take it: Python itself would answer with a traceback.
    local -a start=()
    ! env --block-signal=INT true 2> /dev/null || start=(env --block-signal=INT)
    exec "${start[@]}" "$IPTM_ROOT/.venv/bin/python" -m iptm_core "$@"
}
