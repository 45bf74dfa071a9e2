//! The whole robot: base, torso, head, two arms, two hands and cameras.

use crate::chain::Chain;
use crate::description::{ArmDescription, RobotDescription, load_hand_profile, pose};
use crate::error::KinematicsError;
use crate::tree::{Graft, Tree, unknown};
use crate::urdf::{read_urdf, root_link};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use sfg_types::{CameraIntrinsics, HandProfile, HandSide, Pose};
use std::path::Path;

/// A loaded robot; configurations `q` of the whole robot are in the order of `tree.q_names`.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotModel {
    /// What the description file says.
    pub description: RobotDescription,
    /// Links and joints, hands included.
    pub tree: Tree,
    /// Left arm.
    pub left: Arm,
    /// Right arm.
    pub right: Arm,
    /// The hand's profile; `None` when the robot was loaded without hands.
    pub hand_profile: Option<HandProfile>,
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// Ready pose of the whole robot, radians.
    pub home_q: Vec<f64>,
}

/// One arm of a loaded robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Which one.
    pub side: HandSide,
    /// From the base link to the palm frame (to the arm's tip link when there is no hand); torso at home.
    pub chain: Chain,
    /// Places of the arm's joints in a configuration of the whole robot.
    pub q_idx: Vec<usize>,
    /// Ready pose of this arm.
    pub home_q: Vec<f64>,
    /// Name of the chain's last link.
    pub tip_link: String,
    /// Root link of the hand, if there is one: this link and all below it are the hand.
    pub hand_root_link: Option<String>,
}

/// Joints that are moved together, for inverse kinematics and planning: [`RobotModel::group`].
#[derive(Clone, Debug, PartialEq)]
pub struct JointGroup {
    /// One of [`GROUPS`].
    pub name: String,
    /// From the base link to the palm frames (to the arms' tip links when there are no hands), the left one first.
    pub chain: Chain,
    /// Places of the group's joints in a configuration of the whole robot.
    pub q_idx: Vec<usize>,
    /// Ready pose of the group.
    pub home_q: Vec<f64>,
    /// Root links of the hands that it moves.
    pub hand_root_links: Vec<String>,
}

/// Names of the groups that every robot has; the torso is whatever moves the shoulders.
pub const GROUPS: [&str; 6] = ["left", "right", "both", "torso_left", "torso_right", "torso_both"];

/// A calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Name.
    pub name: String,
    /// Link that carries it: index into the tree's links.
    pub mount_idx: usize,
    /// Pose in that link; camera frame: +Z forward, +X right, +Y down.
    pub mount_from_camera: Pose,
    /// Pinhole intrinsics.
    pub intrinsics: CameraIntrinsics,
}

impl RobotModel {
    /// Loads a robot with its hands from a description file such as `scenarios/robots/curi.yaml`.
    ///
    /// # Errors
    /// Any [`KinematicsError`]: each names the file and what to mend.
    pub fn load(path: &Path) -> Result<Self, KinematicsError> {
        let description = RobotDescription::load(path)?;
        let profile = load_hand_profile(&beside(path, &description.hand_profile))?;
        Self::build(path, description, Some(profile))
    }

