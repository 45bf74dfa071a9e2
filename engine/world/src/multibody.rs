//! Arm and hand as one fixed-base rapier multibody, built from the compiled robot tree.
//!
//! Why a multibody: hands on impulse joints lose a third of the grasps that hold elsewhere, and a kinematic palm loses most. The
//! root is a fixed body, links joined by fixed joints are merged into one, mimic joints are not followed (none on the arm).
//! `gravity_scale(0)` on every link is exact gravity compensation of the robot itself, not of what it carries; motor limits
//! therefore bound only what the load and the motion ask for.

use crate::convert::{from_physics, to_physics, vector_to_physics};
use crate::error::WorldError;
use nalgebra::{Matrix3, UnitQuaternion};
use rapier3d::glamx::{Mat3, Vec3};
use rapier3d::prelude::{
    CoefficientCombineRule, Collider, ColliderBuilder, GenericJoint, InteractionGroups, JointAxesMask, JointAxis, MassProperties,
    MotorModel, Multibody, MultibodyJointHandle, MultibodyLink, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, SharedShape,
};
use sfg_kinematics::{JointKind, Shape, Tree};
use sfg_types::{Pose, Vector};

/// What is the same for every link of an articulation.
#[derive(Clone, Copy, Debug)]
pub struct LinkSettings {
    /// Friction coefficient of the links. Both colliders of a pair must use [`FRICTION_RULE`], so the pair has the smaller one.
    pub friction: f64,
    /// Who may touch the links. Links of one articulation never touch each other.
    pub collision_groups: InteractionGroups,
    /// Inertia added to a joint by motor and gear, kg m^2 or kg, by joint name.
    pub armature: fn(&str) -> f64,
}

/// How the friction of a pair follows from its two materials: the smaller one.
pub const FRICTION_RULE: CoefficientCombineRule = CoefficientCombineRule::Min;

/// A servo: torque = `kp (position - q) + kd (velocity - dq)`, cut at `max_effort`. Solved implicitly, so stable at any gain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Servo {
    /// Set point, radians or metres; for a trajectory, the value at the END of the next step.
    pub position: f64,
    /// Its derivative.
    pub velocity: f64,
    /// Nm/rad or N/m.
    pub kp: f64,
    /// Nms/rad or Ns/m.
    pub kd: f64,
    /// Largest torque or force.
    pub max_effort: f64,
}

impl Servo {
    /// The torque of this servo at a joint state, which rapier itself does not report for multibodies.
    #[must_use]
    pub fn effort(&self, q: f64, dq: f64) -> f64 {
        (self.kp * (self.position - q) + self.kd * (self.velocity - dq)).clamp(-self.max_effort, self.max_effort)
    }
}

/// One moving joint of an articulation; its place in [`Articulation::joints`] is its place in `q`.
#[derive(Clone, Debug)]
pub struct ArticulatedJoint {
    /// Name in the tree.
    pub name: String,
    /// Lower limit, radians or metres.
    pub lower: f64,
    /// Upper limit.
    pub upper: f64,
    /// Largest effort in the URDF.
    pub effort: f64,
    handle: MultibodyJointHandle,
    axis: JointAxis,
}

/// A link of the tree inside an articulation: several links share a body when fixed joints connect them.
#[derive(Clone, Debug)]
pub struct ArticulatedLink {
    /// Name in the tree.
    pub name: String,
    /// The body that carries it.
    pub body: RigidBodyHandle,
    /// Where it sits on that body.
    pub body_from_link: Pose,
}

/// A robot, an arm or a hand living in a physics world.
#[derive(Clone, Debug)]
pub struct Articulation {
    joints: Vec<ArticulatedJoint>,
    links: Vec<ArticulatedLink>,
    root: RigidBodyHandle,
}

/// Links merged by fixed joints, before they become a body.
#[derive(Default)]
struct Body {
    mass_kg: f64,
    /// Sum of mass times position.
    first_moment: Vector,
    /// About the body's origin.
    inertia: Matrix3<f64>,
    colliders: Vec<Collider>,
}

