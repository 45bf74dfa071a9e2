//! What must hold of a URDF before it is compiled: one tree, limits where joints need them, numbers that are numbers.
//!
//! Accepted with a stated meaning: a link without mass (a frame), a continuous or mimicking joint without `<limit>` (none of its
//! own), infinite velocity and effort (no limit), meshes (kept by name and never read, so their paths need not resolve).

use crate::error::KinematicsError;
use std::collections::BTreeMap;
use std::path::Path;
use urdf_rs::{Geometry, Joint, JointLimit, JointType, Link, Pose, Robot};

/// Reads a URDF file.
pub(crate) fn read_urdf(path: &Path) -> Result<Robot, KinematicsError> {
    let text = std::fs::read_to_string(path).map_err(|source| KinematicsError::ReadFile { path: path.to_owned(), source })?;
    urdf_rs::read_from_string(&text).map_err(|error| KinematicsError::Urdf { path: path.to_owned(), message: error.to_string() })
}

/// The one link that is nobody's child.
pub(crate) fn root_link(robot: &Robot) -> Result<String, String> {
    if robot.links.is_empty() {
        return Err("the robot has no links".to_owned());
    }
    let mut roots = robot.links.iter().filter(|l| !robot.joints.iter().any(|j| j.child.link == l.name));
    match (roots.next(), roots.next()) {
        (Some(root), None) => Ok(root.name.clone()),
        (None, _) => Err(format!("there is no root link, as joints run in a circle: {}", circle(robot, &robot.links[0].name))),
        (Some(a), Some(b)) => {
            Err(format!("links {:?} and {:?} both have no parent joint; join one to the other by a fixed joint", a.name, b.name))
        }
    }
}

/// Limits of a joint; without a `<limit>` of its own, where none is needed, it has none.
pub(crate) fn limits(joint: &Joint) -> JointLimit {
    let none = JointLimit { velocity: f64::INFINITY, effort: f64::INFINITY, ..joint.limit.clone() };
    let endless = JointLimit { lower: f64::NEG_INFINITY, upper: f64::INFINITY, ..none };
    match joint.joint_type {
        JointType::Continuous if is_missing(&joint.limit) => endless,
        JointType::Continuous => JointLimit { velocity: joint.limit.velocity, effort: joint.limit.effort, ..endless },
        JointType::Revolute | JointType::Prismatic if is_missing(&joint.limit) => endless,
        _ => joint.limit.clone(),
    }
}

/// The reader gives zeros for what the file leaves out.
fn is_missing(limit: &JointLimit) -> bool {
    [limit.lower, limit.upper, limit.velocity, limit.effort] == [0.0; 4]
}

/// Says what is wrong with a robot.
pub(crate) fn check(robot: &Robot) -> Result<(), String> {
    let mut links: BTreeMap<&str, Option<&Joint>> = BTreeMap::new();
    for link in &robot.links {
        if links.insert(&link.name, None).is_some() {
            return Err(format!("two links have the same name {:?}", link.name));
        }
        check_link(link)?;
    }
    let mut joints: BTreeMap<&str, &Joint> = BTreeMap::new();
    for joint in &robot.joints {
        if joints.insert(&joint.name, joint).is_some() {
            return Err(format!("two joints have the same name {:?}", joint.name));
        }
        let missing = |link: &str| format!("joint {:?} names link {link:?}, which does not exist", joint.name);
        if !links.contains_key(joint.parent.link.as_str()) {
            return Err(missing(&joint.parent.link));
        }
        let holder = links.get_mut(joint.child.link.as_str()).ok_or_else(|| missing(&joint.child.link))?;
        if let Some(other) = holder.replace(joint) {
            let (link, other) = (&joint.child.link, &other.name);
            return Err(format!("link {link:?} is the child of joints {other:?} and {:?}; a link has one parent", joint.name));
        }
        check_joint(joint)?;
    }
    let root = root_link(robot)?;
    for link in &robot.links {
        let mut at = link.name.as_str();
        for _ in 0..robot.links.len() {
            at = links[at].map_or(at, |joint| &joint.parent.link);
        }
        if at != root {
            let circle = circle(robot, at);
            return Err(format!("link {:?} is not connected to root {root:?}, as joints run in a circle: {circle}", link.name));
        }
    }
    Ok(())
}

