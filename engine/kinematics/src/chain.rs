//! A serial chain cut out of a robot and compiled to constant transforms, for the inner loops of IK and planning.

use crate::error::KinematicsError;
use crate::tree::{JointKind, JointSource, Tree};
use nalgebra::{DMatrix, Matrix3, Matrix6, Rotation3, UnitQuaternion, Vector3, Vector6};
use sfg_types::Pose;

/// Limits of one joint, radians or metres and seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Smallest position.
    pub lower: f64,
    /// Largest position.
    pub upper: f64,
    /// Largest speed.
    pub velocity: f64,
    /// Largest acceleration.
    pub acceleration: f64,
    /// Largest jerk.
    pub jerk: f64,
    /// Largest torque or force, Nm or N.
    pub effort: f64,
}

/// A rotation matrix and a translation: cheaper to multiply than a quaternion pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
}

impl Frame {
    pub(crate) fn of(pose: &Pose) -> Self {
        Self { rotation: pose.rotation.to_rotation_matrix().into_inner(), translation: pose.translation.vector }
    }

    fn times(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.rotation * other.translation + self.translation }
    }

    pub(crate) fn pose(&self) -> Pose {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        Pose::from_parts(self.translation.into(), UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

/// Joints from a base link to a tip link; joints between that are not asked for are frozen.
///
/// Poses are in the base link's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// Names of the moving joints, base to tip.
    pub joint_names: Vec<String>,
    /// Their limits.
    pub limits: Vec<JointLimits>,
    /// Link moved by each joint.
    pub link_names: Vec<String>,
    revolute: Vec<bool>,
    // before[i] leads from the frame after joint i-1 to the frame of joint i, turned so that the axis is +Z.
    before: Vec<Frame>,
    // link frame of joint i's child, seen from the turned frame after the joint.
    axis_from_link: Vec<Pose>,
    tip: Frame,
}

/// What is constant about one joint of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainJoint {
    /// The joint's frame, its axis along +Z, seen from the frame behind the joint before it (the base link for the first).
    pub before: Pose,
    /// Turns about its axis; moves along it otherwise.
    pub is_revolute: bool,
    /// The link that it moves, seen from the frame behind the joint.
    pub axis_from_link: Pose,
}

impl Chain {
    /// Cuts the chain `base_link` -> `tip_link` with the moving joints `joints`; the others keep their value in `frozen_q`.
    ///
    /// Acceleration and jerk limits are infinite: URDF 1.0 has none.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownName`] and [`KinematicsError::NoChain`].
    ///
    /// # Panics
    /// If `frozen_q` is not a configuration of the tree.
    pub fn new(
        tree: &Tree,
        base_link: &str,
        tip_link: &str,
        joints: &[String],
        frozen_q: &[f64],
    ) -> Result<Self, KinematicsError> {
        assert_eq!(frozen_q.len(), tree.n_q(), "a configuration has one value for each independent joint");
        let base_idx = tree.link_idx(base_link)?;
        for name in joints {
            tree.q_idx(name)?;
        }
        let mut path = Vec::new();
        let mut link_idx = tree.link_idx(tip_link)?;
        while link_idx != base_idx {
            let no_chain = || KinematicsError::NoChain { base: base_link.to_owned(), tip: tip_link.to_owned() };
            let joint_idx = tree.links[link_idx].joint_idx.ok_or_else(no_chain)?;
            path.push(joint_idx);
            link_idx = tree.joints[joint_idx].parent_idx;
        }
        path.reverse();
        let mut chain = Self {
            joint_names: Vec::new(),
            limits: Vec::new(),
            link_names: Vec::new(),
            revolute: Vec::new(),
            before: Vec::new(),
            axis_from_link: Vec::new(),
            tip: Frame::of(&Pose::identity()),
        };
        let mut constant = Pose::identity();
        for idx in path {
            let joint = &tree.joints[idx];
            let moves = matches!(joint.source, JointSource::Independent { .. }) && joints.contains(&joint.name);
            if !moves {
                constant *= joint.parent_from_child(joint.value(frozen_q));
                continue;
            }
            let joint_from_axis = UnitQuaternion::rotation_between(&Vector3::z(), &joint.axis)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
            chain.before.push(Frame::of(&(constant * joint.parent_from_joint * joint_from_axis)));
            constant = Pose::from_parts(Vector3::zeros().into(), joint_from_axis.inverse());
            chain.axis_from_link.push(constant);
            chain.revolute.push(joint.kind == JointKind::Revolute);
            chain.joint_names.push(joint.name.clone());
            chain.link_names.push(tree.links[joint.child_idx].name.clone());
            chain.limits.push(JointLimits {
                lower: joint.lower,
                upper: joint.upper,
                velocity: joint.velocity,
                acceleration: f64::INFINITY,
                jerk: f64::INFINITY,
                effort: joint.effort,
            });
        }
        if let Some(missing) = joints.iter().find(|j| !chain.joint_names.contains(j)) {
            return Err(KinematicsError::NoChain { base: base_link.to_owned(), tip: format!("{tip_link} over joint {missing}") });
        }
        chain.tip = Frame::of(&constant);
        Ok(chain)
    }

