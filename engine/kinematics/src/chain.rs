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

    #[inline]
    fn times(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.rotation * other.translation + self.translation }
    }

    pub(crate) fn pose(&self) -> Pose {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        Pose::from_parts(self.translation.into(), UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

/// Joints from a base link to one or several tip links; joints between that are not asked for are frozen.
///
/// Poses are in the base link's frame. Joints that mimic a joint of the chain move with it, those beside the way to a tip as
/// well, so there can be more compiled joints than values in a configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    /// Names of the joints of a configuration, base to tip; of two branches the one first that comes first in the URDF.
    pub joint_names: Vec<String>,
    /// Their limits.
    pub limits: Vec<JointLimits>,
    /// Link moved by each compiled joint: one for each of `joint_names` unless others mimic them.
    pub link_names: Vec<String>,
    /// Links at the tips.
    pub tip_names: Vec<String>,
    joints: Vec<Compiled>,
    tips: Vec<Tip>,
}

/// A joint whose axis is +Z of its frame.
#[derive(Clone, Debug, PartialEq)]
struct Compiled {
    parent: Option<usize>,
    q_idx: usize,
    multiplier: f64,
    offset: f64,
    is_revolute: bool,
    // Leads from the frame after the parent joint to the frame of this one, turned so that the axis is +Z.
    before: Frame,
    // Link frame of the joint's child, seen from the turned frame after the joint.
    axis_from_link: Pose,
}

#[derive(Clone, Debug, PartialEq)]
struct Tip {
    // Compiled joints from the base to the tip.
    path: Vec<usize>,
    // Seen from the frame after the last of them.
    frame: Frame,
}

/// What is constant about one compiled joint of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainJoint {
    /// The compiled joint before it, which has a smaller index; `None` when it hangs on the base link.
    pub parent: Option<usize>,
    /// Its value is `multiplier * q[q_idx] + offset`.
    pub q_idx: usize,
    /// 1 unless it mimics.
    pub multiplier: f64,
    /// 0 unless it mimics; radians or metres.
    pub offset: f64,
    /// The joint's frame, its axis along +Z, seen from the frame behind the parent joint (from the base link without one).
    pub before: Pose,
    /// Turns about its axis; moves along it otherwise.
    pub is_revolute: bool,
    /// The link that it moves, seen from the frame behind the joint.
    pub axis_from_link: Pose,
}

