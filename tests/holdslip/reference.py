#!/usr/bin/env python3
"""Verdicts of MuJoCo for the hold/slip scenes.

Reads scenes.json (written by engine/world/tests/holdslip.rs with SFG_HOLDSLIP_EXPORT=1) and writes reference.json, both beside
this file. Needs `pip install mujoco==3.17.0 numpy`. Settings: dt 2 ms, implicitfast, elliptic cones, impratio 10, noslip 2.
"""

import json
import pathlib

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
DT_SECS = 0.002


def numbers(values):
    return " ".join(repr(float(v)) for v in values)


def placed(pose):
    return f'pos="{numbers(pose["position"])}" quat="{numbers(pose["orientation_wxyz"])}"'


def geom(piece, friction, groups, mass):
    """A geom; MuJoCo's pair friction is the larger of the two, which are equal here."""
    return (
        f'<geom type="{piece["shape"]}" size="{numbers(piece["size"])}" {placed(piece["at"])} mass="{mass}" '
        f'friction="{friction} 0 0" condim="3" {groups}/>'
    )


def hand_body(suite, idx, friction):
    link = suite["links"][idx]
    lines = [f'<body name="{link["name"]}" {placed(link["at"])} gravcomp="1">']
    if link["hinge"]:
        axis, lower, upper = link["hinge"]
        lines.append(
            f'<joint name="joint_{idx}" type="hinge" axis="{numbers(axis)}" limited="true" range="{lower} {upper}" '
            f'armature="{suite["armature"]}" damping="0"/>'
        )
    lines.append(
        f'<inertial {placed(link["com"])} mass="{link["mass_kg"]}" diaginertia="{numbers(link["inertia_diagonal"])}"/>'
    )
    # The links of a hand meet the object, not each other.
    lines += [geom(piece, friction, 'contype="1" conaffinity="2"', 0) for piece in link["shapes"]]
    lines += [hand_body(suite, child, friction) for child, other in enumerate(suite["links"]) if other["parent"] == idx]
    lines.append("</body>")
    return "\n".join(lines)


def model(suite, scene):
    friction = scene["friction"]
    hinges = [idx for idx, link in enumerate(suite["links"]) if link["hinge"]]
    servos = [
        f'<position joint="joint_{idx}" kp="{suite["kp"]}" kv="{suite["kd"]}" '
        f'forcerange="-{suite["max_torque_nm"]} {suite["max_torque_nm"]}"/>'
        for idx in hinges
    ]
    pieces = [geom(piece, friction, 'contype="2" conaffinity="1"', piece["mass_kg"]) for piece in scene["pieces"]]
    text = f"""<mujoco>
      <compiler angle="radian" autolimits="true"/>
      <option timestep="{DT_SECS}" integrator="implicitfast" cone="elliptic" impratio="10" noslip_iterations="2" gravity="0 0 0">
        <flag autoreset="disable"/>
      </option>
      <worldbody>
        {hand_body(suite, 0, friction)}
        <body name="object" {placed(scene["object"])}><freejoint/>{"".join(pieces)}</body>
      </worldbody>
      <actuator>{"".join(servos)}</actuator>
    </mujoco>"""
    return mujoco.MjModel.from_xml_string(text), [f"joint_{idx}" for idx in hinges]


def holds(suite, scene):
    mj, names = model(suite, scene)
    data = mujoco.MjData(mj)
    start, target = np.array(scene["start_q"]), np.array(scene["target_q"])
    for name, value in zip(names, start):
        data.qpos[mj.joint(name).qposadr[0]] = value
    body = mj.body("object").id
    for step in range(round(suite["close_secs"] / DT_SECS)):
        data.ctrl[:] = start + min(1.0, (step + 1) * DT_SECS / suite["ramp_secs"]) * (target - start)
        mujoco.mj_step(mj, data)
    closed_at, closed_turn = data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy()
    mj.opt.gravity[:] = np.array(scene["gravity_direction"]) * suite["gravity_mps2"]
    for _ in range(round(suite["hold_secs"] / DT_SECS)):
        mujoco.mj_step(mj, data)
        shift = np.linalg.norm(data.xpos[body] - closed_at)
        cosine = (np.trace(closed_turn.T @ data.xmat[body].reshape(3, 3)) - 1.0) / 2.0
        turn = np.arccos(np.clip(cosine, -1.0, 1.0))
        if not (shift <= suite["max_shift_m"] and turn <= suite["max_turn_rad"]):
            return False
    return True


def main():
    suite = json.loads((HERE / "scenes.json").read_text())
    verdicts = [holds(suite, scene) for scene in suite["scenes"]]
    engine = f"MuJoCo {mujoco.__version__}, dt {DT_SECS} s, implicitfast, elliptic, impratio 10, noslip 2"
    result = {"engine": engine, "n_holds": sum(verdicts), "holds": verdicts}
    (HERE / "reference.json").write_text(json.dumps(result) + "\n")
    print(f"{engine}: {sum(verdicts)} of {len(verdicts)} hold")


if __name__ == "__main__":
    main()
