"""Parts of the suite that studies are made of, in one place: models, vehicle, controller, radio and judges.

Studies, and tools of your own that go beyond `iptm.simulate`, import from here.
"""

from iptm.bounds import (
    BoolArray,
    avoidable_collisions,
    avoidably_below_s_min,
    below_s_min,
    episodes,
    fully_cooled_k,
    gaps_when_braking,
    seen_from,
)
from iptm.closed_loop import ClosedLoopRun, run_closed_loop
from iptm.emergency_stop import braking_leads, emergency_stops
from iptm.faults.fault import WHOLE_TRIP_S, Fault, at_places, faults_from, in_order
from iptm.faults.kinds import FaultKind, FaultPlace
from iptm.predictor_training import held_out, predicted_distance_m
from iptm.run import Report, Reporter
from iptm.vehicle_string import drive_string_in_memory
from iptm_controller.controller import Controller
from iptm_controller.horizon import MULTI_HORIZON, SINGLE_HORIZON, Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.production import ProductionLikeController, ProductionSettings
from iptm_controller.settings import ControllerSettings
from iptm_controller.solvers.factory import SolverOptions
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import DEFAULT_STRATEGY, STRATEGIES, strategy_by_name
from iptm_controller.temperature_value import mixing_weights
from iptm_core.aging_laws.cells import (
    AGING_CELLS,
    LAWS,
    AgingCell,
    Experiments,
)
from iptm_core.aging_laws.law import Load, Mechanism, paper_law
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.charging_stop import (
    LIMIT_1_H,
    LIMIT_C,
    TAPER_CHARGE,
    TAPER_SHARE,
    ChargingStopSettings,
    FastCharge,
    fast_charge,
)
from iptm_core.decision_record import Rung, SolveStatus
from iptm_core.declaration import TextEnum, parameter_specs
from iptm_core.errors import IptmError, MeasurementError, ScenarioError, StoreError
from iptm_core.markdown import NO_VALUE, markdown_table, render_page, table_of
from iptm_core.metrics import (
    RunMetrics,
    at_equal_end,
    cold_compressor_energies_j,
    compute_metrics,
    figure_values,
    gap_margins_m,
)
from iptm_core.metrics.constraints import GAP_TOLERANCE_M, check_constraints
from iptm_core.metrics.saving import saved_percent
from iptm_core.monitor_settings import SafetyMonitorSettings
from iptm_core.parameters import DEFAULT_SET, available_parameter_sets, load_parameters
from iptm_core.parameters.catalogue import (
    AUXILIARY_POWER_W,
    CHARGING_EFFICIENCY,
    INERTIA_FACTOR,
)
from iptm_core.parameters.flat import field_specs
from iptm_core.parameters.model import (
    BodyParameters,
    ModelParameters,
    PowertrainParameters,
    RegenerationParameters,
)
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.physics.cell import (
    ChargeTable,
    ChargeTransfer,
    ResistanceLaw,
    ambient_temperature_rate_k_s,
    cell_resistance_ohm,
)
from iptm_core.physics.traction import (
    coast_down_force_n,
    drag_loss_w,
    motor_torque_nm,
    regenerative_torque_nm,
    traction_force_n,
    traction_power_w,
    warm_up_force_n,
)
from iptm_core.program import refused
from iptm_core.road_ahead import SpeedLimits
from iptm_core.road_friction import GRAVITY_M_S2, tyre_deceleration_m_s2
from iptm_core.routes import Route, build_route
from iptm_core.routes.cycles import CYCLE_NAMES, LeaderMotion, load_cycle
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.user_csv import read_user_trip
from iptm_core.settings import LeaderSource, PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_S, Command, FloatArray, LeaderPreview, LeaderState, VehicleState
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH, KM_H_PER_M_S
from iptm_core.user_input import StrictMapping, check_known, number, whole_number
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import BridgeAnswer, CycleSource, TickBridge, V2xBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.captures import SimulatedRadio
from iptm_v2x_bridge.messages.cam import decode_datagram, encode_cam
from iptm_v2x_bridge.messages.mapem import IntersectionMap, Lane, encode_mapem
from iptm_v2x_bridge.messages.packets import delta_time_ms, its_timestamp_ms
from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile, ReceivedPath
from iptm_v2x_bridge.prediction.predictor import (
    History,
    LeaderTrack,
    Predictor,
    PredictorName,
    leader_track,
)
from iptm_v2x_bridge.prediction.regression import GAIN_FACTOR, Regression, RegressionModel
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.rules_of_the_road import OF_THE_CYCLE, given_rules
from iptm_v2x_bridge.sending.sender import CamSender, build_sender, car_on_road
from iptm_v2x_bridge.settings import Foresight, Framing, Impostor, SenderSettings
from iptm_v2x_bridge.stations.station import Station