    /// The chain `base_link` -> `tip_link` with every independent joint between them; the others keep their value in `frozen_q`.
    ///
    /// # Errors
    /// As [`Self::new`].
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn between(tree: &Tree, base_link: &str, tip_link: &str, frozen_q: &[f64]) -> Result<Self, KinematicsError> {
        let mut joints = Vec::new();
        let mut link_idx = tree.link_idx(tip_link)?;
        while let Some(joint_idx) = tree.links[link_idx].joint_idx.filter(|_| tree.links[link_idx].name != base_link) {
            let joint = &tree.joints[joint_idx];
            if matches!(joint.source, JointSource::Independent { .. }) {
                joints.push(joint.name.clone());
            }
            link_idx = joint.parent_idx;
        }
        joints.reverse();
        Self::new(tree, base_link, tip_link, &joints, frozen_q)
    }

    /// Number of moving joints.
    #[must_use]
    pub fn n_joints(&self) -> usize {
        self.before.len()
    }

    /// The constants of joint `idx`, for whoever compiles the chain into something faster.
    ///
    /// # Panics
    /// If there is no such joint.
    #[must_use]
    pub fn joint(&self, idx: usize) -> ChainJoint {
        ChainJoint { before: self.before[idx].pose(), is_revolute: self.revolute[idx], axis_from_link: self.axis_from_link[idx] }
    }

    /// Pose of the tip.
    ///
    /// # Panics
    /// If `q` has not one value for each joint.
    #[must_use]
    pub fn fk(&self, q: &[f64]) -> Pose {
        assert_eq!(q.len(), self.n_joints(), "one value for each joint");
        let mut frame: Option<Frame> = None;
        for (idx, value) in q.iter().enumerate() {
            frame = Some(self.after_joint(idx, *value, frame.as_ref()));
        }
        frame.map_or(self.tip, |f| f.times(&self.tip)).pose()
    }

    /// Poses of the links moved by each joint, then of the tip: `n_joints + 1` poses.
    ///
    /// # Panics
    /// If `q` has not one value for each joint.
    #[must_use]
    pub fn fk_all(&self, q: &[f64]) -> Vec<Pose> {
        assert_eq!(q.len(), self.n_joints(), "one value for each joint");
        let mut frame: Option<Frame> = None;
        let mut poses = Vec::with_capacity(q.len() + 1);
        for (idx, value) in q.iter().enumerate() {
            let next = self.after_joint(idx, *value, frame.as_ref());
            poses.push(next.pose() * self.axis_from_link[idx]);
            frame = Some(next);
        }
        poses.push(frame.map_or(self.tip, |f| f.times(&self.tip)).pose());
        poses
    }

