//! The acting arm and hand in the physics world, and the rest of the robot as fixed shapes around them.

use crate::WorldError;
use crate::bodies::{HandLink, Role};
use crate::convert::to_physics;
use crate::hand::SimulatedHand;
use crate::judge::{Finger, MotorCap, Posture};
use crate::multibody::{Articulation, FRICTION_RULE, LinkSettings, Servo, shared_shape};
use crate::settings::{ARM_ARMATURE_KG_M2, FINGER_ARMATURE_KG_M2};
use rapier3d::prelude::*;
use sfg_kinematics::{Primitive, RobotModel};
use sfg_types::{HandFeedback, HandProfile, HandSide, Pose as Pose64, RobotCommand};

/// The acting robot: moves, touches things and the table.
pub(crate) const GROUP_ACTING: Group = Group::GROUP_1;
/// The rest of the robot: fixed. The acting arm passes through it; keeping clear of it is the planner's work.
pub(crate) const GROUP_STATIC: Group = Group::GROUP_2;
/// Table and objects.
pub(crate) const GROUP_SCENE: Group = Group::GROUP_3;
/// Grains.
pub(crate) const GROUP_GRAIN: Group = Group::GROUP_4;

/// Arm servo gains of the strong joints 1-4 and the weak joints 5-7: palm error 0.6 mm while moving, 0.13 mm at rest.
const STRONG: [f64; 2] = [20_000.0, 500.0];
const WEAK: [f64; 2] = [5_000.0, 125.0];
/// Joints with more effort than this are strong, Nm (the Panda has 87 and 12).
const STRONG_EFFORT_NM: f64 = 40.0;

/// One link as the renderer needs it: primitives on a body.
#[derive(Clone, Debug)]
pub(crate) struct VisibleLink {
    pub(crate) name: String,
    pub(crate) shapes: Vec<Primitive>,
    pub(crate) place: Place,
}

/// Where a visible link is.
#[derive(Clone, Debug)]
pub(crate) enum Place {
    Fixed(Pose64),
    OnBody(RigidBodyHandle, Pose64),
}

/// Arm and hand that act.
#[derive(Debug)]
pub(crate) struct ActingRobot {
    pub(crate) side: HandSide,
    pub(crate) articulation: Articulation,
    hand: SimulatedHand,
    profile: HandProfile,
    arm_idx: Vec<usize>,
    palm: RigidBodyHandle,
    body_from_palm: Pose64,
    set_point: RobotCommand,
}

impl ActingRobot {
    /// Puts the robot into the world at its home pose.
    pub(crate) fn spawn(
        physics: &mut PhysicsWorld,
        robot: &RobotModel,
        side: HandSide,
        friction: f64,
    ) -> Result<Self, WorldError> {
        let broken = |message: String| WorldError::Robot { message };
        let arm = robot.arm(side);
        let profile = robot.hand_profile.clone().ok_or_else(|| broken("was loaded without hands".to_owned()))?;
        let first = robot.tree.joints.iter().find(|joint| Some(&joint.name) == arm.chain.joint_names.first());
        let root_idx = first.ok_or_else(|| broken("the acting arm has no joint".to_owned()))?.parent_idx;
        let settings = LinkSettings {
            friction,
            collision_groups: InteractionGroups::new(GROUP_ACTING, GROUP_SCENE | GROUP_GRAIN, InteractionTestMode::And),
            armature: |name| {
                if name.contains("panda") || name.contains("arm") { ARM_ARMATURE_KG_M2 } else { FINGER_ARMATURE_KG_M2 }
            },
        };
        let base_from_root = robot.link_poses(&robot.home_q)[root_idx];
        let root_name = robot.tree.links[root_idx].name.clone();
        let articulation = Articulation::spawn(physics, &robot.tree, &root_name, &base_from_root, &robot.home_q, &settings)?;
        let hand = SimulatedHand::new(&profile, &articulation, &format!("{}_", side.name()))?;
        let arm_idx = arm.chain.joint_names.iter().map(|name| articulation.joint_idx(name)).collect::<Result<Vec<_>, _>>()?;
        let palm = articulation.link(&arm.tip_link)?;
        let (palm, body_from_palm) = (palm.body, palm.body_from_link);
        let n_arm = arm_idx.len();
        let set_point =
            RobotCommand { side, q: arm.home_q.clone(), dq: vec![0.0; n_arm], hand: sfg_types::HandCommand::default() };
        Ok(Self { side, articulation, hand, profile, arm_idx, palm, body_from_palm, set_point })
    }

