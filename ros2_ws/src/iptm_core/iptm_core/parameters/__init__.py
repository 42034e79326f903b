"""Parameters of the model: declared ranges, shipped sets with sources, loading and overrides."""

from iptm_core.parameters.flat import (
    Source,
    SourceTag,
    check_consistency,
    field_specs,
    flat_to_parameters,
    to_flat_dict,
)
from iptm_core.parameters.loading import (
    DEFAULT_SET,
    ParameterSet,
    available_parameter_sets,
    describe_parameters,
    load_parameters,
)
from iptm_core.parameters.model import ModelParameters

__all__ = [
    "DEFAULT_SET",
    "ModelParameters",
    "ParameterSet",
    "Source",
    "SourceTag",
    "available_parameter_sets",
    "check_consistency",
    "describe_parameters",
    "field_specs",
    "flat_to_parameters",
    "load_parameters",
    "to_flat_dict",
]
