//! A robot as a tree of links, compiled from URDF: parents first, mimic chains resolved to the joint that really moves.

use crate::error::KinematicsError;
use crate::shape::{Primitive, pose, primitives};
use crate::urdf::{check, limits, read_urdf, root_link};
use nalgebra::{Matrix3, Translation3, Unit, UnitQuaternion};
use sfg_types::{Pose, Vector};
use std::collections::BTreeMap;
use std::path::Path;

/// Mass properties in the link frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// Mass; 0 when the URDF gives none: such a link is a frame without weight.
    pub mass_kg: f64,
    /// Frame of the inertia: its origin is the centre of mass.
    pub link_from_inertia: Pose,
    /// Inertia about the centre of mass, kg m^2.
    pub inertia: Matrix3<f64>,
}

/// One rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Name in the URDF; links of a hand carry `left_` or `right_`.
    pub name: String,
    /// The joint that holds it: index into [`Tree::joints`]; `None` for the root.
    pub joint_idx: Option<usize>,
    /// Collision shapes.
    pub collision: Vec<Primitive>,
    /// Mass properties.
    pub inertial: Inertial,
}

/// How a joint moves its child.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointKind {
    /// Not at all.
    Fixed,
    /// About the axis, radians.
    Revolute,
    /// Along the axis, metres.
    Prismatic,
}

/// Where a joint's value comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum JointSource {
    /// Fixed joints have none.
    None,
    /// `q[q_idx]` itself.
    Independent {
        /// Index into the configuration.
        q_idx: usize,
    },
    /// `multiplier * q[q_idx] + offset`; nested mimics are already multiplied out.
    Mimic {
        /// Index into the configuration.
        q_idx: usize,
        /// Factor.
        multiplier: f64,
        /// Added, radians or metres.
        offset: f64,
    },
}

/// One joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF; joints of a hand carry `left_` or `right_`.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Parent link, index into [`Tree::links`].
    pub parent_idx: usize,
    /// Child link, index into [`Tree::links`].
    pub child_idx: usize,
    /// Pose of the joint at value 0.
    pub parent_from_joint: Pose,
    /// Axis in the joint frame.
    pub axis: Unit<Vector>,
    /// Lower limit, radians or metres; minus infinity for continuous joints and for mimicking ones without a limit of their own.
    pub lower: f64,
    /// Upper limit.
    pub upper: f64,
    /// Largest speed, rad/s or m/s; infinite when the URDF may leave it out and does.
    pub velocity: f64,
    /// Largest torque or force, Nm or N; likewise.
    pub effort: f64,
    /// Where its value comes from.
    pub source: JointSource,
}

impl Joint {
    /// The joint's value in configuration `q` of the tree.
    #[must_use]
    pub fn value(&self, q: &[f64]) -> f64 {
        match self.source {
            JointSource::None => 0.0,
            JointSource::Independent { q_idx } => q[q_idx],
            JointSource::Mimic { q_idx, multiplier, offset } => multiplier * q[q_idx] + offset,
        }
    }

    /// Pose of the child link in the parent link at a joint value.
    #[must_use]
    pub fn parent_from_child(&self, value: f64) -> Pose {
        match self.kind {
            JointKind::Fixed => self.parent_from_joint,
            JointKind::Revolute => self.parent_from_joint * UnitQuaternion::from_axis_angle(&self.axis, value),
            JointKind::Prismatic => self.parent_from_joint * Translation3::from(self.axis.into_inner() * value),
        }
    }
}

/// Links and joints, parents before children; link 0 is the root.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// All links.
    pub links: Vec<Link>,
    /// All joints; `joints[i]` holds `links[i + 1]`.
    pub joints: Vec<Joint>,
    /// Names of the independent joints: the order of every configuration `q` of the whole robot.
    pub q_names: Vec<String>,
}

/// A hand to be hung on a link.
pub(crate) struct Graft {
    pub robot: urdf_rs::Robot,
    pub parent_link: String,
    pub parent_from_root: urdf_rs::Pose,
}