    /// The links of the hand, tagged as such; every other collider of the robot keeps role 0.
    pub(crate) fn tag_hand(&self, physics: &mut PhysicsWorld, robot: &RobotModel) -> Vec<HandLink> {
        let tree = &robot.tree;
        let Some(root) = &robot.arm(self.side).hand_root_link else { return Vec::new() };
        let mut in_hand = vec![false; tree.links.len()];
        let mut links = Vec::new();
        // Colliders of a body stand in the order of the tree's links, each link's shapes in the order of its file.
        let mut taken: Vec<(RigidBodyHandle, usize)> = Vec::new();
        for (link_idx, link) in tree.links.iter().enumerate() {
            let parent = link.joint_idx.map(|joint_idx| tree.joints[joint_idx].parent_idx);
            in_hand[link_idx] = link.name == *root || parent.is_some_and(|idx| in_hand[idx]);
            let Ok(place) = self.articulation.link(&link.name) else { continue };
            let slot = taken.iter().position(|(body, _)| *body == place.body).unwrap_or_else(|| {
                taken.push((place.body, 0));
                taken.len() - 1
            });
            let n_before = taken[slot].1;
            taken[slot].1 += link.collision.len();
            let colliders = physics.bodies[place.body].colliders()[n_before..n_before + link.collision.len()].to_vec();
            let Some(finger) = Finger::from_name(&link.name).filter(|_| in_hand[link_idx]) else { continue };
            let is_tip = finger != Finger::Palm && !tree.joints.iter().any(|joint| joint.parent_idx == link_idx);
            for collider in &colliders {
                physics.colliders[*collider].user_data = Role::Hand(links.len()).encode();
            }
            links.push(HandLink { name: link.name.clone(), finger, is_tip, body: place.body, colliders });
        }
        links
    }

    /// Links for pictures: those of the acting arm and hand on their bodies, the others where home puts them.
    pub(crate) fn visible_links(&self, robot: &RobotModel) -> Vec<VisibleLink> {
        let home = robot.link_poses(&robot.home_q);
        let place = |idx: usize, name: &str| match self.articulation.link(name) {
            Ok(link) => Place::OnBody(link.body, link.body_from_link),
            Err(_) => Place::Fixed(home[idx]),
        };
        let links = robot.tree.links.iter().enumerate().filter(|(_, link)| !link.collision.is_empty());
        links
            .map(|(idx, link)| VisibleLink {
                name: link.name.clone(),
                shapes: link.collision.clone(),
                place: place(idx, &link.name),
            })
            .collect()
    }

    /// The motors of arm and hand with the torque that the robot's files allow them.
    pub(crate) fn motor_caps(&self, physics: &PhysicsWorld, robot: &RobotModel) -> Vec<MotorCap> {
        let tree = &robot.tree;
        let prefix = format!("{}_", self.side.name());
        let mut caps = Vec::new();
        for (handle, _, _, link) in physics.multibody_joints.iter() {
            let body = link.rigid_body_handle();
            for joint in tree.joints.iter().filter(|j| j.kind != sfg_kinematics::JointKind::Fixed) {
                let on_body = self.articulation.link(&tree.links[joint.child_idx].name).is_ok_and(|l| l.body == body);
                if !on_body {
                    continue;
                }
                let in_hand =
                    self.profile.joints.iter().find(|j| format!("{prefix}{}", j.name) == joint.name || j.name == joint.name);
                caps.push(MotorCap {
                    joint: handle,
                    axis: JointAxis::AngX,
                    name: joint.name.clone(),
                    max_nm: in_hand.map_or(joint.effort, |j| j.max_torque_nm) as f32 * (1.0 + 1e-6),
                });
            }
        }
        caps
    }

    /// Takes a new set point.
    pub(crate) fn set_command(&mut self, command: &RobotCommand) -> Result<(), WorldError> {
        let refused = |message: String| Err(WorldError::Command { message });
        let n = self.arm_idx.len();
        if command.side != self.side {
            return refused(format!("it is for the {} arm, the acting one is {}", command.side.name(), self.side.name()));
        }
        if command.q.len() != n || command.dq.len() != n {
            return refused(format!(
                "it has {} positions and {} velocities, the arm has {n} joints",
                command.q.len(),
                command.dq.len()
            ));
        }
        let numbers = command.q.iter().chain(&command.dq).chain([&command.hand.synergy, &command.hand.manipulation]);
        if !numbers.into_iter().all(|value| value.is_finite()) {
            return refused("it contains a number that is not finite".to_owned());
        }
        self.set_point = command.clone();
        Ok(())
    }

