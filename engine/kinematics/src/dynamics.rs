//! Inverse dynamics: the joint torques of a motion, by recursive Newton-Euler.

use crate::chain::Chain;
use crate::error::KinematicsError;
use crate::tree::Tree;
use nalgebra::{Matrix3, Vector3};
use sfg_types::{Pose, Vector};

/// Acceleration of free fall, m/s^2; it points along -Z of the chain's base link.
pub const GRAVITY: f64 = 9.81;

/// A point mass fixed to the tip of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payload {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Its centre in the tip frame, metres.
    pub centre_in_tip_m: Vector,
}

/// The bodies of a chain: what hangs on each of its links, frozen joints included, is one rigid body.
///
/// Friction and the inertia of rotors are left out, as URDF has none for rotors and few files have the friction.
#[derive(Clone, Debug, PartialEq)]
pub struct Dynamics {
    n_q: usize,
    // Compiled joints: parents before children.
    joints: Vec<Joint>,
    // The joint that moves the first tip, and that tip seen from the frame behind it.
    tip: Option<(usize, Pose)>,
    payload_kg: f64,
}

/// A joint, its axis along +Z, and the body behind it.
#[derive(Clone, Debug, PartialEq)]
struct Joint {
    parent: Option<usize>,
    // Its value is `multiplier * q[q_idx] + offset`.
    q_idx: usize,
    multiplier: f64,
    offset: f64,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    is_revolute: bool,
    body: Body,
}

/// Mass, centre and inertia about the centre, in the frame behind the joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Body {
    mass_kg: f64,
    centre: Vector3<f64>,
    inertia: Matrix3<f64>,
}

impl Body {
    /// Two bodies as one (Steiner).
    fn and(&self, other: &Self) -> Self {
        let mass_kg = self.mass_kg + other.mass_kg;
        if mass_kg <= 0.0 {
            return Self { inertia: self.inertia + other.inertia, ..*self };
        }
        let centre = (self.centre * self.mass_kg + other.centre * other.mass_kg) / mass_kg;
        let about = |body: &Self| {
            let arm = body.centre - centre;
            body.inertia + (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * body.mass_kg
        };
        Self { mass_kg, centre, inertia: about(self) + about(other) }
    }
}

/// A body's frame in the one before, and the force and moment that pass through its joint, in its own frame.
struct Step {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    force: Vector3<f64>,
    moment: Vector3<f64>,
    omega: Vector3<f64>,
    alpha: Vector3<f64>,
    acceleration: Vector3<f64>,
}

impl Dynamics {
    /// Takes the masses of all links that `chain` moves from `tree`; joints that are not the chain's stay as in `rest_q`.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownName`] when the chain was not cut out of this tree.
    ///
    /// # Panics
    /// If `rest_q` is not a configuration of the tree.
    pub fn new(tree: &Tree, chain: &Chain, rest_q: &[f64]) -> Result<Self, KinematicsError> {
        for name in &chain.link_names {
            tree.link_idx(name)?;
        }
        let mut joints: Vec<Joint> = (0..chain.link_names.len())
            .map(|idx| {
                let joint = chain.joint(idx);
                Joint {
                    parent: joint.parent,
                    q_idx: joint.q_idx,
                    multiplier: joint.multiplier,
                    offset: joint.offset,
                    rotation: joint.before.rotation.to_rotation_matrix().into_inner(),
                    translation: joint.before.translation.vector,
                    is_revolute: joint.is_revolute,
                    body: Body::default(),
                }
            })
            .collect();
        let poses = tree.link_poses(rest_q);
        for (link_idx, link) in tree.links.iter().enumerate() {
            // Climb to the nearest link that a joint of the chain moves.
            let mut at = link_idx;
            let carrier = loop {
                if let Some(idx) = chain.link_names.iter().position(|name| *name == tree.links[at].name) {
                    break Some(idx);
                }
                match tree.links[at].joint_idx {
                    Some(joint_idx) => at = tree.joints[joint_idx].parent_idx,
                    None => break None,
                }
            };
            let Some(idx) = carrier else { continue };
            let axis_from_link = chain.joint(idx).axis_from_link * poses[at].inverse() * poses[link_idx];
            let axis_from_inertia = axis_from_link * link.inertial.link_from_inertia;
            let turn = axis_from_inertia.rotation.to_rotation_matrix().into_inner();
            let body = Body {
                mass_kg: link.inertial.mass_kg,
                centre: axis_from_inertia.translation.vector,
                inertia: turn * link.inertial.inertia * turn.transpose(),
            };
            joints[idx].body = joints[idx].body.and(&body);
        }
        let poses = chain.fk_all(&vec![0.0; chain.n_joints()]);
        let tip = chain
            .tip_joint(0)
            .map(|idx| (idx, chain.joint(idx).axis_from_link * poses[idx].inverse() * poses[chain.link_names.len()]));
        Ok(Self { n_q: chain.n_joints(), joints, tip, payload_kg: 0.0 })
    }