impl Articulation {
    /// Inserts the part of `tree` below `root_link` with the fixed `root_link` at `world_from_root`.
    ///
    /// `q` is a configuration of the whole tree ([`Tree::q_names`]); joints start there and hold it with zero gain, so the caller
    /// must set a servo on each joint before stepping.
    ///
    /// # Errors
    /// [`WorldError::Robot`] when `root_link` does not exist, `q` has the wrong length, a moving joint mimics another, a moving
    /// link has no mass, or a collision shape is a mesh.
    ///
    /// # Panics
    /// If the tree does not list parents before children, which a compiled [`Tree`] always does.
    pub fn spawn(
        world: &mut PhysicsWorld,
        tree: &Tree,
        root_link: &str,
        world_from_root: &Pose,
        q: &[f64],
        settings: &LinkSettings,
    ) -> Result<Self, WorldError> {
        let broken = |message: String| WorldError::Robot { message };
        let root_idx = tree.link_idx(root_link).map_err(|e| broken(e.to_string()))?;
        if q.len() != tree.n_q() {
            return Err(broken(format!("{} joint values given, the robot has {} joints", q.len(), tree.n_q())));
        }
        // Parents come first in a tree, so one pass assigns every descendant of the root to a body.
        let mut carrier: Vec<Option<(usize, Pose)>> = vec![None; tree.links.len()];
        let mut bodies = vec![Body::default()];
        let mut movers: Vec<(usize, usize)> = Vec::new();
        carrier[root_idx] = Some((0, Pose::identity()));
        for (joint_idx, joint) in tree.joints.iter().enumerate() {
            let Some((parent_body, body_from_parent)) = carrier[joint.parent_idx] else { continue };
            carrier[joint.child_idx] = if joint.kind == JointKind::Fixed {
                Some((parent_body, body_from_parent * joint.parent_from_joint))
            } else {
                bodies.push(Body::default());
                movers.push((joint_idx, parent_body));
                Some((bodies.len() - 1, Pose::identity()))
            };
        }
        for (link, place) in tree.links.iter().zip(&carrier) {
            let Some((body_idx, body_from_link)) = place else { continue };
            bodies[*body_idx].add(link, body_from_link, settings)?;
        }

        let root = world.insert_body(RigidBodyBuilder::fixed().pose(to_physics(world_from_root)));
        let mut handles = vec![root];
        insert_colliders(world, root, std::mem::take(&mut bodies[0].colliders));
        let mut joints = Vec::with_capacity(movers.len());
        let mut start = Vec::with_capacity(movers.len());
        for (nth, &(joint_idx, parent_body)) in movers.iter().enumerate() {
            let joint = &tree.joints[joint_idx];
            if !matches!(joint.source, sfg_kinematics::JointSource::Independent { .. }) {
                return Err(broken(format!(
                    "joint {:?} mimics another one; the simulated part must have independent joints",
                    joint.name
                )));
            }
            let body = &mut bodies[nth + 1];
            if body.mass_kg <= 0.0 {
                return Err(broken(format!("the link of joint {:?} has no mass", joint.name)));
            }
            let handle = world.insert_body(
                RigidBodyBuilder::dynamic()
                    .additional_mass_properties(body.mass_properties())
                    .gravity_scale(0.0)
                    .linear_damping(0.0)
                    .angular_damping(0.0)
                    .can_sleep(false),
            );
            insert_colliders(world, handle, std::mem::take(&mut body.colliders));
            let body_from_parent_link = carrier[joint.parent_idx].expect("a joint moves only below a carried link").1;
            let (data, axis) = joint_data(joint, &(body_from_parent_link * joint.parent_from_joint));
            let joint_handle = world
                .multibody_joints
                .insert(handles[parent_body], handle, data, true)
                .ok_or_else(|| broken(format!("joint {:?} closes a loop", joint.name)))?;
            handles.push(handle);
            start.push(joint.value(q));
            joints.push(ArticulatedJoint {
                name: joint.name.clone(),
                lower: joint.lower,
                upper: joint.upper,
                effort: joint.effort,
                handle: joint_handle,
                axis,
            });
        }
        let links = tree
            .links
            .iter()
            .zip(&carrier)
            .filter_map(|(link, place)| {
                let (body_idx, body_from_link) = (*place)?;
                Some(ArticulatedLink { name: link.name.clone(), body: handles[body_idx], body_from_link })
            })
            .collect();
        let articulation = Self { joints, links, root };
        articulation.initialise(world, &start, settings);
        Ok(articulation)
    }

    /// The moving joints, in the order of `q` and `dq`.
    #[must_use]
    pub fn joints(&self) -> &[ArticulatedJoint] {
        &self.joints
    }

    /// All links with the bodies that carry them.
    #[must_use]
    pub fn links(&self) -> &[ArticulatedLink] {
        &self.links
    }

    /// The fixed body at the root.
    #[must_use]
    pub fn root(&self) -> RigidBodyHandle {
        self.root
    }

    /// Index of a joint in `q`.
    ///
    /// # Errors
    /// [`WorldError::Robot`] when there is none of this name.
    pub fn joint_idx(&self, name: &str) -> Result<usize, WorldError> {
        self.joints
            .iter()
            .position(|j| j.name == name)
            .ok_or_else(|| WorldError::Robot { message: format!("the simulated robot has no joint {name:?}") })
    }

