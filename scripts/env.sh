# Puts the current shell into the project's environment:
#
#     source scripts/env.sh
#
# Afterwards `python` is the project's own, and `python -m iptm_plant_sim.node --help` works from any folder.
# The commands in scripts/ do this by themselves. Existing values of ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE,
# OMP_NUM_THREADS and OPENBLAS_NUM_THREADS are kept.
# Works in bash and zsh, and leaves the shell's options alone.
# shellcheck shell=bash

_iptm_enter() {
    local root="$1" stamp venv mode entry modules
    venv="$root/.venv"
    stamp="$venv/iptm-setup.stamp"
    if [ ! -f "$stamp" ] || [ ! -x "$venv/bin/python" ]; then
        echo "iptm: the environment is not set up yet (or the set-up was interrupted). Run: $root/scripts/setup" >&2
        return 1
    fi
    mode="$(sed -n 's/^mode=//p' "$stamp")"
    if [ "$mode" = sourced ] && [ "${ROS_DISTRO:-}" != jazzy ]; then
        echo "iptm: .venv was made for a sourced ROS 2 Jazzy, but none is sourced." \
            "Source it, or run $root/scripts/setup to use ROS 2 from wheels." >&2
        return 1
    fi

    if [ "$mode" = wheels ]; then
        # Another ROS 2 (sourced by the user's shell) would be loaded in place of the wheels' own.
        if [ -n "${AMENT_PREFIX_PATH:-}" ] && [ "$AMENT_PREFIX_PATH" != "$venv" ]; then
            unset LD_LIBRARY_PATH
        fi
        unset ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION RMW_IMPLEMENTATION CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
        # The wheels restart Python once to find their libraries, unless this variable is set: it may have been
        # done by the Python of another environment.
        unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
        export AMENT_PREFIX_PATH="$venv"
        PYTHONPATH=""
    fi

    modules="${PYTHONPATH:-}"
    for entry in "$root"/ros2_ws/src/iptm* "$root"/ros2_ws/src/extras/*; do
        # IPTM_EXTRAS=none leaves out the extras, as on a machine that has none.
        [ -d "$entry" ] && [[ "${IPTM_EXTRAS:-} $entry" != none\ */extras/* ]] || continue
        case ":$modules:" in *":$entry:"*) ;; *) modules="$entry${modules:+:$modules}" ;; esac
    done
    # The studies are no package of the suite: the root itself, last.
    case ":$modules:" in *":$root:"*) ;; *) modules="$modules:$root" ;; esac
    export PYTHONPATH="$modules"
    unset PYTHONHOME
    # A notebook's ("!scripts/run_demo" in a cell) names a module of its own environment.
    unset MPLBACKEND

    case ":$PATH:" in *":$venv/bin:"*) ;; *) export PATH="$venv/bin:$PATH" ;; esac
    export IPTM_ROOT="$root"

    # Nodes of this machine only, by default: a demo must not drive a neighbour's plant. The nodes of the
    # suite take it from there (iptm_ros/discovery.py); for your own this is what ROS makes of it.
    export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
    # One solver thread per node: the vehicle computer has two cores for three nodes.
    export OMP_NUM_THREADS="${OMP_NUM_THREADS:-1}"
    export OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
}

if [ -n "${ZSH_VERSION:-}" ]; then
    eval '_iptm_file="${(%):-%x}"'
else
    _iptm_file="${BASH_SOURCE[0]}"
fi
# shellcheck disable=SC2154  # zsh's branch sets it in an eval
if _iptm_enter "$(cd "$(dirname "$_iptm_file")/.." && pwd -P)"; then
    unset _iptm_file
    unset -f _iptm_enter
else
    unset _iptm_file
    unset -f _iptm_enter
    # Under `set -e` of a script this ends it; an interactive shell just sees the failure.
    return 1
fi
