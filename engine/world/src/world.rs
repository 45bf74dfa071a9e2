//! The simulated scene: built once, then stepped one control period at a time.

use crate::bodies::{Bodies, GrainBody, ObjectBody, Role};
use crate::convert::{from_physics, to_physics, vector_from_physics, vector_to_physics};
use crate::hash::StateHash;
use crate::judge::{self, GRAVITY, GraspAsked, Guard, Judge, JudgeReport, Predicate, Protected, RobotTruth, Tampering, Verdict};
use crate::multibody::FRICTION_RULE;
use crate::robot::{ActingRobot, GROUP_ACTING, GROUP_GRAIN, GROUP_SCENE, GROUP_STATIC, insert_static_robot};
use crate::scene::{ObjectSpec, SceneSpec, TableSpec, WorldSettings};
use crate::settings::{DT_SECS, integration_parameters};
use crate::share::ProprioceptiveState;
use crate::truth::{ContactTruth, ObjectTruth, Truth};
use crate::{Cameras, WorldError};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rapier3d::glamx::{Mat3, Vec3};
use rapier3d::prelude::*;
use serde::Serialize;
use sfg_geometry::{Piece, Touches};
use sfg_kinematics::RobotModel;
use sfg_types::{HandSide, Pose as Pose64, RobotCommand};

/// Things that still rock after the settling time are given this many times as much: scans stand on uneven bases.
const MAX_SETTLES: usize = 6;
/// A thing that rocks moves no farther sideways than this, metres.
const ROCKS_WITHIN_M: f64 = 0.003;
/// Objects start this far above the table and settle, metres.
const DROP_M: f64 = 5e-4;
/// A world whose objects are put this deep into each other is refused, metres.
const OVERLAP_M: f64 = 2e-3;
/// A world whose objects still move faster than this after settling is refused, m/s,
const SETTLED_MPS: f64 = 0.05;
/// or have moved sideways by more than this, metres.
const SETTLED_WITHIN_M: f64 = 0.02;

/// Friction between two kinds of surface; printed by every run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrictionPair {
    /// One surface and the other.
    pub between: [&'static str; 2],
    /// Coulomb coefficient.
    pub coefficient: f64,
}

/// A scene in motion. One world runs on one thread; many run side by side.
pub struct World {
    pub(crate) bodies: Bodies,
    pub(crate) robot: ActingRobot,
    pub(crate) judge: Judge,
    pub(crate) cameras: Cameras,
    settings: WorldSettings,
    pub(crate) seed: u64,
    n_steps: u64,
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "World({} objects, {} grains, {:.3} s)", self.bodies.objects.len(), self.bodies.grains.len(), self.stamp_secs())
    }
}

impl World {
    /// Length of a control period, seconds.
    pub const PERIOD_SECS: f64 = DT_SECS;

    /// Builds the scene with the robot at home, fills the vessels and lets everything come to rest; time zero is then.
    ///
    /// # Errors
    /// [`WorldError::BadScene`] for impossible values, vessels too small for their grains, and scenes that do not come to rest;
    /// [`WorldError::Robot`] for a robot that cannot be simulated.
    pub fn new(spec: &SceneSpec, robot: &RobotModel, side: HandSide) -> Result<Self, WorldError> {
        spec.validate()?;
        let settings = spec.settings.clone();
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        let mut physics = PhysicsWorld {
            integration_parameters: integration_parameters(),
            gravity: Vector::new(0.0, 0.0, -GRAVITY),
            ..PhysicsWorld::default()
        };
        insert_table(&mut physics, &spec.table, &settings);
        let mut objects = Vec::with_capacity(spec.objects.len());
        for (object_idx, object) in spec.objects.iter().enumerate() {
            objects.push(insert_object(&mut physics, object, object_idx, spec)?);
        }
        let mut grains = Vec::new();
        for (vessel_idx, object) in spec.objects.iter().enumerate() {
            insert_grains(&mut physics, object, &objects[vessel_idx], vessel_idx, &settings, &mut grains, &mut rng)?;
        }
        let acting = ActingRobot::spawn(&mut physics, robot, side, settings.pair_friction)?;
        insert_static_robot(&mut physics, robot, &acting.articulation, settings.pair_friction)?;
        let hand = acting.tag_hand(&mut physics, robot);
        let cameras = Cameras::new(robot, &acting, &spec.table, &objects, &settings);
        let bodies = Bodies { physics, table_height_m: spec.table.height_m, objects, grains, hand };
        let judge = Judge::new(Guard::default(), spec.objects.len());
        let mut world = Self { bodies, robot: acting, judge, cameras, settings, seed: spec.seed, n_steps: 0 };
        world.settle(spec)?;
        world.start_judging(spec, robot);
        Ok(world)
    }