/// Directions and origins of the axes on the way to a tip: buffer of [`Chain::tip_and_columns`].
pub(crate) type Axes = Vec<(Vector3<f64>, Vector3<f64>)>;

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
        Self::branching(tree, base_link, &[tip_link], joints, frozen_q)
    }

    /// As [`Self::new`] with several tips, for arms that share a base or a torso.
    ///
    /// # Errors
    /// As [`Self::new`]; each joint must move one of the tips.
    ///
    /// # Panics
    /// If `frozen_q` is not a configuration of the tree, or without a tip.
    pub fn branching(
        tree: &Tree,
        base_link: &str,
        tip_links: &[&str],
        joints: &[String],
        frozen_q: &[f64],
    ) -> Result<Self, KinematicsError> {
        assert_eq!(frozen_q.len(), tree.n_q(), "a configuration has one value for each independent joint");
        assert!(!tip_links.is_empty(), "a chain has a tip");
        let mut chain = Self {
            joint_names: Vec::new(),
            limits: Vec::new(),
            link_names: Vec::new(),
            tip_names: tip_links.iter().map(|&name| name.to_owned()).collect(),
            joints: Vec::new(),
            tips: Vec::new(),
        };
        for name in joints {
            tree.q_idx(name)?;
        }
        // Place in the chain's configuration of each value of the tree's.
        let mut places = vec![None; tree.n_q()];
        for joint in tree.joints.iter().filter(|joint| joints.contains(&joint.name)) {
            let JointSource::Independent { q_idx } = joint.source else { continue };
            places[q_idx] = Some(chain.joint_names.len());
            chain.joint_names.push(joint.name.clone());
            chain.limits.push(JointLimits {
                lower: joint.lower,
                upper: joint.upper,
                velocity: joint.velocity,
                acceleration: f64::INFINITY,
                jerk: f64::INFINITY,
                effort: joint.effort,
            });
        }
        // The compiled joint that carries a link, and the link seen from behind it; parents come before children.
        let mut held: Vec<Option<(Option<usize>, Pose)>> = vec![None; tree.links.len()];
        held[tree.link_idx(base_link)?] = Some((None, Pose::identity()));
        for joint in &tree.joints {
            let Some((parent, constant)) = held[joint.parent_idx] else { continue };
            let (source, multiplier, offset) = match joint.source {
                JointSource::None => (None, 0.0, 0.0),
                JointSource::Independent { q_idx } => (places[q_idx], 1.0, 0.0),
                JointSource::Mimic { q_idx, multiplier, offset } => (places[q_idx], multiplier, offset),
            };
            let Some(q_idx) = source else {
                held[joint.child_idx] = Some((parent, constant * joint.parent_from_child(joint.value(frozen_q))));
                continue;
            };
            let joint_from_axis = UnitQuaternion::rotation_between(&Vector3::z(), &joint.axis)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
            let axis_from_link = Pose::from_parts(Vector3::zeros().into(), joint_from_axis.inverse());
            held[joint.child_idx] = Some((Some(chain.joints.len()), axis_from_link));
            chain.link_names.push(tree.links[joint.child_idx].name.clone());
            chain.joints.push(Compiled {
                parent,
                q_idx,
                multiplier,
                offset,
                is_revolute: joint.kind == JointKind::Revolute,
                before: Frame::of(&(constant * joint.parent_from_joint * joint_from_axis)),
                axis_from_link,
            });
        }
        for &tip_link in tip_links {
            let Some((mut at, tip)) = held[tree.link_idx(tip_link)?] else {
                return Err(KinematicsError::NoChain { base: base_link.to_owned(), tip: tip_link.to_owned() });
            };
            let mut path = Vec::new();
            while let Some(idx) = at {
                path.push(idx);
                at = chain.joints[idx].parent;
            }
            path.reverse();
            chain.tips.push(Tip { path, frame: Frame::of(&tip) });
        }
        let is_idle = |q_idx: &usize| (0..chain.n_tips()).all(|tip| !chain.moves_tip(*q_idx, tip));
        if let Some(idle) = (0..chain.n_joints()).find(is_idle) {
            let tip = format!("{} over joint {}", tip_links.join(" or "), chain.joint_names[idle]);
            return Err(KinematicsError::NoChain { base: base_link.to_owned(), tip });
        }
        Ok(chain)
    }

    /// The chain `base_link` -> `tip_link` with every joint that moves something between them; the others keep their value in
    /// `frozen_q`.
    ///
    /// # Errors
    /// As [`Self::new`].
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn between(tree: &Tree, base_link: &str, tip_link: &str, frozen_q: &[f64]) -> Result<Self, KinematicsError> {
        Self::new(tree, base_link, tip_link, &tree.joints_between(base_link, tip_link)?, frozen_q)
    }

    /// Number of joints of a configuration.
    #[must_use]
    pub fn n_joints(&self) -> usize {
        self.joint_names.len()
    }

    /// Number of tips.
    #[must_use]
    pub fn n_tips(&self) -> usize {
        self.tips.len()
    }

    /// The constants of compiled joint `idx` (those of [`Self::link_names`]), for whoever makes something faster of the chain.
    ///
    /// # Panics
    /// If there is no such joint.
    #[must_use]
    pub fn joint(&self, idx: usize) -> ChainJoint {
        let Compiled { parent, q_idx, multiplier, offset, is_revolute, before, axis_from_link } = self.joints[idx].clone();
        ChainJoint { parent, q_idx, multiplier, offset, before: before.pose(), is_revolute, axis_from_link }
    }

    /// Whether value `q_idx` of a configuration moves tip `tip_idx`.
    ///
    /// # Panics
    /// If there is no such tip.
    #[must_use]
    pub fn moves_tip(&self, q_idx: usize, tip_idx: usize) -> bool {
        self.tips[tip_idx].path.iter().any(|idx| self.joints[*idx].q_idx == q_idx)
    }

    /// The compiled joint that carries tip `tip_idx`; `None` when it is fixed to the base.
    ///
    /// # Panics
    /// If there is no such tip.
    #[must_use]
    pub fn tip_joint(&self, tip_idx: usize) -> Option<usize> {
        self.tips[tip_idx].path.last().copied()
    }

    /// Pose of the tip, of the first one if there are several.
    ///
    /// # Panics
    /// If `q` has not one value for each joint.
    #[must_use]
    pub fn fk(&self, q: &[f64]) -> Pose {
        self.fk_of(0, q)
    }

    /// Pose of tip `tip_idx`.
    ///
    /// # Panics
    /// If `q` has not one value for each joint, or there is no such tip.
    #[must_use]
    pub fn fk_of(&self, tip_idx: usize, q: &[f64]) -> Pose {
        assert_eq!(q.len(), self.n_joints(), "one value for each joint");
        let tip = &self.tips[tip_idx];
        let mut frame: Option<Frame> = None;
        for idx in &tip.path {
            frame = Some(self.joints[*idx].after(q, frame.as_ref()));
        }
        frame.map_or(tip.frame, |f| f.times(&tip.frame)).pose()
    }

    /// Poses of the links moved by each compiled joint ([`Self::link_names`]), then of the tips.
    ///
    /// # Panics
    /// If `q` has not one value for each joint.
    #[must_use]
    pub fn fk_all(&self, q: &[f64]) -> Vec<Pose> {
        assert_eq!(q.len(), self.n_joints(), "one value for each joint");
        let mut frames: Vec<Frame> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            frames.push(joint.after(q, joint.parent.map(|parent| &frames[parent])));
        }
        let links = self.joints.iter().zip(&frames).map(|(joint, frame)| frame.pose() * joint.axis_from_link);
        let tips = self.tips.iter().map(|tip| tip.path.last().map_or(tip.frame, |idx| frames[*idx].times(&tip.frame)).pose());
        links.chain(tips).collect()
    }

    /// Geometric Jacobian of the (first) tip in the base frame: rows 0-2 m per unit, rows 3-5 rad per unit; `6 x n_joints`.
    #[must_use]
    pub fn jacobian(&self, q: &[f64]) -> DMatrix<f64> {
        self.jacobian_of(0, q)
    }

    /// As [`Self::jacobian`], of tip `tip_idx`; columns of joints that do not move it are 0.
    ///
    /// # Panics
    /// If `q` has not one value for each joint, or there is no such tip.
    #[must_use]
    pub fn jacobian_of(&self, tip_idx: usize, q: &[f64]) -> DMatrix<f64> {
        let mut jacobian = DMatrix::zeros(6, q.len());
        self.tip_and_columns(tip_idx, q, &mut Axes::new(), |q_idx, part| {
            let mut column = jacobian.fixed_view_mut::<6, 1>(0, q_idx);
            column += part;
        });
        jacobian
    }

    /// `sqrt(det(J J^T))` of the (first) tip: 0 at a singularity (Yoshikawa 1985).
    #[must_use]
    pub fn manipulability(&self, q: &[f64]) -> f64 {
        self.manipulability_of(0, q)
    }

    /// As [`Self::manipulability`], of tip `tip_idx`.
    ///
    /// # Panics
    /// If `q` has not one value for each joint, or there is no such tip.
    #[must_use]
    pub fn manipulability_of(&self, tip_idx: usize, q: &[f64]) -> f64 {
        let jacobian = self.jacobian_of(tip_idx, q);
        let gram = jacobian.column_iter().fold(Matrix6::zeros(), |sum, c| sum + c * c.transpose());
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

    /// The same chain with another frame behind the old (first) tip.
    #[must_use]
    pub fn with_tip(&self, tip_from_new_tip: &Pose) -> Self {
        let mut chain = self.clone();
        chain.tips[0].frame = chain.tips[0].frame.times(&Frame::of(tip_from_new_tip));
        chain
    }

    /// Frame of a tip; hands out the columns of its Jacobian, those of one joint in several parts when others mimic it.
    pub(crate) fn tip_and_columns(
        &self,
        tip_idx: usize,
        q: &[f64],
        axes: &mut Axes,
        mut add: impl FnMut(usize, Vector6<f64>),
    ) -> Frame {
        assert_eq!(q.len(), self.n_joints(), "one value for each joint");
        let tip = &self.tips[tip_idx];
        axes.clear();
        axes.reserve(tip.path.len());
        let mut frame = Frame::of(&Pose::identity());
        for (nth, idx) in tip.path.iter().enumerate() {
            frame = self.joints[*idx].after(q, (nth > 0).then_some(&frame));
            axes.push((frame.rotation.column(2).into(), frame.translation));
        }
        let end = frame.times(&tip.frame);
        for (idx, (axis, origin)) in tip.path.iter().zip(axes) {
            let joint = &self.joints[*idx];
            let (linear, angular) =
                if joint.is_revolute { (axis.cross(&(end.translation - *origin)), *axis) } else { (*axis, Vector3::zeros()) };
            add(joint.q_idx, Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z) * joint.multiplier);
        }
        end
    }
}

impl Compiled {
    #[inline]
    fn after(&self, q: &[f64], parent: Option<&Frame>) -> Frame {
        let value = self.multiplier * q[self.q_idx] + self.offset;
        let mut frame = parent.map_or(self.before, |p| p.times(&self.before));
        if self.is_revolute {
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