    /// Loads the robot without hands: chains end at the arms' tip links.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn load_without_hands(path: &Path) -> Result<Self, KinematicsError> {
        Self::build(path, RobotDescription::load(path)?, None)
    }

    /// The arm of a side.
    #[must_use]
    pub fn arm(&self, side: HandSide) -> &Arm {
        match side {
            HandSide::Left => &self.left,
            HandSide::Right => &self.right,
        }
    }

    /// The chain of an arm: base link to palm frame.
    #[must_use]
    pub fn arm_chain(&self, side: HandSide) -> &Chain {
        &self.arm(side).chain
    }

    /// An arm, both arms, or either with the torso, by name: `left`, `right`, `both`, `torso_left`, `torso_right`, `torso_both`.
    ///
    /// Joints of the torso have no acceleration and jerk limits: neither URDF nor description names any.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownName`].
    pub fn group(&self, name: &str) -> Result<JointGroup, KinematicsError> {
        if !GROUPS.contains(&name) {
            return Err(unknown("group", name, GROUPS.into_iter()));
        }
        let with_torso = name.strip_prefix("torso_");
        let arms = match with_torso.unwrap_or(name) {
            "left" => vec![&self.left],
            "right" => vec![&self.right],
            _ => vec![&self.left, &self.right],
        };
        let base = &self.tree.links[0].name;
        let tips: Vec<&str> = arms.iter().map(|arm| arm.tip_link.as_str()).collect();
        let mut joints: Vec<String> = arms.iter().flat_map(|arm| arm.chain.joint_names.clone()).collect();
        if with_torso.is_some() {
            for tip in &tips {
                joints.extend(self.tree.joints_between(base, tip)?);
            }
        }
        let mut chain = Chain::branching(&self.tree, base, &tips, &joints, &self.home_q)?;
        for (name, limits) in chain.joint_names.iter().zip(&mut chain.limits) {
            for arm in &arms {
                if let Some(idx) = arm.chain.joint_names.iter().position(|own| own == name) {
                    *limits = arm.chain.limits[idx];
                }
            }
        }
        let q_idx = chain.joint_names.iter().map(|name| self.tree.q_idx(name)).collect::<Result<Vec<_>, _>>()?;
        let home_q = q_idx.iter().map(|idx| self.home_q[*idx]).collect();
        let hand_root_links = arms.iter().filter_map(|arm| arm.hand_root_link.clone()).collect();
        Ok(JointGroup { name: name.to_owned(), chain, q_idx, home_q, hand_root_links })
    }

    /// `base_from_link` of every link, in the order of `tree.links`.
    ///
    /// # Panics
    /// If `q` is not a configuration of the whole robot.
    #[must_use]
    pub fn link_poses(&self, q: &[f64]) -> Vec<Pose> {
        self.tree.link_poses(q)
    }

    /// The configuration of the whole robot that is at home but for one arm.
    ///
    /// # Panics
    /// If `arm_q` has not one value for each arm joint.
    #[must_use]
    pub fn q_with_arm(&self, side: HandSide, arm_q: &[f64]) -> Vec<f64> {
        let mut q = self.home_q.clone();
        let idx = &self.arm(side).q_idx;
        assert_eq!(idx.len(), arm_q.len(), "one value for each arm joint");
        for (idx, value) in idx.iter().zip(arm_q) {
            q[*idx] = *value;
        }
        q
    }

    /// The configuration of the whole robot that is at home but for one group.
    ///
    /// # Panics
    /// If `group_q` has not one value for each joint of the group.
    #[must_use]
    pub fn q_with_group(&self, group: &JointGroup, group_q: &[f64]) -> Vec<f64> {
        assert_eq!(group.q_idx.len(), group_q.len(), "one value for each joint of the group");
        let mut q = self.home_q.clone();
        for (idx, value) in group.q_idx.iter().zip(group_q) {
            q[*idx] = *value;
        }
        q
    }

    /// `base_from_camera` of every camera in a configuration of the whole robot.
    #[must_use]
    pub fn camera_poses(&self, q: &[f64]) -> Vec<Pose> {
        let links = self.link_poses(q);
        self.cameras.iter().map(|c| links[c.mount_idx] * c.mount_from_camera).collect()
    }

    fn build(path: &Path, description: RobotDescription, profile: Option<HandProfile>) -> Result<Self, KinematicsError> {
        let urdf_path = beside(path, &description.urdf);
        let mut grafts = Vec::new();
        let mut roots = [None, None];
        if let Some(profile) = &profile {
            let folder = beside(path, &description.hand_profile);
            for (nth, (side, urdf)) in
                [(HandSide::Left, &profile.urdf_left), (HandSide::Right, &profile.urdf_right)].into_iter().enumerate()
            {
                let hand_path = beside(&folder, urdf);
                let mut robot = read_urdf(&hand_path)?;
                add_prefix(&mut robot, side);
                let arm = arm_of(&description, side);
                let broken = |message| KinematicsError::Urdf { path: hand_path.clone(), message };
                roots[nth] = Some(root_link(&robot).map_err(broken)?);
                let origin = urdf_rs::Pose { xyz: urdf_rs::Vec3(arm.hand_mount.xyz), rpy: urdf_rs::Vec3(arm.hand_mount.rpy) };
                grafts.push(Graft { robot, parent_link: arm.tip_link.clone(), parent_from_root: origin });
            }
        }
        let tree = Tree::compile(read_urdf(&urdf_path)?, grafts, &urdf_path)?;
        let home_q = home(&tree, &description, path)?;
        let [left_root, right_root] = roots;
        let left = arm(&tree, &description, HandSide::Left, profile.as_ref(), left_root, &home_q, path)?;
        let right = arm(&tree, &description, HandSide::Right, profile.as_ref(), right_root, &home_q, path)?;
        let cameras = cameras(&tree, &description, &home_q, path)?;
        Ok(Self { description, tree, left, right, hand_profile: profile, cameras, home_q })
    }
}

fn beside(file: &Path, relative: &str) -> std::path::PathBuf {
    file.parent().unwrap_or(Path::new("")).join(relative)
}

fn arm_of(description: &RobotDescription, side: HandSide) -> &ArmDescription {
    match side {
        HandSide::Left => &description.arms.left,
        HandSide::Right => &description.arms.right,
    }
}

/// Gives every name of a hand its side, unless it has it already.
fn add_prefix(robot: &mut urdf_rs::Robot, side: HandSide) {
    let prefix = format!("{}_", side.name());
    let mend = |name: &mut String| {
        if !name.starts_with(&prefix) {
            name.insert_str(0, &prefix);
        }
    };
    robot.links.iter_mut().for_each(|l| mend(&mut l.name));
    for joint in &mut robot.joints {
        mend(&mut joint.name);
        mend(&mut joint.parent.link);
        mend(&mut joint.child.link);
        if let Some(mimic) = &mut joint.mimic {
            mend(&mut mimic.joint);
        }
    }
}