impl Tree {
    /// Reads and compiles one URDF.
    ///
    /// # Errors
    /// [`KinematicsError::ReadFile`] and [`KinematicsError::Urdf`], naming the file.
    pub fn load(path: &Path) -> Result<Self, KinematicsError> {
        Self::compile(read_urdf(path)?, Vec::new(), path)
    }

    /// Compiles a robot with hands hung on it; `path` is for messages.
    pub(crate) fn compile(mut robot: urdf_rs::Robot, grafts: Vec<Graft>, path: &Path) -> Result<Self, KinematicsError> {
        let broken = |message: String| KinematicsError::Urdf { path: path.to_owned(), message };
        for graft in grafts {
            let root = root_link(&graft.robot).map_err(&broken)?;
            let mount = format!("{root}_mount");
            robot.links.extend(graft.robot.links);
            robot.joints.extend(graft.robot.joints);
            robot.joints.push(urdf_rs::Joint {
                name: mount,
                joint_type: urdf_rs::JointType::Fixed,
                origin: graft.parent_from_root,
                parent: urdf_rs::LinkName { link: graft.parent_link },
                child: urdf_rs::LinkName { link: root },
                axis: urdf_rs::Axis::default(),
                limit: urdf_rs::JointLimit::default(),
                calibration: None,
                dynamics: None,
                mimic: None,
                safety_controller: None,
            });
        }
        check(&robot).map_err(&broken)?;
        let root = root_link(&robot).map_err(&broken)?;
        let by_name: BTreeMap<&str, &urdf_rs::Link> = robot.links.iter().map(|l| (l.name.as_str(), l)).collect();
        let mut tree = Self { links: Vec::new(), joints: Vec::new(), q_names: Vec::new() };
        // Depth first in file order, so that a configuration lists joints as the file does.
        let mut pending: Vec<(Option<(usize, &urdf_rs::Joint)>, &str)> = vec![(None, &root)];
        while let Some((holder, name)) = pending.pop() {
            let link = by_name[name];
            let link_idx = tree.links.len();
            if let Some((parent_idx, joint)) = holder {
                tree.joints.push(compile_joint(joint, parent_idx, link_idx).map_err(&broken)?);
            }
            tree.links.push(Link {
                name: name.to_owned(),
                joint_idx: holder.map(|_| tree.joints.len() - 1),
                collision: primitives(&link.collision),
                inertial: inertial(&link.inertial),
            });
            let children = robot.joints.iter().rev().filter(|j| j.parent.link == name);
            pending.extend(children.map(|j| (Some((link_idx, j)), j.child.link.as_str())));
        }
        tree.resolve_sources(&robot).map_err(&broken)?;
        Ok(tree)
    }

    /// Number of independent joints.
    #[must_use]
    pub fn n_q(&self) -> usize {
        self.q_names.len()
    }

    /// Index of a link.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownName`].
    pub fn link_idx(&self, name: &str) -> Result<usize, KinematicsError> {
        let names = || self.links.iter().map(|l| l.name.as_str());
        names().position(|n| n == name).ok_or_else(|| unknown("link", name, names()))
    }

    /// Index of an independent joint in a configuration.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownName`].
    pub fn q_idx(&self, name: &str) -> Result<usize, KinematicsError> {
        let names = || self.q_names.iter().map(String::as_str);
        names().position(|n| n == name).ok_or_else(|| unknown("joint", name, names()))
    }

    /// The independent joint at `q_idx`.
    ///
    /// # Panics
    /// If `q_idx` is not below [`Self::n_q`].
    #[must_use]
    pub fn independent_joint(&self, q_idx: usize) -> &Joint {
        let found = self.joints.iter().find(|j| j.source == JointSource::Independent { q_idx });
        found.expect("every configuration entry belongs to one joint")
    }

