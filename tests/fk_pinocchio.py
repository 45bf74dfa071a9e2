"""Compares the forward kinematics of `sfg ik bench --json` with pinocchio.

    pip install pin
    sfg ik bench --robot ROBOT.urdf --base BASE --tip TIP --json poses.json
    python3 tests/fk_pinocchio.py poses.json ROBOT.urdf BASE TIP

Prints the largest differences. Ends with 1 when one exceeds 1e-9 m or 1e-9 rad.
"""

import json
import sys

import numpy as np
import pinocchio as pin

if len(sys.argv) != 5:
    sys.exit(__doc__)
poses_path, urdf, base, tip = sys.argv[1:]
model = pin.buildModelFromUrdf(urdf)
data = model.createData()
base_id, tip_id = model.getFrameId(base), model.getFrameId(tip)
# The joints from the tip up to the base, those of the chain; the others stay at 0.
chain = []
joint = model.frames[tip_id].parentJoint
while joint not in (0, model.frames[base_id].parentJoint):
    chain.insert(0, joint)
    joint = model.parents[joint]

worst_m = worst_rad = 0.0
poses = json.load(open(poses_path))
for one in poses:
    q = pin.neutral(model)
    for joint, value in zip(chain, one["q"], strict=True):
        q[model.joints[joint].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    ours = one["base_from_tip"]
    theirs = data.oMf[base_id].actInv(data.oMf[tip_id])
    difference = pin.SE3(pin.Quaternion(np.array(ours["rotation"])).normalized(), np.array(ours["translation"])).actInv(theirs)
    worst_m = max(worst_m, np.linalg.norm(difference.translation))
    worst_rad = max(worst_rad, np.linalg.norm(pin.log3(difference.rotation)))
print(f"{len(poses)} poses: largest differences {worst_m:.2e} m, {worst_rad:.2e} rad")
sys.exit(int(worst_m > 1e-9 or worst_rad > 1e-9))
