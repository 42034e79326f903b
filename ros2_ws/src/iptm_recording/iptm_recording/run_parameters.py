"""The model parameters of a recorded run, from the texts in its bag."""

from __future__ import annotations

from pathlib import Path

import yaml

from iptm_core.errors import BagError, ParameterError
from iptm_core.parameters import ModelParameters, flat_to_parameters, load_parameters
from iptm_recording.bag_reader import read_run_information
from iptm_recording.run_information import RunInformation

MODEL_KEY = "model"
"""Entry of the run's parameters that holds the model's, as `to_flat_dict` gives them."""


def stored_model_parameters(information: RunInformation) -> ModelParameters | None:
    """Return the model parameters that a run was made with, None if its bag does not tell.

    Raises:
        BagError: there are some, but malformed.
    """
    try:
        parameters = yaml.safe_load(information.parameters)
    except yaml.YAMLError as error:
        raise BagError(f"parameters of the run are not YAML: {error}") from None
    if not isinstance(parameters, dict) or MODEL_KEY not in parameters:
        return None
    try:
        return flat_to_parameters(parameters[MODEL_KEY], "parameters of the run")
    except ParameterError as error:
        raise BagError(str(error)) from None


def read_model_parameters(path: Path) -> tuple[ModelParameters, bool]:
    """Return the parameters to judge a recorded run by.

    Args:
        path: bag folder or .mcap file.

    Returns:
        The parameters of the run and True; or the default set and False where the bag has none.

    Raises:
        BagError: the bag cannot be read, or its parameters are malformed.
    """
    stored = stored_model_parameters(read_run_information(path))
    return (load_parameters().values, False) if stored is None else (stored, True)
