//! The hand as balls on five chains of joints, compiled from its URDF for fast quasi-static closing.

use nalgebra::{Matrix3, Unit};
use sfg_kinematics::{JointKind, Shape as LinkShape, Tree};
use sfg_types::{HandProfile, HandSide, Point, Pose, Vector};
use std::path::Path;

/// Largest distance between neighbouring balls, as a share of their radius: the surface between them dips by 13 %.
const BALL_SPACING: f64 = 1.0;

/// Smallest ball of a plate, metres.
const MIN_PLATE_BALL_M: f64 = 0.007;

/// Why a hand cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HandError {
    /// The URDF cannot be read or lacks a link.
    #[error(transparent)]
    Kinematics(#[from] sfg_kinematics::KinematicsError),
    /// The profile names a joint that the URDF lacks, or the other way round.
    #[error("hand profile {profile:?} and its URDF do not agree: {message}")]
    Mismatch {
        /// Name of the profile.
        profile: String,
        /// What differs.
        message: String,
    },
}

/// A ball fixed to a link, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre in the link frame.
    pub centre: Vector,
    /// Radius.
    pub radius_m: f64,
}

/// A rotation matrix and a translation: cheaper to chain than a quaternion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Rotation.
    pub rotation: Matrix3<f64>,
    /// Translation, metres.
    pub translation: Vector,
}

/// One joint of a finger and the link behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct FingerJoint {
    /// Index into [`HandProfile::joints`].
    pub hand_q_idx: usize,
    /// Axis in the joint frame.
    pub axis: Unit<Vector>,
    /// Largest torque, Nm.
    pub max_torque_nm: f64,
    /// Balls of the link that this joint moves.
    pub balls: Vec<Ball>,
    /// Largest distance from this joint to any ball of link `k >= this one`, metres; 0 before.
    pub reach_m: Vec<f64>,
    parent_from_joint: Frame,
}

/// A chain of joints from the palm to a finger tip.
#[derive(Clone, Debug, PartialEq)]
pub struct Finger {
    /// Joints, palm to tip.
    pub joints: Vec<FingerJoint>,
    /// Whether its first joint is named after a thumb.
    pub is_thumb: bool,
}

/// A hand of one side.
#[derive(Clone, Debug, PartialEq)]
pub struct Hand {
    /// Which.
    pub side: HandSide,
    /// Palm and wrist, palm frame.
    pub palm_balls: Vec<Ball>,
    /// Fingers in the order of the URDF, thumb first on the SoftHand2.
    pub fingers: Vec<Finger>,
}

impl Frame {
    /// The same transform as a matrix.
    #[must_use]
    pub fn of(pose: &Pose) -> Self {
        Self { rotation: pose.rotation.to_rotation_matrix().into_inner(), translation: pose.translation.vector }
    }

    /// `self * other`.
    #[must_use]
    #[inline]
    pub fn times(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.rotation * other.translation + self.translation }
    }

    /// A point carried from the inner to the outer frame.
    #[must_use]
    #[inline]
    pub fn apply(&self, point: &Vector) -> Vector {
        self.rotation * point + self.translation
    }
}

impl FingerJoint {
    /// Pose of the link behind the joint, given the parent link's pose and the joint value.
    #[must_use]
    #[inline]
    pub fn link_frame(&self, parent: &Frame, value_rad: f64) -> Frame {
        let mut frame = parent.times(&self.parent_from_joint);
        frame.rotation *= rotation_about(&self.axis, value_rad);
        frame
    }
}