fn home(tree: &Tree, description: &RobotDescription, path: &Path) -> Result<Vec<f64>, KinematicsError> {
    let mut q: Vec<f64> = (0..tree.n_q())
        .map(|idx| {
            let joint = tree.independent_joint(idx);
            0.0_f64.clamp(joint.lower, joint.upper)
        })
        .collect();
    for (name, value) in &description.home_q {
        let bad =
            |message: String| KinematicsError::Description { path: path.to_owned(), key: format!("home_q.{name}"), message };
        let idx = tree.q_idx(name).map_err(|error| bad(error.to_string()))?;
        let joint = tree.independent_joint(idx);
        if !(joint.lower..=joint.upper).contains(value) {
            return Err(bad(format!("{value} lies outside the joint's limits {} .. {}", joint.lower, joint.upper)));
        }
        q[idx] = *value;
    }
    Ok(q)
}

fn arm(
    tree: &Tree,
    description: &RobotDescription,
    side: HandSide,
    profile: Option<&HandProfile>,
    hand_root_link: Option<String>,
    home_q: &[f64],
    path: &Path,
) -> Result<Arm, KinematicsError> {
    let arm = arm_of(description, side);
    let bad = |key: &str, message: String| KinematicsError::Description {
        path: path.to_owned(),
        key: format!("arms.{}.{key}", side.name()),
        message,
    };
    if arm.joints.is_empty() {
        return Err(bad("joints", "expected the arm's joints from shoulder to wrist, found none".to_owned()));
    }
    for (key, values) in [("max_acceleration", &arm.max_acceleration), ("max_jerk", &arm.max_jerk)] {
        if values.len() != arm.joints.len() || !values.iter().all(|v| *v > 0.0 && v.is_finite()) {
            return Err(bad(key, format!("expected {} positive values, found {values:?}", arm.joints.len())));
        }
    }
    let tip_link = match profile {
        None => arm.tip_link.clone(),
        Some(profile) => {
            let prefixed = format!("{}_{}", side.name(), profile.palm_link);
            if tree.link_idx(&profile.palm_link).is_ok() { profile.palm_link.clone() } else { prefixed }
        }
    };
    let base = &tree.links[0].name;
    let mut chain = Chain::new(tree, base, &tip_link, &arm.joints, home_q).map_err(|error| bad("joints", error.to_string()))?;
    if chain.joint_names != arm.joints {
        return Err(bad("joints", format!("must be in order from shoulder to wrist: {:?}", chain.joint_names)));
    }
    for (idx, limits) in chain.limits.iter_mut().enumerate() {
        limits.acceleration = arm.max_acceleration[idx];
        limits.jerk = arm.max_jerk[idx];
    }
    let q_idx = arm.joints.iter().map(|name| tree.q_idx(name)).collect::<Result<Vec<_>, _>>()?;
    let arm_home = q_idx.iter().map(|idx| home_q[*idx]).collect();
    Ok(Arm { side, chain, q_idx, home_q: arm_home, tip_link, hand_root_link })
}

fn cameras(tree: &Tree, description: &RobotDescription, home_q: &[f64], path: &Path) -> Result<Vec<Camera>, KinematicsError> {
    let links = tree.link_poses(home_q);
    let mut all = Vec::new();
    for camera in &description.cameras {
        let bad = |key: &str, message: String| KinematicsError::Description {
            path: path.to_owned(),
            key: format!("cameras.{}.{key}", camera.name),
            message,
        };
        let mount_idx = tree.link_idx(&camera.mount_link).map_err(|error| bad("mount_link", error.to_string()))?;
        let mount_from_camera = match (camera.look_at_in_base, camera.rpy) {
            (Some(point), None) => {
                let base_from_mount = links[mount_idx];
                let eye = base_from_mount * Point3::from(camera.xyz);
                let forward = Point3::from(point) - eye;
                if forward.xy().norm() < 1e-6 {
                    return Err(bad("look_at_in_base", "must not lie straight above or below the camera".to_owned()));
                }
                // face_towards aims +Z and turns +Y as near as possible to the given direction: down.
                let rotation = UnitQuaternion::face_towards(&forward, &-Vector3::z());
                base_from_mount.inverse() * Pose::from_parts(eye.into(), rotation)
            }
            (None, Some(rpy)) => pose(camera.xyz, rpy),
            _ => return Err(bad("look_at_in_base", "give either look_at_in_base or rpy".to_owned())),
        };
        if camera.width_px == 0 || camera.height_px == 0 || !(1.0..179.0).contains(&camera.horizontal_fov_deg) {
            return Err(bad("horizontal_fov_deg", "needs a size above 0 pixels and 1 to 179 degrees".to_owned()));
        }
        let focal = camera.width_px as f64 / 2.0 / (camera.horizontal_fov_deg.to_radians() / 2.0).tan();
        all.push(Camera {
            name: camera.name.clone(),
            mount_idx,
            mount_from_camera,
            intrinsics: CameraIntrinsics {
                width: camera.width_px,
                height: camera.height_px,
                fx: focal,
                fy: focal,
                cx: (camera.width_px as f64 - 1.0) / 2.0,
                cy: (camera.height_px as f64 - 1.0) / 2.0,
            },
        });
    }
    Ok(all)
}