    /// Simulated time since the scene came to rest.
    #[must_use]
    pub fn stamp_secs(&self) -> f64 {
        self.n_steps as f64 * DT_SECS
    }

    /// Which arm and hand act.
    #[must_use]
    pub fn side(&self) -> HandSide {
        self.robot.side
    }

    /// Friction of every kind of pair.
    #[must_use]
    pub fn friction_pairs(&self) -> Vec<FrictionPair> {
        let pair = |a, b, coefficient| FrictionPair { between: [a, b], coefficient };
        let (mu, grain) = (self.settings.pair_friction, self.settings.grain_friction);
        vec![
            pair("hand", "object", mu),
            pair("object", "table", mu),
            pair("object", "object", mu),
            pair("grain", "anything", mu.min(grain)),
        ]
    }

    /// One control period: the judge checks the invariants, the servos get their set points, physics advances, the judge looks.
    ///
    /// # Errors
    /// [`WorldError::Command`] for a set point that does not fit the robot (nothing moves then), [`WorldError::Diverged`].
    pub fn step(&mut self, command: &RobotCommand) -> Result<(), WorldError> {
        self.robot.set_command(command)?;
        self.robot.drive(&mut self.bodies.physics);
        self.judge.before_step(&self.bodies, &[self.robot.tension_nm()], self.stamp_secs());
        self.bodies.physics.step();
        self.n_steps += 1;
        let stamp_secs = self.stamp_secs();
        let (robot, physics) = (&self.robot, &self.bodies.physics);
        let truth = || RobotTruth {
            base_from_palm: robot.base_from_palm(physics),
            posture: robot.posture(physics),
            motors: robot.hand_feedback().motor_positions,
        };
        self.judge.after_step(&self.bodies, truth, stamp_secs);
        self.check_finite()
    }

    /// Encoders and motor feedback.
    #[must_use]
    pub fn proprioception(&self) -> ProprioceptiveState {
        let physics = &self.bodies.physics;
        ProprioceptiveState {
            stamp_secs: self.stamp_secs(),
            q: self.robot.arm_q(physics),
            dq: self.robot.arm_dq(physics),
            hand: self.robot.hand_feedback(),
        }
    }