impl Hand {
    /// Compiles the hand of `side` from the URDF that the profile names, which lies in `robots_dir`.
    ///
    /// # Errors
    /// [`HandError`] when the file is broken or does not fit the profile; the user mends the robot files.
    pub fn load(profile: &HandProfile, side: HandSide, robots_dir: &Path) -> Result<Self, HandError> {
        let file = match side {
            HandSide::Left => &profile.urdf_left,
            HandSide::Right => &profile.urdf_right,
        };
        let tree = Tree::load(&robots_dir.join(file))?;
        let mismatch = |message: String| HandError::Mismatch { profile: profile.name.clone(), message };
        let palm_idx = tree.link_idx(&profile.palm_link)?;
        let zero_q = vec![0.0; tree.n_q()];
        let poses = tree.link_poses(&zero_q);
        let mut palm_balls = link_balls(&tree, palm_idx);
        let mut is_finger_link = vec![false; tree.links.len()];
        let mut fingers = Vec::new();
        for (joint_idx, joint) in tree.joints.iter().enumerate() {
            // Parents come first, so a link hangs on a finger exactly when its parent does.
            if is_finger_link[joint.parent_idx] {
                is_finger_link[joint.child_idx] = true;
            } else if joint.kind != JointKind::Fixed && joint.parent_idx == palm_idx {
                is_finger_link[joint.child_idx] = true;
                fingers.push(compile_finger(&tree, joint_idx, profile).map_err(&mismatch)?);
            }
        }
        if fingers.len() < 2 {
            return Err(mismatch(format!(
                "link {:?} carries {} fingers, at least 2 are needed",
                profile.palm_link,
                fingers.len()
            )));
        }
        for (idx, pose) in poses.iter().enumerate() {
            if idx != palm_idx && !is_finger_link[idx] {
                let palm_from_link = Frame::of(&(poses[palm_idx].inverse() * pose));
                palm_balls
                    .extend(link_balls(&tree, idx).into_iter().map(|b| Ball { centre: palm_from_link.apply(&b.centre), ..b }));
            }
        }
        Ok(Self { side, palm_balls, fingers })
    }

    /// Palm-frame balls of all links in a hand configuration, finger by finger.
    #[must_use]
    pub fn balls_at(&self, hand_q: &[f64]) -> Vec<Ball> {
        let mut balls = self.palm_balls.clone();
        for finger in &self.fingers {
            let mut frame = Frame::of(&Pose::identity());
            for joint in &finger.joints {
                frame = joint.link_frame(&frame, hand_q[joint.hand_q_idx]);
                balls.extend(joint.balls.iter().map(|b| Ball { centre: frame.apply(&b.centre), ..*b }));
            }
        }
        balls
    }

    /// Palm-frame centre of the pad of each finger tip.
    #[must_use]
    pub fn tips_at(&self, hand_q: &[f64]) -> Vec<Point> {
        let tip = |finger: &Finger| {
            let mut frame = Frame::of(&Pose::identity());
            for joint in &finger.joints {
                frame = joint.link_frame(&frame, hand_q[joint.hand_q_idx]);
            }
            let last = finger.joints.last().and_then(|j| j.balls.last());
            Point::from(frame.apply(&last.map_or(Vector::zeros(), |b| b.centre)))
        };
        self.fingers.iter().map(tip).collect()
    }
}

/// Follows one branch from the palm; a fixed link rides on the link before it.
fn compile_finger(tree: &Tree, first_joint_idx: usize, profile: &HandProfile) -> Result<Finger, String> {
    let is_thumb = tree.joints[first_joint_idx].name.contains("thumb");
    let mut joints: Vec<FingerJoint> = Vec::new();
    let mut held = Pose::identity();
    let mut next = Some(first_joint_idx);
    while let Some(idx) = next {
        let joint = &tree.joints[idx];
        match joint.kind {
            JointKind::Fixed => {
                held *= joint.parent_from_joint;
                let rigid = Frame::of(&held);
                let extra = link_balls(tree, joint.child_idx);
                if let Some(last) = joints.last_mut() {
                    last.balls.extend(extra.into_iter().map(|b| Ball { centre: rigid.apply(&b.centre), ..b }));
                }
            }
            JointKind::Revolute => {
                let hand_q_idx = profile
                    .joints
                    .iter()
                    .position(|j| j.name == joint.name)
                    .ok_or_else(|| format!("the profile has no joint {:?}", joint.name))?;
                joints.push(FingerJoint {
                    hand_q_idx,
                    axis: joint.axis,
                    max_torque_nm: profile.joints[hand_q_idx].max_torque_nm,
                    balls: link_balls(tree, joint.child_idx),
                    reach_m: Vec::new(),
                    parent_from_joint: Frame::of(&(held * joint.parent_from_joint)),
                });
                held = Pose::identity();
            }
            JointKind::Prismatic => return Err(format!("finger joint {:?} is prismatic", joint.name)),
        }
        next = tree.joints.iter().position(|j| j.parent_idx == joint.child_idx);
    }
    let n = joints.len();
    if n > crate::closing::MAX_JOINTS {
        return Err(format!("a finger has {n} joints, at most {} are supported", crate::closing::MAX_JOINTS));
    }
    for j in 0..n {
        let mut path_m = 0.0;
        let mut reach_m = vec![0.0; n];
        for (k, reach) in reach_m.iter_mut().enumerate().skip(j) {
            if k > j {
                path_m += joints[k].parent_from_joint.translation.norm();
            }
            *reach = path_m + joints[k].balls.iter().map(|b| b.centre.norm() + b.radius_m).fold(0.0, f64::max);
        }
        joints[j].reach_m = reach_m;
    }
    Ok(Finger { joints, is_thumb })
}

