"""Parameters of the model: declared ranges, shipped sets with sources, loading and overrides."""

from iptm_core.parameters.flat import Source as Source
from iptm_core.parameters.flat import SourceTag as SourceTag
from iptm_core.parameters.flat import check_consistency as check_consistency
from iptm_core.parameters.flat import field_specs as field_specs
from iptm_core.parameters.flat import flat_to_parameters as flat_to_parameters
from iptm_core.parameters.flat import to_flat_dict as to_flat_dict
from iptm_core.parameters.loading import DEFAULT_SET as DEFAULT_SET
from iptm_core.parameters.loading import ParameterSet as ParameterSet
from iptm_core.parameters.loading import available_parameter_sets as available_parameter_sets
from iptm_core.parameters.loading import describe_parameters as describe_parameters
from iptm_core.parameters.loading import load_parameters as load_parameters
from iptm_core.parameters.model import ModelParameters as ModelParameters