    /// Hash of the state of objects, grains and robot: equal for equal runs, whatever else the process does.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        let mut hash = StateHash::new();
        let physics = &self.bodies.physics;
        let mut body = |name: &str, handle: RigidBodyHandle| {
            let body = &physics.bodies[handle];
            hash.bytes(name.as_bytes());
            let (t, r, v, w) = (body.translation(), body.rotation(), body.linvel(), body.angvel());
            hash.floats([t.x, t.y, t.z, r.x, r.y, r.z, r.w, v.x, v.y, v.z, w.x, w.y, w.z]);
        };
        for object in &self.bodies.objects {
            body(&object.name, object.body);
        }
        for grain in &self.bodies.grains {
            body("grain", grain.body);
        }
        for link in self.robot.articulation.links() {
            body(&link.name, link.body);
        }
        hash.finish()
    }

    pub(crate) fn verdict(&self, predicates: &[Predicate]) -> Result<Verdict, WorldError> {
        judge::verdict(&self.judge, &self.bodies, predicates, self.tampered())
    }

    pub(crate) fn report(&self, asked: &GraspAsked) -> Result<JudgeReport, WorldError> {
        judge::report(&self.judge, &self.bodies, asked, self.state_hash(), self.tampered())
    }

    /// The first broken invariant; what was done since the last step counts too.
    pub(crate) fn tampered(&self) -> Option<Tampering> {
        let now = || self.judge.guard.check(&self.bodies.physics, &[self.robot.tension_nm()], self.stamp_secs()).err();
        self.judge.tampered.clone().or_else(now)
    }

    pub(crate) fn truth(&self) -> Truth {
        let bodies = &self.bodies;
        let objects = bodies.objects.iter().zip(&self.judge.trackers).map(|(object, tracker)| {
            let body = &bodies.physics.bodies[object.body];
            ObjectTruth {
                name: object.name.clone(),
                category: object.instance.category.clone(),
                base_from_object: from_physics(body.position()),
                velocity: vector_from_physics(body.linvel()),
                angular_velocity: vector_from_physics(body.angvel()),
                mass_kg: f64::from(body.mass()),
                part_labels: object.pieces.iter().map(|(_, label)| label.clone()).collect(),
                phase: tracker.phase,
            }
        });
        let name = |role| match role {
            Role::Table => "table".to_owned(),
            Role::Robot => "robot".to_owned(),
            Role::Hand(idx) => bodies.hand[idx].name.clone(),
            Role::Object(idx, _) => bodies.objects[idx].name.clone(),
            Role::Grain(_) => "grain".to_owned(),
        };
        let contacts = (0..bodies.objects.len()).flat_map(|idx| {
            bodies.contacts(idx).map(move |(role, impulse, point_in_base)| ContactTruth {
                object: bodies.objects[idx].name.clone(),
                with: name(role),
                impulse_ns: f64::from(impulse),
                point_in_base,
            })
        });
        Truth {
            stamp_secs: self.stamp_secs(),
            objects: objects.collect(),
            hand_joints: self.robot.hand_joints(&bodies.physics),
            arm_q: self.robot.arm_q(&bodies.physics),
            base_from_palm: self.robot.base_from_palm(&bodies.physics),
            grains_in_base: bodies.grains.iter().map(|grain| bodies.centre(grain.body)).collect(),
            contacts: contacts.collect(),
        }
    }

    pub(crate) fn displace_object(&mut self, name: &str, dx_m: f64, dy_m: f64, dyaw_rad: f64) -> Result<(), WorldError> {
        let idx = judge::object_idx(&self.bodies, name)?;
        if self.judge.trackers[idx].is_held() {
            let message = "is in the hand and cannot be displaced".to_owned();
            return Err(WorldError::BadScene { what: name.to_owned(), message });
        }
        let before = self.bodies.pose(self.bodies.objects[idx].body);
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), dyaw_rad);
        let shift = nalgebra::Vector3::new(dx_m, dy_m, 0.0);
        let after = Pose64::from_parts((before.translation.vector + shift).into(), turn * before.rotation);
        let move_body = |physics: &mut PhysicsWorld, body: RigidBodyHandle, motion: &Pose64| {
            let pose = motion * from_physics(physics.bodies[body].position());
            physics.bodies[body].set_position(to_physics(&pose), true);
        };
        let motion = after * before.inverse();
        let content: Vec<RigidBodyHandle> =
            self.bodies.grains.iter().filter(|grain| grain.vessel_idx == idx).map(|grain| grain.body).collect();
        move_body(&mut self.bodies.physics, self.bodies.objects[idx].body, &motion);
        for grain in content {
            move_body(&mut self.bodies.physics, grain, &motion);
        }
        self.judge.guard.note_states(&self.bodies.physics);
        Ok(())
    }

    fn settle(&mut self, spec: &SceneSpec) -> Result<(), WorldError> {
        let n_steps = (spec.settings.settle_secs / DT_SECS).round() as usize;
        for step in 0..MAX_SETTLES * n_steps {
            let is_still = |object: &crate::bodies::ObjectBody| self.speed_mps(object.body) <= SETTLED_MPS;
            if step == n_steps
                && self.bodies.objects.iter().zip(&spec.objects).any(|(object, asked)| {
                    // Rocking stays in place; what is pushed sideways overlaps something.
                    !is_still(object) && self.moved_m(object.body, asked) > ROCKS_WITHIN_M
                })
            {
                break;
            }
            if step >= n_steps && self.bodies.objects.iter().all(is_still) {
                break;
            }
            self.robot.drive(&mut self.bodies.physics);
            self.bodies.physics.step();
            if step == 0 {
                self.check_apart()?;
            }
        }
        self.check_finite()?;
        for (idx, object) in self.bodies.objects.iter().enumerate() {
            let bad = |message: String| Err(WorldError::BadScene { what: object.name.clone(), message });
            let speed = self.speed_mps(object.body);
            if n_steps > 0 && speed > SETTLED_MPS {
                let secs = MAX_SETTLES as f64 * spec.settings.settle_secs;
                return bad(format!("still moves at {speed:.2} m/s after {secs} s; it overlaps something or cannot stand"));
            }
            let moved = self.moved_m(object.body, &spec.objects[idx]);
            if moved > SETTLED_WITHIN_M {
                return bad(format!("moved by {moved:.3} m while the scene came to rest; it overlaps something or cannot stand"));
            }
            let n_lost = (0..self.bodies.grains.len())
                .filter(|&grain_idx| {
                    self.bodies.grains[grain_idx].vessel_idx == idx && !judge::is_inside(&self.bodies, grain_idx, idx)
                })
                .count();
            if n_lost > 0 {
                return bad(format!("{n_lost} of its grains are outside before the run begins"));
            }
        }
        Ok(())
    }

    /// Contacts of the first step show where things were put into each other.
    fn check_apart(&self) -> Result<(), WorldError> {
        for (idx, object) in self.bodies.objects.iter().enumerate() {
            let Some((role, depth_m)) = self.bodies.deepest_overlap(idx).filter(|(_, depth_m)| *depth_m > OVERLAP_M) else {
                continue;
            };
            let other = match role {
                Role::Object(other, _) => self.bodies.objects[other].name.as_str(),
                _ => "the robot",
            };
            let message = format!("overlaps {other} by {:.1} mm; put them apart", 1000.0 * depth_m);
            return Err(WorldError::BadScene { what: object.name.clone(), message });
        }
        Ok(())
    }

    /// How far a thing is from where it was put, in the plane of the table.
    fn moved_m(&self, body: RigidBodyHandle, asked: &crate::scene::ObjectSpec) -> f64 {
        let found = from_physics(self.bodies.physics.bodies[body].position()).translation.vector;
        (found.x - asked.x_m).hypot(found.y - asked.y_m)
    }

    fn speed_mps(&self, body: RigidBodyHandle) -> f64 {
        f64::from(self.bodies.physics.bodies[body].linvel().length())
    }

    fn start_judging(&mut self, spec: &SceneSpec, robot: &RobotModel) {
        let mut protected = Vec::new();
        for object in &self.bodies.objects {
            let [least, most] = object.mass_range_kg;
            protected.push(Protected {
                name: object.name.clone(),
                body: object.body,
                mass_range_kg: [(least * (1.0 - 1e-4)) as f32, (most * (1.0 + 1e-4)) as f32],
            });
        }
        let grain_kg = spec.settings.grain_mass_kg;
        protected.extend(self.bodies.grains.iter().map(|grain| Protected {
            name: "a grain".to_owned(),
            body: grain.body,
            mass_range_kg: [(grain_kg * (1.0 - 1e-4)) as f32, (grain_kg * (1.0 + 1e-4)) as f32],
        }));
        let motors = self.robot.motor_caps(&self.bodies.physics, robot);
        self.judge.guard = Guard::record(&self.bodies.physics, protected, motors, self.robot.max_tension_nm());
        self.n_steps = 0;
    }

    fn check_finite(&self) -> Result<(), WorldError> {
        let palm = self.robot.base_from_palm(&self.bodies.physics);
        let robot = (!palm.translation.vector.norm().is_finite()).then(|| "the robot".to_owned());
        let lost = |object: &&ObjectBody| !self.bodies.physics.bodies[object.body].translation().is_finite();
        match robot.or_else(|| self.bodies.objects.iter().find(lost).map(|object| object.name.clone())) {
            Some(what) => Err(WorldError::Diverged { stamp_secs: self.stamp_secs(), what }),
            None => Ok(()),
        }
    }
}