/// Names of the links of the circle that a link without a way to the root hangs on.
fn circle(robot: &Robot, link: &str) -> String {
    let parent = |link: &str| robot.joints.iter().find(|j| j.child.link == link).map_or("", |j| j.parent.link.as_str());
    let mut names = vec![link];
    loop {
        let next = parent(names[names.len() - 1]);
        if let Some(first) = names.iter().position(|name| *name == next) {
            names.push(next);
            names[first..].reverse();
            return names[first..].join(" -> ");
        }
        names.push(next);
    }
}

fn check_link(link: &Link) -> Result<(), String> {
    let wrong = |what: String| Err(format!("link {:?} has {what}", link.name));
    let mass = link.inertial.mass.value;
    if !mass.is_finite() || mass < 0.0 {
        return wrong(format!("mass {mass}; expected 0 kg or more"));
    }
    let i = &link.inertial.inertia;
    if ![i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz].iter().all(|v| v.is_finite()) || [i.ixx, i.iyy, i.izz].iter().any(|v| *v < 0.0)
    {
        return wrong("an inertia that is not finite or is negative on its diagonal".to_owned());
    }
    if !is_finite(&link.inertial.origin) {
        return wrong("an inertial origin that is not finite".to_owned());
    }
    for collision in &link.collision {
        let sizes = match &collision.geometry {
            Geometry::Box { size } => size.to_vec(),
            Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => vec![*radius, *length],
            Geometry::Sphere { radius } => vec![*radius],
            Geometry::Mesh { scale, .. } => scale.iter().flat_map(|scale| scale.map(f64::abs)).collect(),
        };
        if let Some(size) = sizes.iter().find(|size| !(size.is_finite() && **size >= 0.0)) {
            return wrong(format!("a collision shape of size {size}; expected 0 or more"));
        }
        if !is_finite(&collision.origin) {
            return wrong("a collision origin that is not finite".to_owned());
        }
    }
    Ok(())
}

fn check_joint(joint: &Joint) -> Result<(), String> {
    let wrong = |what: String| Err(format!("joint {:?} {what}", joint.name));
    if !is_finite(&joint.origin) {
        return wrong("has an origin that is not finite".to_owned());
    }
    let is_bounded = matches!(joint.joint_type, JointType::Revolute | JointType::Prismatic);
    if !is_bounded && joint.joint_type != JointType::Continuous {
        return Ok(());
    }
    let axis = nalgebra::Vector3::from(*joint.axis.xyz);
    if !(axis.norm() >= 1e-9 && axis.norm().is_finite()) {
        return wrong(format!("has axis {:?}; expected a direction", *joint.axis.xyz));
    }
    if let Some(mimic) = &joint.mimic
        && ![mimic.multiplier, mimic.offset].iter().flatten().all(|v| v.is_finite())
    {
        return wrong("has a mimic multiplier or offset that is not finite".to_owned());
    }
    let JointLimit { lower, upper, velocity, effort, .. } = joint.limit;
    if is_missing(&joint.limit) {
        if is_bounded && joint.mimic.is_none() {
            let kind = if joint.joint_type == JointType::Revolute { "revolute" } else { "prismatic" };
            let or = if kind == "revolute" { ", or make it continuous" } else { "" };
            return wrong(format!("is {kind} and has no limits; give it <limit lower upper velocity effort>{or}"));
        }
        return Ok(());
    }
    if is_bounded && !(lower.is_finite() && upper.is_finite()) {
        return wrong(format!("has position limits {lower} .. {upper}; expected numbers"));
    }
    if is_bounded && lower > upper {
        return wrong(format!("has lower limit {lower} above upper limit {upper}"));
    }
    // A mimicking joint is as fast as the one that it follows.
    let is_fast = velocity > 0.0 || (velocity == 0.0 && joint.mimic.is_some());
    if !(is_fast && effort >= 0.0) {
        return wrong(format!("has velocity limit {velocity} and effort limit {effort}; expected above 0 and 0 or more"));
    }
    Ok(())
}