    /// Names of the independent joints that move something between two links, in the order of a configuration.
    ///
    /// # Errors
    /// [`KinematicsError::UnknownName`], or [`KinematicsError::NoChain`] when the tip does not hang on the base.
    pub fn joints_between(&self, base_link: &str, tip_link: &str) -> Result<Vec<String>, KinematicsError> {
        let base_idx = self.link_idx(base_link)?;
        let mut link_idx = self.link_idx(tip_link)?;
        let mut moves = vec![false; self.n_q()];
        while link_idx != base_idx {
            let no_chain = || KinematicsError::NoChain { base: base_link.to_owned(), tip: tip_link.to_owned() };
            let joint = &self.joints[self.links[link_idx].joint_idx.ok_or_else(no_chain)?];
            if let JointSource::Independent { q_idx } | JointSource::Mimic { q_idx, .. } = joint.source {
                moves[q_idx] = true;
            }
            link_idx = joint.parent_idx;
        }
        Ok(self.q_names.iter().zip(moves).filter(|(_, moves)| *moves).map(|(name, _)| name.clone()).collect())
    }

    /// `root_from_link` of every link, in the order of [`Self::links`].
    ///
    /// # Panics
    /// If `q` has not [`Self::n_q`] values.
    #[must_use]
    pub fn link_poses(&self, q: &[f64]) -> Vec<Pose> {
        assert_eq!(q.len(), self.n_q(), "a configuration has one value for each independent joint");
        let mut poses = Vec::with_capacity(self.links.len());
        for link in &self.links {
            poses.push(match link.joint_idx {
                None => Pose::identity(),
                Some(idx) => {
                    let joint = &self.joints[idx];
                    poses[joint.parent_idx] * joint.parent_from_child(joint.value(q))
                }
            });
        }
        poses
    }

    /// Gives every moving joint its source; follows mimics of mimics to the end.
    fn resolve_sources(&mut self, robot: &urdf_rs::Robot) -> Result<(), String> {
        let by_name: BTreeMap<&str, &urdf_rs::Joint> = robot.joints.iter().map(|j| (j.name.as_str(), j)).collect();
        for joint in &mut self.joints {
            if joint.kind != JointKind::Fixed && by_name[joint.name.as_str()].mimic.is_none() {
                joint.source = JointSource::Independent { q_idx: self.q_names.len() };
                self.q_names.push(joint.name.clone());
            }
        }
        for joint in &mut self.joints {
            let (mut multiplier, mut offset) = (1.0, 0.0);
            let mut current = by_name[joint.name.as_str()];
            let mut n_hops = 0;
            while let Some(mimic) = &current.mimic {
                offset += multiplier * mimic.offset.unwrap_or(0.0);
                multiplier *= mimic.multiplier.unwrap_or(1.0);
                current = by_name
                    .get(mimic.joint.as_str())
                    .ok_or_else(|| format!("joint {:?} mimics {:?}, which does not exist", current.name, mimic.joint))?;
                n_hops += 1;
                if n_hops > by_name.len() {
                    return Err(format!("joint {:?} mimics itself in a circle", joint.name));
                }
            }
            if n_hops > 0 && joint.kind != JointKind::Fixed {
                let q_idx = self.q_names.iter().position(|n| *n == current.name);
                let q_idx = q_idx.ok_or_else(|| format!("joint {:?} mimics fixed joint {:?}", joint.name, current.name))?;
                joint.source = JointSource::Mimic { q_idx, multiplier, offset };
            }
        }
        Ok(())
    }
}