__all__ = [
    "AGING_CELLS",
    "AUXILIARY_POWER_W",
    "CELSIUS_ZERO_K",
    "CHARGING_EFFICIENCY",
    "CYCLE_NAMES",
    "DEFAULT_SET",
    "DEFAULT_STRATEGY",
    "GAIN_FACTOR",
    "GAP_TOLERANCE_M",
    "GRAVITY_M_S2",
    "INERTIA_FACTOR",
    "J_PER_KWH",
    "KM_H_PER_M_S",
    "LAWS",
    "LIMIT_1_H",
    "LIMIT_C",
    "MULTI_HORIZON",
    "NO_VALUE",
    "NS_PER_S",
    "OF_THE_CYCLE",
    "SINGLE_HORIZON",
    "STRATEGIES",
    "TAPER_CHARGE",
    "TAPER_SHARE",
    "TRAJECTORY_COLUMNS",
    "WHOLE_TRIP_S",
    "AgingCell",
    "AgingSettings",
    "BodyParameters",
    "BoolArray",
    "BoundedByRules",
    "BridgeAnswer",
    "CamBridge",
    "CamSender",
    "ChargeTable",
    "ChargeTransfer",
    "ChargingStopSettings",
    "ClosedLoopRun",
    "Command",
    "Controller",
    "ControllerOptions",
    "ControllerSettings",
    "CycleSource",
    "Experiments",
    "FastCharge",
    "Fault",
    "FaultKind",
    "FaultPlace",
    "FloatArray",
    "Foresight",
    "Framing",
    "History",
    "Horizon",
    "Impostor",
    "IntersectionMap",
    "IptmError",
    "Lane",
    "LeaderMotion",
    "LeaderPreview",
    "LeaderSource",
    "LeaderState",
    "LeaderTrack",
    "LearntProfile",
    "Load",
    "MeasurementError",
    "Measurements",
    "Mechanism",
    "ModelParameters",
    "ParkedAging",
    "Plant",
    "PowertrainParameters",
    "Predictor",
    "PredictorName",
    "PreviewMode",
    "PreviewSettings",
    "ProductionLikeController",
    "ProductionSettings",
    "ReceivedPath",
    "RegenerationParameters",
    "Regression",
    "RegressionModel",
    "Rejection",
    "Report",
    "Reporter",
    "ResistanceLaw",
    "RoadLine",
    "RoadRules",
    "Route",
    "RunMetrics",
    "Rung",
    "SafetyMonitorSettings",
    "ScenarioError",
    "SenderSettings",
    "SimulatedRadio",
    "SolveStatus",
    "SolverOptions",
    "SpeedLimits",
    "Station",
    "StoreError",
    "StrictMapping",
    "SwitchingCheck",
    "TextEnum",
    "TickBridge",
    "Trajectory",
    "V2xBridge",
    "VehicleState",
    "ambient_temperature_rate_k_s",
    "at_equal_end",
    "at_places",
    "available_parameter_sets",
    "avoidable_collisions",
    "avoidably_below_s_min",
    "below_s_min",
    "braking_leads",
    "build_route",
    "build_sender",
    "car_on_road",
    "cell_resistance_ohm",
    "check_constraints",
    "check_known",
    "coast_down_force_n",
    "cold_compressor_energies_j",
    "compute_metrics",
    "decode_datagram",
    "delta_time_ms",
    "drag_loss_w",
    "drive_string_in_memory",
    "emergency_stops",
    "encode_cam",
    "encode_mapem",
    "episodes",
    "fast_charge",
    "faults_from",
    "field_specs",
    "figure_values",
    "fully_cooled_k",
    "gap_margins_m",
    "gaps_when_braking",
    "given_rules",
    "held_out",
    "in_order",
    "its_timestamp_ms",
    "leader_track",
    "load_cycle",
    "load_parameters",
    "markdown_table",
    "mixing_weights",
    "motor_torque_nm",
    "number",
    "paper_law",
    "parameter_specs",
    "predicted_distance_m",
    "read_user_trip",
    "read_yaml",
    "refused",
    "regenerative_torque_nm",
    "render_page",
    "run_closed_loop",
    "saved_percent",
    "seen_from",
    "strategy_by_name",
    "table_of",
    "traction_force_n",
    "traction_power_w",
    "tyre_deceleration_m_s2",
    "warm_up_force_n",
    "whole_number",
]
