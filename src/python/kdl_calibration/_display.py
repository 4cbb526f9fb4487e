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


def _parameters(found):
    robot = found.robot
    sliding = {name for name, kind in zip(robot.joints, robot.joint_types) if kind == "prismatic"}
    rows = [row for row in found.parameters if not row["gauge"] and "." not in row["name"]]
    lines = []
    for row in rows:
        is_length = row["kind"] == "translation" or (row["kind"] == "joint_offset" and row["joint"] in sliding)
        lines.append(
            f"<tr><td>{escape(row['name'])}</td><td>{escape(row['joint'])}</td><td>{row['error'] * 1e3:.4f}</td>"
            f"<td>{row['std'] * 1e3:.4f}</td><td>{'mm' if is_length else 'mrad'}</td></tr>"
        )
    return (
        f"<details><summary>{len(rows)} geometric errors</summary><table><tr><th>error</th><th>joint</th>"
        f"<th>value</th><th>1 sigma</th><th></th></tr>{''.join(lines)}</table></details>"
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
        + _parameters(found)
    )