    /// The same chain with one more thing at its (first) tip.
    #[must_use]
    pub fn with_payload(&self, payload: &Payload) -> Self {
        let mut loaded = self.clone();
        if let Some((idx, axis_from_tip)) = self.tip {
            let centre = (axis_from_tip * nalgebra::Point3::from(payload.centre_in_tip_m)).coords;
            let body = &mut loaded.joints[idx].body;
            *body = body.and(&Body { mass_kg: payload.mass_kg, centre, inertia: Matrix3::zeros() });
        }
        loaded.payload_kg += payload.mass_kg;
        loaded
    }

    /// Mass of all payloads, kg.
    #[must_use]
    pub fn payload_kg(&self) -> f64 {
        self.payload_kg
    }

    /// Torques (forces at sliding joints) that accelerate the chain by `ddq` where it is at `q` with speed `dq`, gravity included.
    ///
    /// | name | unit |
    /// |---|---|
    /// | `q`, `dq`, `ddq` | rad, rad/s, rad/s^2; metres for sliding joints |
    /// | result | Nm; N for sliding joints |
    ///
    /// # Panics
    /// If the three have not one value for each joint.
    ///
    /// # Source
    /// Luh, Walker and Paul 1980.
    #[must_use]
    pub fn torques(&self, q: &[f64], dq: &[f64], ddq: &[f64]) -> Vec<f64> {
        let n = self.n_q;
        assert!(q.len() == n && dq.len() == n && ddq.len() == n, "one value for each joint");
        let axis = Vector3::z();
        let mut steps: Vec<Step> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            let of = |values: &[f64]| joint.multiplier * values[joint.q_idx];
            let (value, speed, change) = (of(q) + joint.offset, of(dq), of(ddq));
            // A base that is pushed up feels what gravity does.
            let still = (Vector3::zeros(), Vector3::zeros(), axis * GRAVITY);
            let (omega, alpha, acceleration) = joint.parent.map_or(still, |parent| {
                let Step { omega, alpha, acceleration, .. } = &steps[parent];
                (*omega, *alpha, *acceleration)
            });
            let (mut rotation, mut translation) = (joint.rotation, joint.translation);
            if joint.is_revolute {
                let (sin, cos) = value.sin_cos();
                let (x, y): (Vector3<f64>, Vector3<f64>) = (rotation.column(0).into(), rotation.column(1).into());
                rotation.set_column(0, &(x * cos + y * sin));
                rotation.set_column(1, &(y * cos - x * sin));
            } else {
                translation += rotation.column(2) * value;
            }
            let mut acceleration =
                rotation.tr_mul(&(acceleration + alpha.cross(&translation) + omega.cross(&omega.cross(&translation))));
            let (mut omega, mut alpha) = (rotation.tr_mul(&omega), rotation.tr_mul(&alpha));
            if joint.is_revolute {
                alpha += axis * change + omega.cross(&axis) * speed;
                omega += axis * speed;
            } else {
                acceleration += axis * change + omega.cross(&axis) * (2.0 * speed);
            }
            let body = &joint.body;
            let force = (acceleration + alpha.cross(&body.centre) + omega.cross(&omega.cross(&body.centre))) * body.mass_kg;
            let moment = body.inertia * alpha + omega.cross(&(body.inertia * omega)) + body.centre.cross(&force);
            steps.push(Step { rotation, translation, force, moment, omega, alpha, acceleration });
        }
        let mut torques = vec![0.0; n];
        for (idx, joint) in self.joints.iter().enumerate().rev() {
            let Step { rotation, translation, force, moment, .. } = &steps[idx];
            // What a mimicking joint needs is felt by the one that it follows.
            torques[joint.q_idx] += joint.multiplier * if joint.is_revolute { moment.z } else { force.z };
            if let Some(parent) = joint.parent {
                let force = rotation * force;
                let moment = rotation * moment + translation.cross(&force);
                steps[parent].force += force;
                steps[parent].moment += moment;
            }
        }
        torques
    }
}
