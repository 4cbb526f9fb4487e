"""How a calibration shows in a notebook: verdict, number and table."""

from html import escape

_VERDICTS = {
    "trusted": "Trusted",
    "trusted_where_measured": "Trusted where it was measured",
    "not_trusted": "Not to be trusted",
}


def _millimetres(statistics):
    return "" if statistics is None else f"{statistics.rms * 1e3:.3f}"


def _errors(accuracy):
    rows = [("fitted", accuracy.train), ("test", accuracy.test), ("left out", accuracy.held_out)]
    lines = "".join(
        f"<tr><td>{name}</td><td>{_millimetres(errors.before)}</td><td>{_millimetres(errors.after)}</td>"
        f"<td>{errors.after.count}</td></tr>"
        for name, errors in rows
        if errors is not None
    )
    return (
        "<table><tr><th>position error, rms [mm]</th><th>nominal</th><th>calibrated</th><th>points</th></tr>"
        f"{lines}</table>"
    )


def _parameter(row):
    angle = row["kind"] in ("rotation", "joint_offset")
    factor, unit = (1e3, "mrad") if angle else (1e3, "mm") if row["kind"] == "translation" else (1.0, "")
    return (
        f"<tr><td>{escape(str(row['name']))}</td><td>{escape(str(row['joint']))}</td>"
        f"<td>{row['error'] * factor:.4f}</td><td>{row['std'] * factor:.4f}</td><td>{unit}</td></tr>"
    )


def _parameters(parameters):
    shown = [row for row in parameters if not row["gauge"] and "." not in str(row["name"])]
    lines = "".join(_parameter(row) for row in shown)
    return (
        f"<details><summary>{len(shown)} geometric errors</summary><table><tr><th>error</th><th>joint</th>"
        f"<th>value</th><th>1 sigma</th><th></th></tr>{lines}</table></details>"
    )


def calibration_html(found):
    accuracy = found.accuracy
    shown = accuracy.held_out or accuracy.train
    where = "at configurations that were left out" if accuracy.held_out else "at the fitted rows"
    doubts = "".join(f"<li>{escape(doubt.message)}</li>" for doubt in found.doubts)
    return (
        f"<p><b>{_VERDICTS[found.verdict]}.</b> {escape(found.robot.name)}: {_millimetres(shown.before)} mm "
        f"&rarr; <b>{_millimetres(shown.after)} mm</b> rms {where}.</p>"
        + (f"<ul>{doubts}</ul>" if doubts else "")
        + _errors(accuracy)
        + _parameters(found.parameters)
    )
