//! One world, two handles: sensors and commands for the driver, truth for the judge.
//!
//! [`RobotPort`] is all that a driver gets. It has no method that tells a pose, a label or a finger joint, so "sensors in,
//! commands out" is a matter of types, not of discipline.

use crate::judge::{GraspAsked, JudgeReport, Predicate, Tampering, Verdict};
use crate::truth::{ObjectTruth, Truth, TruthPoison};
use crate::{Viewpoint, World, WorldError};
use sfg_render::Picture;
use sfg_types::{HandFeedback, Observation, Point, RobotCommand};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Joint encoders and motor feedback of one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct ProprioceptiveState {
    /// Simulated time.
    pub stamp_secs: f64,
    /// Arm joint positions, radians.
    pub q: Vec<f64>,
    /// Arm joint velocities, rad/s.
    pub dq: Vec<f64>,
    /// Hand motors.
    pub hand: HandFeedback,
}

/// The robot's side of a world.
#[derive(Debug)]
pub struct RobotPort {
    world: Arc<Mutex<World>>,
}

/// The truth's side of a world; clones look at the same world.
#[derive(Clone, Debug)]
pub struct JudgeHandle {
    world: Arc<Mutex<World>>,
    poison: Option<TruthPoison>,
}

impl World {
    /// Splits the world into the robot's side and the judge's.
    #[must_use]
    pub fn share(self) -> (RobotPort, JudgeHandle) {
        let world = Arc::new(Mutex::new(self));
        (RobotPort { world: Arc::clone(&world) }, JudgeHandle { world, poison: None })
    }
}

impl RobotPort {
    /// Lets one control period pass with this set point.
    ///
    /// # Errors
    /// [`WorldError::Command`] for a set point that does not fit the robot, [`WorldError::Diverged`].
    pub fn step(&mut self, command: &RobotCommand) -> Result<(), WorldError> {
        lock(&self.world).step(command)
    }

    /// Encoders and motor feedback.
    #[must_use]
    pub fn proprioception(&self) -> ProprioceptiveState {
        lock(&self.world).proprioception()
    }

    /// The newest image of every camera, in the order of the robot description.
    #[must_use]
    pub fn observe(&mut self) -> Observation {
        lock(&self.world).observe()
    }
}

impl JudgeHandle {
    /// The truth, now.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let mut truth = lock(&self.world).truth();
        if let Some(poison) = &self.poison {
            poison.apply(&mut truth);
        }
        truth
    }

    /// Name of the object that stands nearest to a point of the base frame, seen from above.
    #[must_use]
    pub fn object_at(&self, point_in_base: &Point) -> Option<String> {
        let distance = |object: &ObjectTruth| (object.base_from_object.translation.vector - point_in_base.coords).xy().norm();
        let truth = lock(&self.world).truth();
        truth.objects.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|object| object.name)
    }

    /// The same handle with a truth view that lies; verdicts stay right.
    #[must_use]
    pub fn poisoned(mut self, poison: TruthPoison) -> Self {
        self.poison = Some(poison);
        self
    }

    /// Judges predicates on the present state and the history.
    ///
    /// # Errors
    /// [`WorldError::UnknownObject`] when a predicate names nothing in the scene.
    pub fn verdict(&self, predicates: &[Predicate]) -> Result<Verdict, WorldError> {
        lock(&self.world).verdict(predicates)
    }

    /// What the judge says about a grasp, whatever the scenario asks.
    ///
    /// # Errors
    /// [`WorldError::UnknownObject`] when the object is not in the scene.
    pub fn report(&self, asked: &GraspAsked) -> Result<JudgeReport, WorldError> {
        lock(&self.world).report(asked)
    }

    /// The broken physics invariant, if any.
    #[must_use]
    pub fn tampered(&self) -> Option<Tampering> {
        lock(&self.world).tampered()
    }

    /// Hash of the state of the named bodies.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        lock(&self.world).state_hash()
    }

    /// A picture of the simulator from a free viewpoint, without sensor noise.
    #[must_use]
    pub fn picture(&self, viewpoint: &Viewpoint) -> Picture {
        lock(&self.world).picture(viewpoint)
    }

    /// Moves an object on the table, as a person would between two runs; a new place of rest for the judge.
    ///
    /// # Errors
    /// [`WorldError::UnknownObject`], or [`WorldError::BadScene`] when the object is in the hand.
    pub fn displace_object(&self, name: &str, dx_m: f64, dy_m: f64, dyaw_rad: f64) -> Result<(), WorldError> {
        lock(&self.world).displace_object(name, dx_m, dy_m, dyaw_rad)
    }
}

/// A panic in another thread leaves a world that is still worth judging.
fn lock(world: &Mutex<World>) -> MutexGuard<'_, World> {
    world.lock().unwrap_or_else(PoisonError::into_inner)
}
