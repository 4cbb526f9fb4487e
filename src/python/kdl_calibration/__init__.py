"""Kinematic calibration of robot arms: arrays in, arrays out.

    import kdl_calibration as kc
    robot = kc.load_robot("robot.urdf")
    m = kc.Measurements.from_arrays(joints, points)     # (M, n) [rad or m] and (M, 3) [m]
    found = kc.calibrate(robot, m)
    found.predict(q, "A").position                      # (N, 3) [m] in the base frame

Lengths are metres, angles radians. Bad input raises InputError, a ValueError, in one line.
"""

from ._native import (
    Accuracy,
    Arm,
    BeforeAfter,
    Calibration,
    Comparison,
    Compensated,
    CompensatedProgram,
    Compensator,
    Doubt,
    ErrorStatistics,
    InputError,
    Iso9283,
    JointConvention,
    Measurements,
    MeasuringPlan,
    PositionErrors,
    Prediction,
    Robot,
    __version__,
    calibrate,
    compare,
    compensate_program,
    load,
    load_dh_robot,
    load_robot,
    parse_robot,
    plan,
    read_joint_convention,
    read_measurements,
    simulate,
    validate,
)
from . import _display, _measurements, _pickling, _programs, plots
from ._pickling import Finding


def report(found, file):
    """Writes the page for people, one HTML file. Raises InputError for a result that was loaded."""
    found.report(file)


Measurements.from_arrays = staticmethod(_measurements.from_arrays)
Measurements.from_pandas = staticmethod(_measurements.from_pandas)
from_arrays = _measurements.from_arrays
from_pandas = _measurements.from_pandas
CompensatedProgram.save = _programs.save
Calibration.__reduce__ = _pickling.reduce
Calibration.result = property(_pickling.result)
Calibration.findings = property(_pickling.findings)
Compensator.__reduce__ = _pickling.reduce_compensator
Calibration._repr_html_ = _display.calibration_html
Calibration.plot_residuals = plots.plot_residuals
Calibration.plot_workspace = plots.plot_workspace
Calibration.plot_convergence = plots.plot_convergence

for _public in list(globals().values()):  # errors and help name the package, not the module of C++
    if isinstance(_public, type) and _public.__module__.startswith("kdl_calibration._"):
        _public.__module__ = "kdl_calibration"
del _public