fn scene_groups(touches: Touches) -> InteractionGroups {
    let touched = match touches {
        Touches::Everything => GROUP_ACTING | GROUP_STATIC | GROUP_SCENE | GROUP_GRAIN,
        Touches::AllButGrains => GROUP_ACTING | GROUP_STATIC | GROUP_SCENE,
        Touches::GrainsOnly => GROUP_GRAIN,
    };
    InteractionGroups::new(GROUP_SCENE, touched, InteractionTestMode::And)
}

fn grain_groups() -> InteractionGroups {
    InteractionGroups::new(GROUP_GRAIN, GROUP_ACTING | GROUP_STATIC | GROUP_SCENE | GROUP_GRAIN, InteractionTestMode::And)
}

fn insert_table(physics: &mut PhysicsWorld, table: &TableSpec, settings: &WorldSettings) {
    let half = |[low, high]: [f64; 2]| ((high - low) / 2.0) as f32;
    let middle = |[low, high]: [f64; 2]| ((high + low) / 2.0) as f32;
    let half_thickness = table.thickness_m / 2.0;
    let centre = Vector::new(middle(table.x_m), middle(table.y_m), (table.height_m - half_thickness) as f32);
    physics.insert(
        RigidBodyBuilder::fixed().translation(centre),
        ColliderBuilder::cuboid(half(table.x_m), half(table.y_m), half_thickness as f32)
            .friction(settings.pair_friction as f32)
            .friction_combine_rule(FRICTION_RULE)
            .collision_groups(scene_groups(Touches::Everything))
            .user_data(Role::Table.encode()),
    );
}

