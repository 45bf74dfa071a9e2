//! The rules of physics that no run may break: an object is held by friction and form alone.
//!
//! [`Guard::record`] notes what the world was built from; [`Guard::check`] compares before every step. Poses are compared
//! bit by bit with the end of the step before, and velocities too, so that nothing can be carried by hand between two steps.

use rapier3d::prelude::*;
use serde::Serialize;

/// Largest friction coefficient of any pair.
pub const MAX_PAIR_FRICTION: f32 = 0.8;
/// Gravity, m/s^2, along -Z.
pub const GRAVITY: f32 = 9.81;

/// Which rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Invariant {
    /// No joint ends at an object or a grain.
    Joint,
    /// Every collider stays on the body it was made for.
    Parent,
    /// Every collider touches what it was made to touch.
    Groups,
    /// Friction of every pair is at most [`MAX_PAIR_FRICTION`].
    Friction,
    /// Objects and grains have no linear or angular damping.
    Damping,
    /// Objects and grains never sleep and stay enabled, dynamic and free to move along all axes.
    Freedom,
    /// Gravity is [`GRAVITY`] along -Z and acts fully on objects and grains.
    Gravity,
    /// Masses lie in the range of the object file.
    Mass,
    /// Joint motors are no stronger than the robot's.
    MotorTorque,
    /// Tendon tensions lie within the hand profile.
    TendonTension,
    /// Nothing pushes objects or grains but contacts and gravity.
    Force,
    /// Objects and grains are, before a step, where the step before left them.
    Teleport,
}

/// A broken rule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tampering {
    /// Which.
    pub which: Invariant,
    /// What was found, on what.
    pub detail: String,
    /// When, seconds.
    pub stamp_secs: f64,
}

/// A body that the rules protect.
#[derive(Clone, Debug)]
pub(crate) struct Protected {
    pub(crate) name: String,
    pub(crate) body: RigidBodyHandle,
    pub(crate) mass_range_kg: [f32; 2],
}

/// A motor and the largest torque that the robot's files allow it.
#[derive(Clone, Debug)]
pub(crate) struct MotorCap {
    pub(crate) joint: MultibodyJointHandle,
    pub(crate) axis: JointAxis,
    pub(crate) name: String,
    pub(crate) max_nm: f32,
}

/// Pose and velocities at the end of a step.
type State = (Pose, Vector, AngVector);

fn state(body: &RigidBody) -> State {
    (*body.position(), body.linvel(), body.angvel())
}

/// What the world was built from.
#[derive(Clone, Debug, Default)]
pub(crate) struct Guard {
    protected: Vec<Protected>,
    colliders: Vec<(ColliderHandle, Option<RigidBodyHandle>, InteractionGroups)>,
    motors: Vec<MotorCap>,
    states: Vec<State>,
    max_tension_nm: f64,
}

impl Guard {
    pub(crate) fn record(physics: &PhysicsWorld, protected: Vec<Protected>, motors: Vec<MotorCap>, max_tension_nm: f64) -> Self {
        let colliders =
            physics.colliders.iter().map(|(handle, collider)| (handle, collider.parent(), collider.collision_groups())).collect();
        let mut guard = Self { protected, colliders, motors, states: Vec::new(), max_tension_nm };
        guard.note_states(physics);
        guard
    }

    /// Remembers where the step left the protected bodies.
    pub(crate) fn note_states(&mut self, physics: &PhysicsWorld) {
        self.states.clear();
        self.states.extend(self.protected.iter().map(|p| state(&physics.bodies[p.body])));
    }