fn is_finite(pose: &Pose) -> bool {
    pose.xyz.iter().chain(pose.rpy.iter()).all(|v| v.is_finite())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use crate::shape::Shape;
    use crate::tree::Tree;

    fn load(body: &str) -> Result<Tree, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r.urdf");
        std::fs::write(&path, format!("<robot name='r'>{body}</robot>")).unwrap();
        Tree::load(&path).map_err(|error| error.to_string())
    }

    fn bare_joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
        format!(
            "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/><axis xyz='0 0 1'/>{more}</joint>"
        )
    }

    fn limit(text: &str) -> String {
        format!("<limit {text}/>")
    }

    const LIMIT: &str = "<limit lower='-2' upper='2' velocity='1' effort='1'/>";

    #[track_caller]
    fn refuse(body: &str, expected: &str) {
        let message = load(body).unwrap_err();
        assert!(message.contains(expected) && message.contains("r.urdf"), "{message}");
    }

    /// A robot of a base and a link `l` that joint `a` moves.
    fn one_joint(kind: &str, more: &str) -> String {
        format!("<link name='base'/><link name='l'/>{}", bare_joint("a", kind, "base", "l", more))
    }

    #[test]
    fn what_is_no_tree_is_refused() {
        let links = |names: &str| names.split(' ').map(|name| format!("<link name='{name}'/>")).collect::<String>();
        let fixed = |name: &str, parent: &str, child: &str| bare_joint(name, "fixed", parent, child, "");
        refuse("", "no links");
        refuse(&links("base other"), "\"base\" and \"other\" both have no parent joint");
        refuse(&links("base base"), "two links have the same name \"base\"");
        refuse(&(links("b c d") + &fixed("j", "b", "c") + &fixed("j", "b", "d")), "two joints have the same name \"j\"");
        refuse(&(links("b c") + &fixed("j", "b", "d")), "joint \"j\" names link \"d\"");
        refuse(&(links("b c") + &fixed("j", "d", "c")), "joint \"j\" names link \"d\"");
        refuse(
            &(links("b c d") + &fixed("x", "b", "c") + &fixed("y", "b", "d") + &fixed("z", "d", "c")),
            "joints \"x\" and \"z\"",
        );
        refuse(&(links("b c") + &fixed("x", "b", "c") + &fixed("y", "c", "b")), "in a circle: b -> c -> b");
        let side_loop = links("b c d e") + &fixed("x", "c", "d") + &fixed("y", "d", "c") + &fixed("z", "d", "e");
        refuse(&side_loop, "not connected to root \"b\"");
        refuse(&(links("b c") + &fixed("x", "c", "c")), "in a circle: c -> c");
        refuse(&one_joint("planar", LIMIT), "only fixed, revolute");
        refuse("<link name='b'><inertial/></link>", "r.urdf");
    }

    #[test]
    fn limits_are_asked_for_where_they_are_needed() {
        refuse(&one_joint("revolute", ""), "joint \"a\" is revolute and has no limits");
        refuse(&one_joint("prismatic", ""), "joint \"a\" is prismatic and has no limits");
        refuse(&one_joint("revolute", &limit("lower='3' upper='2' velocity='1' effort='1'")), "above upper limit 2");
        refuse(&one_joint("revolute", &limit("lower='nan' upper='2' velocity='1' effort='1'")), "position limits NaN .. 2");
        refuse(&one_joint("prismatic", &limit("lower='0' upper='inf' velocity='1' effort='1'")), "position limits 0 .. inf");
        refuse(&one_joint("revolute", &limit("lower='-1' upper='2' velocity='0' effort='1'")), "velocity limit 0");
        refuse(&one_joint("continuous", &limit("velocity='nan' effort='1'")), "velocity limit NaN");
        refuse(&one_joint("revolute", &limit("lower='-1' upper='2' velocity='1' effort='-1'")), "effort limit -1");
        let continuous = load(&one_joint("continuous", "")).unwrap().joints.remove(0);
        assert_eq!((continuous.lower, continuous.upper), (f64::NEG_INFINITY, f64::INFINITY));
        assert_eq!((continuous.velocity, continuous.effort), (f64::INFINITY, f64::INFINITY));
        let fast = limit("lower='-1' upper='1' velocity='inf' effort='inf'");
        assert_eq!(load(&one_joint("revolute", &fast)).unwrap().joints[0].velocity, f64::INFINITY);
        let follower = bare_joint("b", "revolute", "l", "m", "<mimic joint='a'/>");
        let mimicking = load(&(one_joint("revolute", LIMIT) + "<link name='m'/>" + &follower)).unwrap();
        assert_eq!((mimicking.joints[1].lower, mimicking.n_q()), (f64::NEG_INFINITY, 1));
    }

    #[test]
    fn masses_and_numbers_make_sense() {
        let inertial = |mass: &str, ixx: &str| {
            format!(
                "<link name='b'><inertial><mass value='{mass}'/>\
                 <inertia ixx='{ixx}' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>"
            )
        };
        refuse(&inertial("-0.1", "1"), "link \"b\" has mass -0.1");
        refuse(&inertial("nan", "1"), "mass NaN");
        refuse(&inertial("heavy", "1"), "r.urdf");
        refuse(&inertial("1", "-1"), "inertia");
        refuse(&inertial("1", "inf"), "inertia");
        assert_eq!(load(&inertial("0", "0")).unwrap().links[0].inertial.mass_kg, 0.0);
        refuse(&one_joint("revolute", LIMIT).replace("0 0 1", "0 0 0"), "axis [0.0, 0.0, 0.0]");
        refuse(&one_joint("revolute", LIMIT).replace("0 0 1", "0 nan 1"), "axis [0.0, NaN, 1.0]");
        refuse(&one_joint("fixed", "<origin xyz='0 0 inf'/>"), "joint \"a\" has an origin");
        let shape = |shape: &str, origin: &str| {
            format!("<link name='b'><collision>{origin}<geometry>{shape}</geometry></collision></link>")
        };
        refuse(&shape("<sphere radius='-1'/>", ""), "size -1");
        refuse(&shape("<box size='1 nan 1'/>", ""), "size NaN");
        refuse(&shape("<sphere radius='1'/>", "<origin xyz='nan 0 0'/>"), "collision origin");
        // Nothing reads it, so that it need not be there.
        let mesh = load(&shape("<mesh filename='package://nowhere/arm.stl'/>", "")).unwrap();
        assert_eq!(
            mesh.links[0].collision[0].shape,
            Shape::Mesh { file: "package://nowhere/arm.stl".to_owned(), scale: sfg_types::Vector::repeat(1.0) }
        );
    }

    #[test]
    fn mimics_follow_a_joint_that_moves() {
        let with = |mimic: &str| one_joint("revolute", &format!("{LIMIT}<mimic {mimic}/>"));
        refuse(&with("joint='x'"), "joint \"a\" mimics \"x\", which does not exist");
        refuse(&with("joint='a'"), "\"a\" mimics itself in a circle");
        refuse(&with("joint='a' multiplier='nan'"), "multiplier or offset");
        let second = |mimic: &str| bare_joint("b", "revolute", "l", "m", &format!("{LIMIT}<mimic joint='{mimic}'/>"));
        refuse(&(with("joint='b'") + "<link name='m'/>" + &second("a")), "in a circle");
        refuse(&(one_joint("fixed", "") + "<link name='m'/>" + &second("a")), "mimics fixed joint \"a\"");
    }
}