    /// Geometric Jacobian of the tip in the base frame: rows 0-2 m per unit, rows 3-5 rad per unit; `6 x n_joints`.
    #[must_use]
    pub fn jacobian(&self, q: &[f64]) -> DMatrix<f64> {
        let mut columns = vec![Vector6::zeros(); q.len()];
        self.tip_and_columns(q, &mut columns);
        DMatrix::from_fn(6, q.len(), |row, column| columns[column][row])
    }

    /// `sqrt(det(J J^T))`: 0 at a singularity (Yoshikawa 1985).
    #[must_use]
    pub fn manipulability(&self, q: &[f64]) -> f64 {
        let mut columns = vec![Vector6::zeros(); q.len()];
        self.tip_and_columns(q, &mut columns);
        let gram = columns.iter().fold(Matrix6::zeros(), |sum, c| sum + c * c.transpose());
        gram.determinant().max(0.0).sqrt()
    }

    /// Moves each value to the nearest one inside the position limits.
    pub fn clamp(&self, q: &mut [f64]) {
        for (value, limits) in q.iter_mut().zip(&self.limits) {
            *value = value.clamp(limits.lower, limits.upper);
        }
    }

    /// Whether every value lies inside the position limits widened by `tolerance`.
    #[must_use]
    pub fn is_inside_limits(&self, q: &[f64], tolerance: f64) -> bool {
        q.iter().zip(&self.limits).all(|(v, l)| *v >= l.lower - tolerance && *v <= l.upper + tolerance)
    }

    /// Middle of the position limits; 0 for joints without.
    #[must_use]
    pub fn middle(&self) -> Vec<f64> {
        let middle = |l: &JointLimits| if l.lower.is_finite() { 0.5 * (l.lower + l.upper) } else { 0.0 };
        self.limits.iter().map(middle).collect()
    }

    /// The same chain with another frame behind the old tip.
    #[must_use]
    pub fn with_tip(&self, tip_from_new_tip: &Pose) -> Self {
        Self { tip: self.tip.times(&Frame::of(tip_from_new_tip)), ..self.clone() }
    }

    /// Tip frame; writes the Jacobian's columns.
    pub(crate) fn tip_and_columns(&self, q: &[f64], columns: &mut [Vector6<f64>]) -> Frame {
        assert_eq!(q.len(), self.n_joints(), "one value for each joint");
        let mut frame = Frame::of(&Pose::identity());
        for (idx, value) in q.iter().enumerate() {
            frame = self.after_joint(idx, *value, (idx > 0).then_some(&frame));
            let axis: Vector3<f64> = frame.rotation.column(2).into();
            let origin = frame.translation;
            columns[idx] = Vector6::new(axis.x, axis.y, axis.z, origin.x, origin.y, origin.z);
        }
        let tip = frame.times(&self.tip);
        for (column, revolute) in columns.iter_mut().zip(&self.revolute) {
            let axis = Vector3::new(column[0], column[1], column[2]);
            let origin = Vector3::new(column[3], column[4], column[5]);
            let (linear, angular) =
                if *revolute { (axis.cross(&(tip.translation - origin)), axis) } else { (axis, Vector3::zeros()) };
            *column = Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
        }
        tip
    }

    fn after_joint(&self, idx: usize, value: f64, parent: Option<&Frame>) -> Frame {
        let mut frame = parent.map_or(self.before[idx], |p| p.times(&self.before[idx]));
        if self.revolute[idx] {
            // A turn about +Z mixes the first two columns only.
            let (sin, cos) = value.sin_cos();
            let x: Vector3<f64> = frame.rotation.column(0).into();
            let y: Vector3<f64> = frame.rotation.column(1).into();
            frame.rotation.set_column(0, &(x * cos + y * sin));
            frame.rotation.set_column(1, &(y * cos - x * sin));
        } else {
            let z: Vector3<f64> = frame.rotation.column(2).into();
            frame.translation += z * value;
        }
        frame
    }
}
