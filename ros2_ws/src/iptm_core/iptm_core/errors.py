"""The one exception family of the project.

Everything that a user can get wrong (a file, a parameter, a message, a bag, a scenario) ends in one of
these, with a message that gives the cause, the value, and the allowed values. Solver outcomes and
late or missing messages are not errors but data, and never raise.
"""


class IptmError(Exception):
    """Base of every error that the project raises on purpose."""


class ParameterError(IptmError):
    """A model, node or strategy parameter is unknown, of the wrong type or outside its range."""


class RouteError(IptmError):
    """A driving cycle, slope profile or user route file is malformed or inconsistent."""


class StateError(IptmError):
    """A measured or initial state is not finite or outside its physical range."""


class PackEmptyError(IptmError):
    """The pack has no charge left to go on with a trip."""


class PowerLimitError(IptmError):
    """More power is asked from the pack than its open-circuit voltage and resistance can deliver."""


class MessageError(IptmError):
    """A received ROS message does not carry what the topic table promises."""


class BagError(IptmError):
    """A recorded bag is missing, truncated, foreign or lacks a topic."""


class MissingTopicError(BagError):
    """A bag lacks a topic."""


class ScenarioError(IptmError):
    """The description of a trip or study is malformed."""


class DriveError(IptmError):
    """A trip over ROS 2 did not come to its end."""


class ServiceError(IptmError):
    """A service is asked for what cannot be done now."""


class StoreError(IptmError):
    """A stored study result is missing or damaged, or the store cannot be written."""


class SolverSetupError(IptmError):
    """An optimal control problem or its solver cannot be built as asked."""


class ViewError(IptmError):
    """The live view cannot be shown as asked: a port is taken, or a library or a browser is missing."""


class MeasurementError(IptmError):
    """A file of measured data is missing, damaged or lacks a column."""
