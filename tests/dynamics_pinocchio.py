"""Writes joint torques by pinocchio for the test of the inverse dynamics.

    pip install pin
    python3 tests/dynamics_pinocchio.py ROBOT.urdf BASE TIP N SEED > engine/kinematics/tests/data/NAME_torques.json

N random states of the joints from BASE to TIP with a random payload at TIP; joints that mimic one of them move with
it and load it, all others stay at 0. Gravity is -Z of BASE.
"""

import json
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

if len(sys.argv) != 6:
    sys.exit(__doc__)
urdf, base, tip, n, seed = sys.argv[1:]
model = pin.buildModelFromUrdf(urdf)
base_id, tip_id = model.getFrameId(base), model.getFrameId(tip)
chain = []
joint = model.frames[tip_id].parentJoint
while joint not in (0, model.frames[base_id].parentJoint):
    chain.insert(0, joint)
    joint = model.parents[joint]

# Joint -> (joint that it mimics, multiplier, offset).
mimics = {}
for element in ET.parse(urdf).getroot().findall("joint"):
    mimic = element.find("mimic")
    if mimic is not None and model.existJointName(element.get("name")):
        leader = model.getJointId(mimic.get("joint"))
        if leader in chain:
            own = model.getJointId(element.get("name"))
            mimics[own] = (leader, float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0)))
            if own in chain:
                chain.remove(own)

data = model.createData()
pin.framesForwardKinematics(model, data, pin.neutral(model))
model.gravity.linear = data.oMf[base_id].rotation @ np.array([0.0, 0.0, -9.81])
rng = np.random.default_rng(int(seed))
cases = []
for _ in range(int(n)):
    loaded = model.copy()
    mass, centre = rng.uniform(0.0, 5.0), rng.uniform(-0.2, 0.2, 3)
    tip_frame = model.frames[tip_id]
    point = pin.Inertia(mass, tip_frame.placement.act(centre), np.zeros((3, 3)))
    loaded.inertias[tip_frame.parentJoint] = loaded.inertias[tip_frame.parentJoint] + point
    q, dq, ddq = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for joint in chain:
        at = model.joints[joint].idx_q
        q[at] = rng.uniform(model.lowerPositionLimit[at], model.upperPositionLimit[at])
        dq[model.joints[joint].idx_v], ddq[model.joints[joint].idx_v] = rng.uniform(-3.0, 3.0), rng.uniform(-20.0, 20.0)
    for own, (leader, multiplier, offset) in mimics.items():
        to, at = model.joints[own], model.joints[leader]
        q[to.idx_q] = multiplier * q[at.idx_q] + offset
        dq[to.idx_v], ddq[to.idx_v] = multiplier * dq[at.idx_v], multiplier * ddq[at.idx_v]
    torques = pin.rnea(loaded, loaded.createData(), q, dq, ddq)
    for own, (leader, multiplier, _) in mimics.items():
        torques[model.joints[leader].idx_v] += multiplier * torques[model.joints[own].idx_v]
    of = [model.joints[joint].idx_v for joint in chain]
    cases.append({"q": list(q[[model.joints[j].idx_q for j in chain]]), "dq": list(dq[of]), "ddq": list(ddq[of]),
                  "payload_kg": mass, "centre_in_tip": list(centre), "torques": list(torques[of])})
rows = ",\n".join(json.dumps(case) for case in cases)
print(f'{{"base": "{base}", "tip": "{tip}", "joints": {json.dumps([model.names[j] for j in chain])}, "cases": [\n{rows}\n]}}')