fn insert_object(
    physics: &mut PhysicsWorld,
    spec: &ObjectSpec,
    object_idx: usize,
    scene: &SceneSpec,
) -> Result<ObjectBody, WorldError> {
    let position = nalgebra::Vector3::new(spec.x_m, spec.y_m, scene.table.height_m + DROP_M);
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), spec.yaw_rad);
    let base_from_object = Pose64::from_parts(position.into(), turn);
    // The exact mass distribution of the model; the collision pieces themselves weigh nothing.
    let mass = &spec.instance.mass;
    let inertia = mass.inertia_kg_m2 * (spec.mass() / mass.mass_kg);
    let column = |i: usize| Vec3::new(inertia[(0, i)] as f32, inertia[(1, i)] as f32, inertia[(2, i)] as f32);
    let com = vector_to_physics(&mass.centre_of_mass_in_object.coords);
    let properties =
        MassProperties::with_inertia_matrix(com, spec.mass() as f32, Mat3::from_cols(column(0), column(1), column(2)));
    let body = physics.insert_body(
        RigidBodyBuilder::dynamic()
            .pose(to_physics(&base_from_object))
            .additional_mass_properties(properties)
            .linear_damping(0.0)
            .angular_damping(0.0)
            .can_sleep(false),
    );
    let mut pieces = Vec::with_capacity(spec.instance.pieces.len());
    for (piece_idx, piece) in spec.instance.pieces.iter().enumerate() {
        let (shape, piece_from_shape) = piece_shape(&piece.piece).ok_or_else(|| WorldError::BadScene {
            what: spec.name.clone(),
            message: format!("collision piece {piece_idx} is flat"),
        })?;
        let collider = ColliderBuilder::new(shape)
            .position(to_physics(&(piece.object_from_piece * piece_from_shape)))
            .density(0.0)
            .friction(scene.settings.pair_friction as f32)
            .friction_combine_rule(FRICTION_RULE)
            .collision_groups(scene_groups(piece.touches))
            .user_data(Role::Object(object_idx, piece_idx).encode());
        let label = spec.instance.parts[piece.part_idx].label.clone();
        pieces.push((physics.insert_collider(collider, Some(body)), label));
    }
    Ok(ObjectBody {
        name: spec.name.clone(),
        body,
        pieces,
        instance: spec.instance.clone(),
        colour: spec.colour,
        mass_range_kg: spec.allowed_mass(),
    })
}

