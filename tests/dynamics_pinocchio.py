"""Writes joint torques by pinocchio for the test of the inverse dynamics.

    pip install pin
    python3 tests/dynamics_pinocchio.py ROBOT.urdf BASE TIP N SEED > engine/kinematics/tests/data/NAME_torques.json

N random states of the joints from BASE to TIP with a random payload at TIP; all other joints stay at 0, gravity is -Z of BASE.
"""

import json
import sys

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
    torques = pin.rnea(loaded, loaded.createData(), q, dq, ddq)
    of = [model.joints[joint].idx_v for joint in chain]
    cases.append({"q": list(q[[model.joints[j].idx_q for j in chain]]), "dq": list(dq[of]), "ddq": list(ddq[of]),
                  "payload_kg": mass, "centre_in_tip": list(centre), "torques": list(torques[of])})
rows = ",\n".join(json.dumps(case) for case in cases)
print(f'{{"base": "{base}", "tip": "{tip}", "joints": {json.dumps([model.names[j] for j in chain])}, "cases": [\n{rows}\n]}}')