fn link_balls(tree: &Tree, link_idx: usize) -> Vec<Ball> {
    let mut balls = Vec::new();
    for primitive in &tree.links[link_idx].collision {
        let frame = Frame::of(&primitive.link_from_shape);
        let mut add = |x: f64, y: f64, z: f64, radius_m: f64| {
            balls.push(Ball { centre: frame.apply(&Vector::new(x, y, z)), radius_m });
        };
        match &primitive.shape {
            LinkShape::Sphere { radius_m } => add(0.0, 0.0, 0.0, *radius_m),
            LinkShape::Capsule { radius_m, half_length_m } => {
                for z in spread(*half_length_m, *radius_m) {
                    add(0.0, 0.0, z, *radius_m);
                }
            }
            LinkShape::Cylinder { radius_m, half_length_m } => {
                let r = radius_m.min(*half_length_m);
                for z in spread(half_length_m - r, r) {
                    add(0.0, 0.0, z, r);
                    // Rings fill a disk that is wider than it is high.
                    for ring_m in spread(radius_m - r, r).into_iter().filter(|&m| m > 1e-4) {
                        let n = ((std::f64::consts::TAU * ring_m / r).ceil() as usize).max(4);
                        for i in 0..n {
                            let angle = std::f64::consts::TAU * i as f64 / n as f64;
                            add(ring_m * angle.cos(), ring_m * angle.sin(), z, r);
                        }
                    }
                }
            }
            LinkShape::Cuboid { half_extents_m: half } => {
                // A thin plate gets fewer, larger balls: it grows by at most this radius in its thin direction.
                let r = half.min().max(MIN_PLATE_BALL_M).min(half.max());
                for x in spread(half.x - r, r) {
                    for y in spread(half.y - r, r) {
                        for z in spread(half.z - r, r) {
                            add(x, y, z, r);
                        }
                    }
                }
            }
            // The generator's hands are made of primitives; a mesh link has no balls and is left to the final check.
            LinkShape::Mesh { .. } => {}
        }
    }
    balls
}

/// Positions in `[-half, half]` no further apart than the ball spacing, symmetric about 0.
fn spread(half_m: f64, radius_m: f64) -> Vec<f64> {
    if half_m < 1e-6 {
        return vec![0.0];
    }
    let n = (2.0 * half_m / (radius_m * BALL_SPACING)).ceil().max(1.0) as usize;
    (0..=n).map(|i| half_m * (2.0 * i as f64 / n as f64 - 1.0)).collect()
}

/// Rodrigues' formula.
#[inline]
fn rotation_about(axis: &Unit<Vector>, angle_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    let k = axis.into_inner();
    let c = 1.0 - cos;
    Matrix3::new(
        cos + k.x * k.x * c,
        k.x * k.y * c - k.z * sin,
        k.x * k.z * c + k.y * sin,
        k.y * k.x * c + k.z * sin,
        cos + k.y * k.y * c,
        k.y * k.z * c - k.x * sin,
        k.z * k.x * c - k.y * sin,
        k.z * k.y * c + k.x * sin,
        cos + k.z * k.z * c,
    )
}
