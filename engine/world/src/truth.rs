//! The truth about a scene, for the judge, training generators and tests alone.

use crate::judge::HoldPhase;
use serde::Serialize;
use sfg_types::{Point, Pose, Vector};

/// One object as it really is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectTruth {
    /// Name in the scene.
    pub name: String,
    /// Category of its model.
    pub category: String,
    /// Pose of its frame.
    pub base_from_object: Pose,
    /// Velocity of its centre of mass, m/s.
    pub velocity: Vector,
    /// Angular velocity, rad/s.
    pub angular_velocity: Vector,
    /// Mass without content, kg.
    pub mass_kg: f64,
    /// Labels of its parts, one for each collision piece.
    pub part_labels: Vec<String>,
    /// Where it is in its life.
    pub phase: HoldPhase,
}

/// Something that touches an object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContactTruth {
    /// Name of the object.
    pub object: String,
    /// What touches it: a hand link's name, `table`, `robot`, `grain` or another object's name.
    pub with: String,
    /// Contact impulse of the last step, Ns.
    pub impulse_ns: f64,
    /// Middle of the points that press, weighted with their impulses; of all points where none does.
    pub point_in_base: Point,
}

/// A moment of the simulated world.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// Simulated time.
    pub stamp_secs: f64,
    /// Objects in the order of the scene.
    pub objects: Vec<ObjectTruth>,
    /// Hand joints, radians, by name in URDF order.
    pub hand_joints: Vec<(String, f64)>,
    /// Arm joints, radians.
    pub arm_q: Vec<f64>,
    /// Palm frame.
    pub base_from_palm: Pose,
    /// Centres of the grains.
    pub grains_in_base: Vec<Point>,
    /// Contacts of objects, grains left out.
    pub contacts: Vec<ContactTruth>,
}

impl Truth {
    /// The object called `name`.
    #[must_use]
    pub fn object(&self, name: &str) -> Option<&ObjectTruth> {
        self.objects.iter().find(|object| object.name == name)
    }
}

/// A lie about the truth, told to everyone who asks for it; the judge is not deceived.
///
/// A run whose commands change under a poisoned truth view has read something that no sensor tells.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthPoison {
    /// Added to every position, metres.
    pub shift_m: Vector,
    /// Rotates the part labels of every object by this many places.
    pub rotate_labels: usize,
}

impl TruthPoison {
    pub(crate) fn apply(&self, truth: &mut Truth) {
        for object in &mut truth.objects {
            object.base_from_object.translation.vector += self.shift_m;
            let n = object.part_labels.len();
            if n > 0 {
                object.part_labels.rotate_left(self.rotate_labels % n);
            }
        }
        for grain in &mut truth.grains_in_base {
            *grain += self.shift_m;
        }
        truth.base_from_palm.translation.vector += self.shift_m;
        for (_, value) in &mut truth.hand_joints {
            *value = -*value;
        }
        truth.contacts.clear();
    }
}