fn compile_joint(joint: &urdf_rs::Joint, parent_idx: usize, child_idx: usize) -> Result<Joint, String> {
    use urdf_rs::JointType as T;
    let kind = match joint.joint_type {
        // A floating base is welded: the robot stands where the scenario puts it.
        T::Fixed | T::Floating => JointKind::Fixed,
        T::Revolute | T::Continuous => JointKind::Revolute,
        T::Prismatic => JointKind::Prismatic,
        T::Planar | T::Spherical => {
            return Err(format!(
                "joint {:?} is {:?}; only fixed, revolute, continuous and prismatic joints are supported",
                joint.name, joint.joint_type
            ));
        }
    };
    let axis = Vector::from(*joint.axis.xyz);
    let limits = limits(joint);
    Ok(Joint {
        name: joint.name.clone(),
        kind,
        parent_idx,
        child_idx,
        parent_from_joint: pose(&joint.origin),
        axis: if kind == JointKind::Fixed { Vector::x_axis() } else { Unit::new_normalize(axis) },
        lower: limits.lower,
        upper: limits.upper,
        velocity: limits.velocity,
        effort: limits.effort,
        source: JointSource::None,
    })
}

fn inertial(i: &urdf_rs::Inertial) -> Inertial {
    let m = &i.inertia;
    Inertial {
        mass_kg: i.mass.value,
        link_from_inertia: pose(&i.origin),
        inertia: Matrix3::new(m.ixx, m.ixy, m.ixz, m.ixy, m.iyy, m.iyz, m.ixz, m.iyz, m.izz),
    }
}

pub(crate) fn unknown<'a>(what: &'static str, name: &str, known: impl Iterator<Item = &'a str>) -> KinematicsError {
    let known: Vec<&str> = known.collect();
    let nearest = known.iter().max_by_key(|k| common_letters(k, name)).copied().unwrap_or("").to_owned();
    KinematicsError::UnknownName { what, name: name.to_owned(), n_known: known.len(), nearest }
}

/// Length of the common beginning plus the common end: enough to find a mistyped name.
fn common_letters(a: &str, b: &str) -> usize {
    let same = |pair: &(char, char)| pair.0 == pair.1;
    let head = a.chars().zip(b.chars()).take_while(same).count();
    let tail = a.chars().rev().zip(b.chars().rev()).take_while(same).count();
    head + tail
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn tree(body: &str) -> Result<Tree, String> {
        let robot = urdf_rs::read_from_string(&format!("<robot name='r'>{body}</robot>")).map_err(|e| e.to_string())?;
        Tree::compile(robot, Vec::new(), Path::new("r.urdf")).map_err(|e| e.to_string())
    }

    fn joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
        format!(
            "<link name='{child}'/><joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='1 0 0'/><axis xyz='0 0 1'/><limit lower='-2' upper='2' velocity='1' effort='1'/>{more}</joint>"
        )
    }

    #[test]
    fn mimics_of_mimics_are_multiplied_out() {
        let body = [
            "<link name='base'/>".to_owned(),
            joint("c", "revolute", "base", "l1", "<mimic joint='b' multiplier='-2' offset='0.25'/>"),
            joint("b", "revolute", "l1", "l2", "<mimic joint='a' multiplier='0.5' offset='0.1'/>"),
            joint("a", "prismatic", "l2", "l3", ""),
        ]
        .concat();
        let tree = tree(&body).unwrap();
        assert_eq!(tree.q_names, ["a"]);
        let values: Vec<f64> = tree.joints.iter().map(|j| j.value(&[0.4])).collect();
        let gaps: f64 = values.iter().zip([-0.35, 0.3, 0.4]).map(|(a, b): (&f64, f64)| (a - b).abs()).sum();
        assert!(gaps < 1e-12, "{values:?}");
        // Yaw -0.35, then 0.3, then 0.4 along z, each after 1 m along x.
        let tip = tree.link_poses(&[0.4])[3].translation.vector;
        let expected = Vector::new(1.0 + (-0.35_f64).cos() + (-0.05_f64).cos(), (-0.35_f64).sin() + (-0.05_f64).sin(), 0.4);
        assert!((tip - expected).norm() < 1e-12, "{tip}");
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest_one() {
        let tree = tree(&format!("<link name='base'/>{}", joint("elbow", "revolute", "base", "forearm", ""))).unwrap();
        assert_eq!(
            tree.link_idx("forarm").unwrap_err().to_string(),
            "no link is called \"forarm\"; the nearest of 2 names is \"forearm\""
        );
    }
}