    /// The first broken rule, if any. `tensions_nm` are the tendon tensions of the coming step.
    pub(crate) fn check(&self, physics: &PhysicsWorld, tensions_nm: &[f64], stamp_secs: f64) -> Result<(), Tampering> {
        let broken = |which, detail: String| Err(Tampering { which, detail, stamp_secs });
        let expected = Vector::new(0.0, 0.0, -GRAVITY);
        if physics.gravity != expected {
            return broken(Invariant::Gravity, format!("gravity is {:?} m/s^2", physics.gravity.to_array()));
        }
        for (_, joint) in physics.impulse_joints.iter() {
            if let Some(p) = self.protected.iter().find(|p| p.body == joint.body1() || p.body == joint.body2()) {
                return broken(Invariant::Joint, format!("a joint ends at {}", p.name));
            }
        }
        for (protected, left) in self.protected.iter().zip(&self.states) {
            if let Some(broken) = check_body(physics, protected, left, stamp_secs) {
                return Err(broken);
            }
        }
        if physics.colliders.len() != self.colliders.len() {
            let detail = format!("{} colliders instead of {}", physics.colliders.len(), self.colliders.len());
            return broken(Invariant::Parent, detail);
        }
        for (handle, parent, groups) in &self.colliders {
            match physics.colliders.get(*handle) {
                Some(collider) if collider.parent() == *parent => {
                    let rule = collider.friction_combine_rule();
                    if collider.friction() > MAX_PAIR_FRICTION || rule != CoefficientCombineRule::Min {
                        let detail = format!("a collider has friction {} with rule {rule:?}", collider.friction());
                        return broken(Invariant::Friction, detail);
                    }
                    if collider.collision_groups() != *groups || collider.is_sensor() || !collider.is_enabled() {
                        return broken(Invariant::Groups, "a collider no longer touches what it was made to touch".to_owned());
                    }
                }
                _ => return broken(Invariant::Parent, "a collider has left its body".to_owned()),
            }
        }
        for motor in &self.motors {
            let found = physics.multibody_joints.get(motor.joint).and_then(|(multibody, link_idx)| multibody.link(link_idx));
            let Some(link) = found else { return broken(Invariant::Joint, format!("joint {} is gone", motor.name)) };
            let max_nm = link.joint.data.motor(motor.axis).map_or(0.0, |m| m.max_force);
            if max_nm > motor.max_nm {
                return broken(Invariant::MotorTorque, format!("{} may use {max_nm} Nm of {} Nm", motor.name, motor.max_nm));
            }
        }
        if let Some(tension) = tensions_nm.iter().find(|t| !t.is_finite() || t.abs() > self.max_tension_nm * (1.0 + 1e-6)) {
            let detail = format!("a tendon pulls with {tension:.3} Nm of {:.3} Nm", self.max_tension_nm);
            return broken(Invariant::TendonTension, detail);
        }
        Ok(())
    }
}

fn check_body(physics: &PhysicsWorld, protected: &Protected, left: &State, stamp_secs: f64) -> Option<Tampering> {
    let name = &protected.name;
    let broken = |which, detail: String| Some(Tampering { which, detail, stamp_secs });
    let Some(body) = physics.bodies.get(protected.body) else {
        return broken(Invariant::Freedom, format!("{name} is gone"));
    };
    if physics.multibody_joints.rigid_body_link(protected.body).is_some() {
        return broken(Invariant::Joint, format!("{name} is a link of a multibody"));
    }
    if body.linear_damping() != 0.0 || body.angular_damping() != 0.0 {
        return broken(Invariant::Damping, format!("{name} has damping {}, {}", body.linear_damping(), body.angular_damping()));
    }
    if !body.is_dynamic() || !body.is_enabled() || body.is_sleeping() || !body.locked_axes().is_empty() {
        return broken(Invariant::Freedom, format!("{name} is not free to move"));
    }
    if body.gravity_scale() != 1.0 {
        return broken(Invariant::Gravity, format!("gravity acts {} times on {name}", body.gravity_scale()));
    }
    let [least, most] = protected.mass_range_kg;
    if !(least..=most).contains(&body.mass()) {
        return broken(Invariant::Mass, format!("{name} has {} kg, allowed are {least} to {most} kg", body.mass()));
    }
    if body.user_force() != Vector::ZERO || body.user_torque() != AngVector::ZERO || body.effective_dominance_group() != 0 {
        return broken(Invariant::Force, format!("something pushes {name}"));
    }
    if state(body) != *left {
        return broken(Invariant::Teleport, format!("{name} was moved or accelerated between two steps"));
    }
    None
}