/// Native shapes: balls leak through hulls but not through cuboids, cylinders and capsules.
fn piece_shape(piece: &Piece) -> Option<(SharedShape, Pose64)> {
    let upright = Pose64::from_parts(
        nalgebra::Translation3::identity(),
        nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
    );
    Some(match piece {
        Piece::Cuboid { half_extents_m: h } => (SharedShape::cuboid(h.x as f32, h.y as f32, h.z as f32), Pose64::identity()),
        Piece::Cylinder { half_height_m, radius_m } => (SharedShape::cylinder(*half_height_m as f32, *radius_m as f32), upright),
        Piece::Capsule { half_height_m, radius_m } => {
            (SharedShape::capsule_z(*half_height_m as f32, *radius_m as f32), Pose64::identity())
        }
        Piece::Ball { radius_m } => (SharedShape::ball(*radius_m as f32), Pose64::identity()),
        Piece::ConvexHull { points } => {
            let points: Vec<_> = points.iter().map(|p| vector_to_physics(&p.coords)).collect();
            (SharedShape::convex_hull(&points)?, Pose64::identity())
        }
    })
}

fn insert_grains(
    physics: &mut PhysicsWorld,
    spec: &ObjectSpec,
    vessel: &ObjectBody,
    vessel_idx: usize,
    settings: &WorldSettings,
    grains: &mut Vec<GrainBody>,
    rng: &mut ChaCha8Rng,
) -> Result<(), WorldError> {
    let Some(interior) = spec.instance.interior.as_ref().filter(|_| spec.n_grains > 0) else { return Ok(()) };
    let positions = interior.grain_positions(settings.grain_radius_m, spec.n_grains);
    if positions.len() < spec.n_grains {
        let (n_fit, n_asked) = (positions.len(), spec.n_grains);
        let message = format!("holds {n_fit} grains of radius {} m, {n_asked} were asked for", settings.grain_radius_m);
        return Err(WorldError::BadScene { what: spec.name.clone(), message });
    }
    let base_from_vessel = from_physics(physics.bodies[vessel.body].position());
    for position in positions {
        // A little disorder, so that seeds differ and layers do not stand on each other like a crystal.
        let jitter = settings.grain_radius_m * 0.01;
        let mut noise = || rng.random_range(-jitter..jitter);
        let at = base_from_vessel * (position + nalgebra::Vector3::new(noise(), noise(), 0.0));
        let (body, _) = physics.insert(
            RigidBodyBuilder::dynamic()
                .translation(vector_to_physics(&at.coords))
                .linear_damping(0.0)
                .angular_damping(0.0)
                .can_sleep(false),
            ColliderBuilder::ball(settings.grain_radius_m as f32)
                .mass(settings.grain_mass_kg as f32)
                .friction(settings.grain_friction.min(settings.pair_friction) as f32)
                .friction_combine_rule(FRICTION_RULE)
                .collision_groups(grain_groups())
                .user_data(Role::Grain(grains.len()).encode()),
        );
        grains.push(GrainBody { body, vessel_idx });
    }
    Ok(())
}