    /// A link by name.
    ///
    /// # Errors
    /// [`WorldError::Robot`] when there is none of this name.
    pub fn link(&self, name: &str) -> Result<&ArticulatedLink, WorldError> {
        self.links
            .iter()
            .find(|l| l.name == name)
            .ok_or_else(|| WorldError::Robot { message: format!("the simulated robot has no link {name:?}") })
    }

    /// Pose of a link.
    ///
    /// # Errors
    /// [`WorldError::Robot`] when there is none of this name.
    pub fn world_from_link(&self, world: &PhysicsWorld, name: &str) -> Result<Pose, WorldError> {
        let link = self.link(name)?;
        Ok(from_physics(world.bodies[link.body].position()) * link.body_from_link)
    }

    /// Joint positions, radians or metres.
    #[must_use]
    pub fn q(&self, world: &PhysicsWorld) -> Vec<f64> {
        self.joints.iter().map(|j| f64::from(self.multibody_link(world, j).1.joint().coords()[j.axis as usize])).collect()
    }

    /// Joint velocities.
    #[must_use]
    pub fn dq(&self, world: &PhysicsWorld) -> Vec<f64> {
        let velocity = |j| {
            let (multibody, link) = self.multibody_link(world, j);
            f64::from(multibody.joint_velocity(link)[0])
        };
        self.joints.iter().map(velocity).collect()
    }

    /// Sets the servo of one joint; it stays until the next call.
    ///
    /// # Panics
    /// If `joint_idx` is not below the number of joints.
    pub fn set_servo(&self, world: &mut PhysicsWorld, joint_idx: usize, servo: &Servo) {
        let joint = &self.joints[joint_idx];
        let (multibody, link_id) = world.multibody_joints.get_mut(joint.handle).expect("the articulation owns its joints");
        let data = &mut multibody.link_mut(link_id).expect("the handle names this link").joint.data;
        data.set_motor_model(joint.axis, MotorModel::ForceBased)
            .set_motor(joint.axis, servo.position as f32, servo.velocity as f32, servo.kp as f32, servo.kd as f32)
            .set_motor_max_force(joint.axis, servo.max_effort as f32);
    }

    /// Puts the joints at `q` at rest, without going through the space between.
    pub fn teleport(&self, world: &mut PhysicsWorld, q: &[f64]) {
        let now = self.q(world);
        let steps: Vec<f64> = q.iter().zip(&now).map(|(to, from)| to - from).collect();
        self.displace(world, &steps);
    }

    /// The order of these calls matters: `forward_kinematics` first, since it takes the six free degrees of freedom away from
    /// the fixed root; only then do lengths and indices of damping and armature fit the joints.
    fn initialise(&self, world: &mut PhysicsWorld, start: &[f64], settings: &LinkSettings) {
        let Some(first) = self.joints.first() else { return };
        let PhysicsWorld { multibody_joints, bodies, .. } = world;
        let (multibody, _) = multibody_joints.get_mut(first.handle).expect("the joint was inserted above");
        multibody.forward_kinematics(bodies, true);
        assert_eq!(multibody.ndofs(), self.joints.len(), "one degree of freedom for each moving joint, none for the fixed root");
        // The default adds 0.1 Nms/rad to every joint: more than a finger's own.
        multibody.damping_mut().fill(0.0);
        for (dof, joint) in self.joints.iter().enumerate() {
            multibody.armature_mut()[dof] = (settings.armature)(&joint.name) as f32;
        }
        multibody.set_self_contacts_enabled(false);
        self.displace(world, start);
    }

    fn displace(&self, world: &mut PhysicsWorld, steps: &[f64]) {
        let Some(first) = self.joints.first() else { return };
        let PhysicsWorld { multibody_joints, bodies, .. } = world;
        let (multibody, _) = multibody_joints.get_mut(first.handle).expect("the articulation owns its joints");
        let steps: Vec<f32> = steps.iter().map(|s| *s as f32).collect();
        multibody.generalized_velocity_mut().fill(0.0);
        multibody.apply_displacements(&steps);
        multibody.forward_kinematics(bodies, false);
        multibody.update_rigid_bodies(bodies, true);
    }

    fn multibody_link<'w>(&self, world: &'w PhysicsWorld, joint: &ArticulatedJoint) -> (&'w Multibody, &'w MultibodyLink) {
        let (multibody, link_id) = world.multibody_joints.get(joint.handle).expect("the articulation owns its joints");
        (multibody, multibody.link(link_id).expect("the handle names this link"))
    }
}

