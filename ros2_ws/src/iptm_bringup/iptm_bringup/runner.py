"""One run with everything around it: folder, domain, processes, results, picture, exit code."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import rclpy
import yaml
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.text import Text

from iptm_bringup.comparison import NO_COMPARISON, drive_comparison
from iptm_bringup.composition import (
    RECORDER,
    Listeners,
    node_command,
    node_parameters,
    parameter_file_text,
    recorder_command,
    run_information,
    with_faults,
)
from iptm_bringup.drive import IMPOSSIBLE_GAP_M, Drive, DriveOutcome, DriveResult, unclean_ends
from iptm_bringup.environment import (
    RunDomain,
    domain_of_run,
    environment_of_run,
    process_environment,
)
from iptm_bringup.evaluation import evaluate, results_json
from iptm_bringup.monitor import RunMonitor
from iptm_bringup.process_faults import ProcessFaults
from iptm_bringup.progress import Progress, make_progress
from iptm_bringup.run_folder import RunFolder
from iptm_bringup.scenario import PreparedScenario
from iptm_bringup.supervisor import Supervisor
from iptm_bringup.tables import print_results
from iptm_bringup.viewer import live_view
from iptm_core.declaration import Scalar
from iptm_core.errors import IptmError
from iptm_core.program import EXIT_OK, EXIT_SIGNAL, EXIT_USER_ERROR
from iptm_interfaces.process import StopRequest
from iptm_interfaces.topics import CONTROLLER, PLANT, Topic
from iptm_recording.run_information import collect_run_information

EXIT_RUN_FAILED = 1
LOOK_AROUND_S = 2.0
"""Time to find others in a domain that the user chose; the controller takes as long to start."""


@dataclass(frozen=True)
class RunOptions:
    """Options of the user in addition to the scenario.

    Attributes:
        output: folder to create; None for a new one under ``bags/``.
        record: whether to record a bag.
        picture: whether to draw the run.
        report: whether to write it as an HTML page.
        compression: of the bag: none, lz4 or zstd.
        against: strategy to compare with, driven without ROS after the run; "none" for no comparison.
        view: whether to show it in the browser while it takes place.
        full: whether to print the tables of all figures.
    """

    output: Path | None = None
    record: bool = True
    picture: bool = True
    report: bool = False
    compression: str = "none"
    against: str = NO_COMPARISON
    view: bool = False
    full: bool = False


def run(prepared: PreparedScenario, options: RunOptions, console: Console, errors: Console) -> int:
    """Drive, record and report a scenario.

    Args:
        prepared: the scenario.
        options: output, recording, picture.
        console: for progress and results.
        errors: for what goes wrong.

    Returns:
        0 if the trip was finished, no hard limit was broken, and the bag is complete; 1 if not; 2 for a
        mistake of the user; 128 + n after signal n.

    Raises:
        ScenarioError: the output exists, or another run has the ROS domain.
    """
    stop = StopRequest()
    stop.install()
    scenario = prepared.scenario
    with ExitStack() as stack:
        domain = stack.enter_context(domain_of_run(scenario.domain, scenario.full_namespace))
        folder = RunFolder.of_run(options.output, scenario.name)
        console.print(_introduction(prepared, domain.number), soft_wrap=True)
        stay_open = None
        if options.view:
            environment = environment_of_run(domain.number, folder.logs / "ros")
            namespaces = [scenario.namespace]
            bags = [folder.output] if options.record else []
            view = live_view(
                folder.logs,
                environment,
                prepared,
                namespaces,
                bags,
                options.against,
                console,
                errors,
            )
            stay_open = stack.enter_context(view)
        progress = make_progress(console, prepared.route.duration_s)
        driven = drive_processes(folder, prepared, options, domain, progress, stop)
        result = driven.result
        if result.outcome is DriveOutcome.FINISHED:
            code = _report(folder, prepared, options, driven, console, errors)
        else:
            code = _report_failure(result, folder, stop, errors)
        if stay_open is not None and result.outcome is not DriveOutcome.REFUSED:
            stay_open(stop)
        return code


@dataclass(frozen=True, eq=False)
class Driven:
    """A run whose processes have all ended.

    Attributes:
        result: how it ended.
        monitor: received messages.
        supervisor: how the processes ended.
        process_faults: faults injected into the processes.
    """

    result: DriveResult
    monitor: RunMonitor
    supervisor: Supervisor
    process_faults: ProcessFaults


def drive_processes(
    folder: RunFolder,
    prepared: PreparedScenario,
    options: RunOptions,
    domain: RunDomain,
    progress: Progress,
    stop: StopRequest,
) -> Driven:
    """Start the processes of a scenario, watch the trip, and end them.

    Args:
        folder: for logs and parameter files, and the bag.
        prepared: the scenario.
        options: output and recording.
        domain: ROS domain of the run.
        progress: display of the progress.
        stop: set when the user requests a stop.
    """
    environment = environment_of_run(domain.number, folder.logs / "ros")
    supervisor = Supervisor(environment, folder.log_path)
    process_faults = ProcessFaults(supervisor, prepared.scenario.faults)

    with (
        process_environment(environment),  # the runner takes part in the graph itself
        _monitor(prepared.scenario.full_namespace, domain, prepared.foreign) as (monitor, executor),
        Drive(
            supervisor,
            monitor,
            executor,
            progress,
            stop,
            process_faults,
            foreign=prepared.foreign,
            duration_s=prepared.route.duration_s,
            # A fault may show another leader than the one that is followed.
            least_gap_m=-math.inf if prepared.scenario.faults else IMPOSSIBLE_GAP_M,
        ) as drive,
    ):
        start = _ProcessStarter(folder, prepared, options)
        drive.start(start.first())
        # A private domain has no other participants.
        result = drive.look_around(0.0 if domain.is_private else LOOK_AROUND_S)
        if result.outcome is DriveOutcome.FINISHED:
            drive.start(start.then(monitor))
            result = drive.run()
    return Driven(result, monitor, supervisor, process_faults)


class _ProcessStarter:
    """Writes the files that the processes need and gives the commands to start them."""

    def __init__(self, folder: RunFolder, prepared: PreparedScenario, options: RunOptions) -> None:
        self._folder = folder
        self._prepared = prepared
        self._options = options
        self._namespace = prepared.scenario.full_namespace
        self._faults = prepared.scenario.faults

    def first(self) -> dict[str, list[str]]:
        """Return the commands that do not depend on the listeners; they take longest to start."""
        parameters = self._parameters(Listeners(self._options.record))
        commands = {node: self._node(node, parameters) for node in parameters if node == CONTROLLER}
        if self._options.record:
            text = yaml.safe_dump(run_information(self._prepared, parameters), sort_keys=False)
            path = self._folder.write_log("run_information.yaml", text)
            # As the user wrote it: the recorder's diagnostics name it, and they go into the bag.
            commands[RECORDER] = recorder_command(
                self._folder.given, path, self._options.compression, self._namespace
            )
        return commands

    def then(self, monitor: RunMonitor) -> dict[str, list[str]]:
        """Return the commands of the nodes that need the number of listeners."""
        listeners = Listeners(
            self._options.record,
            foreign_to_state=monitor.foreign_listeners(Topic.PLANT_ODOMETRY, Topic.CLOCK),
            foreign_to_preview=monitor.foreign_listeners(Topic.LEADER, Topic.LEADER_PREVIEW),
            without=self._prepared.foreign,
        )
        parameters = self._parameters(listeners)
        nodes = [node for node in parameters if node != CONTROLLER]
        return {node: self._node(node, parameters) for node in nodes}

    def _parameters(self, listeners: Listeners) -> dict[str, dict[str, Scalar]]:
        """Return the parameters of the nodes that are started here."""
        parameters = with_faults(node_parameters(self._prepared, listeners), self._faults)
        return {
            node: values
            for node, values in parameters.items()
            if node not in self._prepared.foreign
        }

    def _node(self, node: str, parameters: Mapping[str, Mapping[str, Scalar]]) -> list[str]:
        text = parameter_file_text(node, parameters[node])
        path = self._folder.write_log(f"{node}_parameters.yaml", text)
        return node_command(node, path, self._namespace, self._faults)


@contextmanager
def _monitor(
    namespace: str, domain: RunDomain, foreign: frozenset[str]
) -> Iterator[tuple[RunMonitor, EventsExecutor]]:
    context = Context()
    rclpy.init(
        args=[],
        context=context,
        domain_id=domain.number,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        monitor = RunMonitor(namespace, context, foreign)
        executor = EventsExecutor(context=context)
        executor.add_node(monitor)
        try:
            yield monitor, executor
        finally:
            executor.remove_node(monitor)
            monitor.destroy_node()
            executor.shutdown()
    finally:
        context.try_shutdown()


def _report(
    folder: RunFolder,
    prepared: PreparedScenario,
    options: RunOptions,
    driven: Driven,
    console: Console,
    errors: Console,
) -> int:
    """Evaluate a finished trip, write its files and print its tables."""
    unclean = unclean_ends(driven.supervisor, driven.process_faults)
    try:
        results = evaluate(
            prepared,
            driven.monitor.recorded,
            folder.output if options.record else None,
            collect_run_information(),
            driven.result.wall_time_s,
            unclean,
            tuple(driven.monitor.warnings),
        )
        # The reference would drive the plant of the suite, not the user's.
        if options.against != NO_COMPARISON and PLANT not in prepared.foreign:
            with console.status(f"driving the same trip with strategy {options.against} ..."):
                comparison = drive_comparison(prepared, options.against)
            results = replace(results, comparison=comparison)
    except IptmError as error:
        text = "; ".join((str(error), *unclean))
        errors.print(f"run_closed_loop: {text}", markup=False, highlight=False, soft_wrap=True)
        return EXIT_RUN_FAILED
    if results.comparison is not None:
        results.comparison.save(folder.reference, prepared.heading)
    folder.results.write_text(results_json(results), encoding="utf-8")
    if options.picture or options.report:
        # Loaded only now: it takes half a second that the nodes can use better.
        from iptm_bringup.picture import save_picture, save_report  # noqa: PLC0415

        if options.picture:
            save_picture(folder.picture, results)
        if options.report:
            save_report(folder.report, results)
    print_results(results, folder, console, full=options.full)
    return EXIT_RUN_FAILED if results.problems else EXIT_OK


def _report_failure(
    result: DriveResult, folder: RunFolder, stop: StopRequest, errors: Console
) -> int:
    if result.outcome is DriveOutcome.REFUSED:
        folder.discard()
        errors.print(
            f"run_closed_loop: {result.message}", markup=False, highlight=False, soft_wrap=True
        )
        return EXIT_USER_ERROR
    lines = [f"run_closed_loop: {result.message}", *(f"    {line}" for line in result.last_lines)]
    lines.append(f"logs: {folder.logs}")
    errors.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
    if result.outcome is DriveOutcome.INTERRUPTED and stop.number is not None:
        return EXIT_SIGNAL + int(stop.number)
    return EXIT_RUN_FAILED


def _introduction(prepared: PreparedScenario, domain: int) -> Text:
    without = prepared.foreign
    purpose = f"waiting for your own {', '.join(sorted(without))}" if without else "to watch"
    watch = (f"\n{purpose}: export ROS_DOMAIN_ID={domain}", "dim")
    return Text.assemble((prepared.heading, "bold"), watch)