    /// Sets all servos for the coming step.
    pub(crate) fn drive(&mut self, physics: &mut PhysicsWorld) {
        for (nth, joint_idx) in self.arm_idx.iter().enumerate() {
            let max_effort = self.articulation.joints()[*joint_idx].effort;
            let [kp, kd] = if max_effort > STRONG_EFFORT_NM { STRONG } else { WEAK };
            let servo = Servo { position: self.set_point.q[nth], velocity: self.set_point.dq[nth], kp, kd, max_effort };
            self.articulation.set_servo(physics, *joint_idx, &servo);
        }
        self.hand.step(physics, &self.articulation, self.set_point.hand);
    }

    pub(crate) fn arm_q(&self, physics: &PhysicsWorld) -> Vec<f64> {
        let q = self.articulation.q(physics);
        self.arm_idx.iter().map(|idx| q[*idx]).collect()
    }

    pub(crate) fn arm_dq(&self, physics: &PhysicsWorld) -> Vec<f64> {
        let dq = self.articulation.dq(physics);
        self.arm_idx.iter().map(|idx| dq[*idx]).collect()
    }

    pub(crate) fn hand_feedback(&self) -> HandFeedback {
        self.hand.feedback()
    }

    /// Tension of the stronger motor, Nm at ratio 1, and the largest allowed.
    pub(crate) fn tension_nm(&self) -> f64 {
        self.hand.tensions_nm().iter().map(|u| u.abs()).sum()
    }

    pub(crate) fn max_tension_nm(&self) -> f64 {
        self.profile.max_tension_nm
    }

    /// Finger joints by name, radians: for the judge and the viewer only.
    pub(crate) fn hand_joints(&self, physics: &PhysicsWorld) -> Vec<(String, f64)> {
        let q = self.hand.hand_q(physics, &self.articulation);
        self.profile.joints.iter().map(|joint| joint.name.clone()).zip(q).collect()
    }

    pub(crate) fn base_from_palm(&self, physics: &PhysicsWorld) -> Pose64 {
        crate::convert::from_physics(physics.bodies[self.palm].position()) * self.body_from_palm
    }

    /// Flexion of the fingers and opposition of the thumb, as shares of their ranges.
    pub(crate) fn posture(&self, physics: &PhysicsWorld) -> Posture {
        let q = self.hand.hand_q(physics, &self.articulation);
        let share = |wanted: &dyn Fn(&str) -> bool| {
            let joints = self.profile.joints.iter().zip(&q).filter(|(joint, _)| wanted(&joint.name));
            let shares: Vec<f64> = joints.map(|(j, q)| (q - j.lower_rad) / (j.upper_rad - j.lower_rad)).collect();
            if shares.is_empty() { 0.0 } else { shares.iter().sum::<f64>() / shares.len() as f64 }
        };
        let flexion = |finger: Finger| share(&|name| Finger::from_name(name) == Some(finger) && !name.contains("abduction"));
        Posture { flexion: Finger::LONG.map(flexion), thumb_opposition: share(&|name| name.contains("thumb_abduction")) }
    }
}

/// Fixed colliders for every link that the articulation does not hold.
pub(crate) fn insert_static_robot(
    physics: &mut PhysicsWorld,
    robot: &RobotModel,
    acting: &Articulation,
    friction: f64,
) -> Result<(), WorldError> {
    let home = robot.link_poses(&robot.home_q);
    let body = physics.insert_body(RigidBodyBuilder::fixed());
    for (link, base_from_link) in robot.tree.links.iter().zip(&home) {
        if acting.link(&link.name).is_ok() {
            continue;
        }
        for part in &link.collision {
            let message = || format!("link {:?} has a mesh as collision shape", link.name);
            let (shape, part_from_shape) = shared_shape(&part.shape).ok_or_else(|| WorldError::Robot { message: message() })?;
            let collider = ColliderBuilder::new(shape)
                .position(to_physics(&(base_from_link * part.link_from_shape * part_from_shape)))
                .friction(friction as f32)
                .friction_combine_rule(FRICTION_RULE)
                .collision_groups(InteractionGroups::new(GROUP_STATIC, GROUP_SCENE | GROUP_GRAIN, InteractionTestMode::And))
                .user_data(Role::Robot.encode());
            physics.insert_collider(collider, Some(body));
        }
    }
    Ok(())
}