impl Body {
    fn add(&mut self, link: &sfg_kinematics::Link, body_from_link: &Pose, settings: &LinkSettings) -> Result<(), WorldError> {
        let inertial = &link.inertial;
        let body_from_inertia = body_from_link * inertial.link_from_inertia;
        let com = body_from_inertia.translation.vector;
        let turn = body_from_inertia.rotation.to_rotation_matrix().into_inner();
        // Steiner: carry every part to the body's origin, where parts add up.
        let shifted = Matrix3::identity() * com.norm_squared() - com * com.transpose();
        self.mass_kg += inertial.mass_kg;
        self.first_moment += com * inertial.mass_kg;
        self.inertia += turn * inertial.inertia * turn.transpose() + shifted * inertial.mass_kg;
        for part in &link.collision {
            let (shape, shape_from_own) = shared_shape(&part.shape).ok_or_else(|| WorldError::Robot {
                message: format!(
                    "link {:?} has a mesh as collision shape; use boxes, spheres, cylinders and capsules",
                    link.name
                ),
            })?;
            self.colliders.push(
                ColliderBuilder::new(shape)
                    .position(to_physics(&(body_from_link * part.link_from_shape * shape_from_own)))
                    // Masses come from the URDF, not from the shapes.
                    .density(0.0)
                    .friction(settings.friction as f32)
                    .friction_combine_rule(FRICTION_RULE)
                    .restitution(0.0)
                    .collision_groups(settings.collision_groups)
                    .build(),
            );
        }
        Ok(())
    }

    fn mass_properties(&self) -> MassProperties {
        let com = self.first_moment / self.mass_kg;
        let about_com = self.inertia - (Matrix3::identity() * com.norm_squared() - com * com.transpose()) * self.mass_kg;
        let column = |i: usize| Vec3::new(about_com[(0, i)] as f32, about_com[(1, i)] as f32, about_com[(2, i)] as f32);
        let inertia = Mat3::from_cols(column(0), column(1), column(2));
        MassProperties::with_inertia_matrix(vector_to_physics(&com), self.mass_kg as f32, inertia)
    }
}

fn insert_colliders(world: &mut PhysicsWorld, body: RigidBodyHandle, colliders: Vec<Collider>) {
    for collider in colliders {
        world.colliders.insert_with_parent(collider, body, &mut world.bodies);
    }
}

/// rapier moves joints about or along X of the joint frames: turn X onto the axis.
fn joint_data(joint: &sfg_kinematics::Joint, body_from_joint: &Pose) -> (GenericJoint, JointAxis) {
    let x_to_axis = UnitQuaternion::rotation_between(&Vector::x_axis(), &joint.axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector::z_axis(), std::f64::consts::PI));
    let (locked, axis) = match joint.kind {
        JointKind::Prismatic => (JointAxesMask::LOCKED_PRISMATIC_AXES, JointAxis::LinX),
        JointKind::Revolute | JointKind::Fixed => (JointAxesMask::LOCKED_REVOLUTE_AXES, JointAxis::AngX),
    };
    let mut data = GenericJoint::new(locked);
    data.set_local_frame1(to_physics(&(body_from_joint * x_to_axis)));
    data.set_local_frame2(to_physics(&Pose::from_parts(nalgebra::Translation3::identity(), x_to_axis)));
    if joint.lower.is_finite() && joint.upper.is_finite() {
        data.set_limits(axis, [joint.lower as f32, joint.upper as f32]);
    }
    data.set_motor_model(axis, MotorModel::ForceBased).set_motor(axis, 0.0, 0.0, 0.0, 0.0);
    (data, axis)
}

/// The rapier shape and its place in the frame of [`Shape`], whose cylinders and capsules lie along Z; `None` for meshes.
pub(crate) fn shared_shape(shape: &Shape) -> Option<(SharedShape, Pose)> {
    let upright = Pose::identity();
    Some(match shape {
        Shape::Cuboid { half_extents_m: h } => (SharedShape::cuboid(h.x as f32, h.y as f32, h.z as f32), upright),
        Shape::Sphere { radius_m } => (SharedShape::ball(*radius_m as f32), upright),
        Shape::Capsule { radius_m, half_length_m } => (SharedShape::capsule_z(*half_length_m as f32, *radius_m as f32), upright),
        Shape::Cylinder { radius_m, half_length_m } => {
            // parry's cylinder stands along Y.
            let quarter_turn = UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::FRAC_PI_2);
            let lying = Pose::from_parts(nalgebra::Translation3::identity(), quarter_turn);
            (SharedShape::cylinder(*half_length_m as f32, *radius_m as f32), lying)
        }
        Shape::Mesh { .. } => return None,
    })
}
