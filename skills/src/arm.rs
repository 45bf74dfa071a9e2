//! The acting arm among the things on the table: what skills ask of kinematics and planning.

use crate::post_grasp::pour_path::VesselShape;
use crate::robot::Robot;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::reach::ReachMap;
use sfg_kinematics::{Chain, IkOutcome, IkSettings, IkSolver, Shape, joints_at_limit};
use sfg_planning::{
    BodyGroup, CartesianOutcome, CartesianSettings, CartesianStop, CollisionModel, CollisionSettings, Obstacle, PlanOutcome,
    Planner, PlanningScene, RrtConnect, TimingSettings, cartesian_path, retime, verify_exact,
};
use sfg_types::{JointTrajectory, ObjectCluster, Point, Pose, RejectionReason, SceneInventory, ShapeClass, SynergyCoordinates};
use std::fmt;

/// Share of the speed limits away from things.
pub const PLAN_SPEED: f64 = 0.4;
/// Steps of a bent line.
const BENT_STEP_RAD: f64 = 0.05;
/// Bending moves a joint this much more than the line at most.
const MAX_BENT_JUMP_RAD: f64 = 0.15;
/// Name of the object that is grasped among the obstacles.
const TARGET: &str = "the object";
/// Name of the table among the obstacles.
const TABLE: &str = "the table";
/// The cameras do not see where the table ends, so it reaches this far about its known edge, metres.
const TABLE_X_M: (f64, f64) = (0.45, 1.6);
const TABLE_HALF_WIDTH_M: f64 = 1.2;
const TABLE_HALF_THICKNESS_M: f64 = 0.03;
/// What is seen of a thing may be this much smaller than the thing.
const OBSTACLE_MARGIN_M: f64 = 0.01;
/// A thing seen edge on still has a thickness.
const LEAST_HALF_M: f64 = 0.002;
/// Spacing of exact checks before a motion is sent.
const EXACT_STEP_RAD: f64 = 0.02;
/// Spacing of the spheres along a held vessel.
const VESSEL_STEP_M: f64 = 0.02;

/// How the arm missed a pose, or how a motion ended early.
#[derive(Clone, Debug, PartialEq)]
pub struct Miss {
    /// Distance from where the arm could go to where it should, metres; 0 when it was not the reach that failed.
    pub position_m: f64,
    /// The angle between, radians.
    pub rotation_rad: f64,
    /// Joints that stood at a position limit there.
    pub at_limit: Vec<String>,
    /// Waypoints that were reached.
    pub n_reached: usize,
    /// Why, for people.
    pub why: String,
}

impl Miss {
    /// As the reason why a key pose cannot be used.
    #[must_use]
    pub fn rejection(self, key_pose: &str) -> RejectionReason {
        RejectionReason::NoInverseKinematics {
            key_pose: key_pose.to_owned(),
            miss_m: self.position_m,
            miss_rad: self.rotation_rad,
            at_limit: self.at_limit,
        }
    }
}

impl fmt::Display for Miss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.why)
    }
}

/// The arm, the hand in one shape, and the obstacles seen.
pub struct ArmScene<'a> {
    robot: &'a Robot,
    whole_q: Vec<f64>,
    /// Everything is an obstacle.
    free: CollisionModel,
    /// The hand may touch the object.
    grasping: CollisionModel,
    /// The object is in the hand, not on the table.
    carrying: CollisionModel,
    seed: u64,
}

impl<'a> ArmScene<'a> {
    /// The scene of `inventory`; `object_id` is the thing that is grasped or held. The hand has the shape `hand`.
    ///
    /// # Panics
    /// If the robot's own model is broken: it was checked when it was loaded; or if two clusters have the same id.
    #[must_use]
    pub fn new(
        robot: &'a Robot,
        inventory: &SceneInventory,
        object_id: Option<u32>,
        hand: SynergyCoordinates,
        seed: u64,
    ) -> Self {
        let whole_q = robot.whole_q(&robot.sent().q, hand);
        let empty = CollisionModel::new(robot.model(), robot.side(), &whole_q, CollisionSettings::default())
            .unwrap_or_else(|error| panic!("the loaded robot has a collision model: {error}"));
        let mut scene = PlanningScene::default();
        let add = |scene: &mut PlanningScene, thing| {
            scene.add(thing).unwrap_or_else(|error| panic!("things seen have sizes and names of their own: {error}"));
        };
        add(&mut scene, table(inventory.table_height_m));
        let mut target = None;
        for cluster in &inventory.clusters {
            let name = cluster.names.first().map_or("a thing", |ranked| ranked.name.as_str());
            if Some(cluster.id) == object_id {
                target = Some(obstacle(cluster, TARGET, inventory.table_height_m, 0.0));
            } else {
                let name = format!("{name} {}", cluster.id);
                add(&mut scene, obstacle(cluster, &name, inventory.table_height_m, OBSTACLE_MARGIN_M));
            }
        }
        let among = |scene: &PlanningScene| {
            let mut model = empty.clone();
            scene.apply(&mut model);
            model
        };
        let carrying = among(&scene);
        if let Some(target) = target {
            add(&mut scene, target);
        }
        let free = among(&scene);
        scene.allow(BodyGroup::Hand, TARGET);
        let grasping = among(&scene);
        Self { robot, whole_q, free, grasping, carrying, seed }
    }

    fn chain(&self) -> &Chain {
        self.robot.chain()
    }

    fn rng(&self) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(self.seed)
    }

    /// Palm pose of a configuration.
    #[must_use]
    pub fn palm_pose(&self, q: &[f64]) -> Pose {
        self.chain().fk(q)
    }

    /// Up to `n` arm configurations with the palm at `base_from_palm`, nearest to `near_q` first.
    ///
    /// # Errors
    /// The nearest miss.
    pub fn configurations(&self, base_from_palm: &Pose, near_q: &[f64], n: usize) -> Result<Vec<Vec<f64>>, Miss> {
        let settings = IkSettings { max_starts: IK_STARTS, ..IkSettings::default() };
        let found = IkSolver::solve_several(self.chain(), base_from_palm, near_q, n, &settings, &mut self.rng());
        if !found.is_empty() {
            return Ok(found);
        }
        self.configuration(base_from_palm, near_q, &settings).map(|q| vec![q])
    }

    fn configuration(&self, base_from_palm: &Pose, near_q: &[f64], settings: &IkSettings) -> Result<Vec<f64>, Miss> {
        match IkSolver::solve(self.chain(), base_from_palm, near_q, settings, &mut self.rng()) {
            IkOutcome::Solved { q, .. } => Ok(q),
            IkOutcome::Failed { best_q, position_miss_m, rotation_miss_rad } => Err(Miss {
                position_m: position_miss_m,
                rotation_rad: rotation_miss_rad,
                at_limit: joints_at_limit(self.chain(), &best_q),
                n_reached: 0,
                why: "out of reach".to_owned(),
            }),
        }
    }

    /// The reach score of a palm pose, 0 to 1, where the robot has a map.
    #[must_use]
    pub fn reach_score(&self, base_from_palm: &Pose) -> Option<f64> {
        self.reach().map(|map| map.score(self.chain(), base_from_palm))
    }

    /// The nearest miss of a palm pose that is hopeless: the map knows no reached pose about it, and a few descents
    /// find none either. `None` without a map.
    #[must_use]
    pub fn hopeless(&self, base_from_palm: &Pose, near_q: &[f64]) -> Option<Miss> {
        if self.reach_score(base_from_palm)? > 0.0 {
            return None;
        }
        let settings = IkSettings { max_starts: HOPELESS_STARTS, ..IkSettings::default() };
        self.configuration(base_from_palm, near_q, &settings).err()
    }

    fn reach(&self) -> Option<&ReachMap> {
        self.robot.reach()
    }

    /// Configurations along straight palm motions from `start_q` through `waypoints`, the start first.
    ///
    /// # Errors
    /// Where and why the arm cannot go on.
    pub fn straight(&self, start_q: &[f64], waypoints: &[Pose]) -> Result<Vec<Vec<f64>>, Miss> {
        match cartesian_path(self.chain(), start_q, waypoints, &CartesianSettings::default(), None) {
            CartesianOutcome::Found(path) => Ok(path),
            CartesianOutcome::Stopped { path, waypoint_idx, stop, .. } => {
                let (position_m, rotation_rad, at_limit) = match &stop {
                    CartesianStop::Unreachable { position_miss_m, rotation_miss_rad } => {
                        let last_q = path.last().map_or(start_q, Vec::as_slice);
                        (*position_miss_m, *rotation_miss_rad, joints_at_limit(self.chain(), last_q))
                    }
                    _ => (0.0, 0.0, Vec::new()),
                };
                Err(Miss { position_m, rotation_rad, at_limit, n_reached: waypoint_idx, why: why(&stop) })
            }
        }
    }

    /// Configurations from `start_q` to `goal_q` along the straight line between them, each bent to the palm pose that `bend` makes of
    /// its share of the way and its own palm pose. At both ends `bend` must leave the pose as it is.
    ///
    /// # Errors
    /// Where and why the arm cannot go on.
    pub fn bent(&self, start_q: &[f64], goal_q: &[f64], bend: impl Fn(f64, &Pose) -> Pose) -> Result<Vec<Vec<f64>>, Miss> {
        let settings = IkSettings { max_starts: 1, ..IkSettings::default() };
        let gap = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let n_steps = (gap(start_q, goal_q) / BENT_STEP_RAD).ceil().max(1.0) as usize;
        let mut path = vec![start_q.to_vec()];
        for step in 1..=n_steps {
            let share = step as f64 / n_steps as f64;
            let on_line: Vec<f64> = start_q.iter().zip(goal_q).map(|(a, b)| a + share * (b - a)).collect();
            let wanted = bend(share, &self.palm_pose(&on_line));
            let q = self.configuration(&wanted, &on_line, &settings).map_err(|miss| Miss {
                n_reached: step - 1,
                why: "out of reach on the way".to_owned(),
                ..miss
            })?;
            if gap(&path[step - 1], &q) > MAX_BENT_JUMP_RAD {
                let why = "a joint would have to jump".to_owned();
                return Err(Miss { position_m: 0.0, rotation_rad: 0.0, at_limit: Vec::new(), n_reached: step - 1, why });
            }
            path.push(q);
        }
        Ok(path)
    }

    /// What the arm or the open hand touches, the object included.
    #[must_use]
    pub fn touches(&self, q: &[f64]) -> Option<String> {
        self.free.contact(q).map(|contact| contact.to_string())
    }

    /// What is touched at the grasp: the hand may touch the object, and the margins about it do not count.
    #[must_use]
    pub fn touches_at_grasp(&self, q: &[f64]) -> Option<String> {
        self.grasping.contact(q).map(|contact| contact.to_string())
    }

    /// What the safety filter guards while the object is approached, held and used: all but the object.
    #[must_use]
    pub fn guard(&self) -> CollisionModel {
        self.carrying.clone()
    }

    /// The scene with a vessel in the hand.
    #[must_use]
    pub fn with_vessel(&self, shape: &VesselShape, palm_from_vessel: &Pose) -> CollisionModel {
        let mut carrying = self.carrying.clone();
        let n_spheres = (shape.height_m / VESSEL_STEP_M).ceil() as usize;
        let spheres: Vec<(Point, f64)> = (0..=n_spheres)
            .map(|n| {
                let height_m = shape.body_radius_m
                    + (shape.height_m - shape.body_radius_m - shape.mouth_radius_m).max(0.0) * n as f64 / n_spheres as f64;
                let radius_m = if height_m > 0.75 * shape.height_m { shape.mouth_radius_m } else { shape.body_radius_m };
                (palm_from_vessel * Point::new(0.0, 0.0, height_m), radius_m)
            })
            .collect();
        carrying.attach("the vessel", &spheres);
        carrying.allow(BodyGroup::Attached, TABLE);
        carrying
    }

    /// A collision-free, timed motion, verified on the exact shapes.
    ///
    /// # Errors
    /// Why there is none.
    pub fn plan(&self, start_q: &[f64], goal_q: &[f64], speed: f64) -> Result<JointTrajectory, String> {
        let path = match RrtConnect::default().plan(&self.free, start_q, &[goal_q.to_vec()], self.seed) {
            PlanOutcome::Found(path) => path,
            PlanOutcome::StartInCollision { contact } => return Err(format!("the arm already touches: {contact}")),
            PlanOutcome::GoalInCollision { contact, .. } => return Err(format!("its end touches: {contact}")),
            PlanOutcome::OutsideLimits { joint, value, lower, upper } => {
                return Err(format!("joint {joint:?} at {value:.3} rad is outside [{lower:.3}, {upper:.3}]"));
            }
            PlanOutcome::AxisNotKept { tip, angle_rad, max_angle_rad, .. } => {
                return Err(format!("{tip} is tilted by {angle_rad:.2} rad; at most {max_angle_rad:.2} is allowed"));
            }
            PlanOutcome::NotFound { iterations } => return Err(format!("none found in {iterations} iterations")),
        };
        let trajectory = self.stoppable(speed, &self.free, |speed_fraction| {
            let settings = TimingSettings { speed_fraction, ..TimingSettings::default() };
            retime(&path, self.chain(), &settings, Some(&self.free)).map_err(|error| error.to_string())
        })?;
        match verify_exact(self.robot.model(), self.robot.side(), &self.whole_q, &self.free, &trajectory.q, EXACT_STEP_RAD) {
            None => Ok(trajectory),
            Some(contact) => Err(format!("the exact shapes touch: {contact}")),
        }
    }

    /// Times a path of [`Self::straight`].
    ///
    /// # Errors
    /// Why it cannot be timed.
    pub fn time(&self, path: &[Vec<f64>], speed: f64) -> Result<JointTrajectory, String> {
        self.stoppable(speed, &self.carrying, |speed| {
            retime(path, self.chain(), &TimingSettings::cartesian(speed), None).map_err(|error| error.to_string())
        })
    }

    /// The motion at the highest speed, `speed` at most, at which the arm can be stopped everywhere on it among the things of `world`.
    fn stoppable(
        &self,
        speed: f64,
        world: &CollisionModel,
        timed: impl Fn(f64) -> Result<JointTrajectory, String>,
    ) -> Result<JointTrajectory, String> {
        let mut speed = speed.min(self.robot.max_speed_fraction());
        let mut why = None;
        for _ in 0..SPEEDS_TRIED {
            let trajectory = timed(speed)?;
            why = self.robot.rehearse(&trajectory, world.clone());
            if why.is_none() {
                return Ok(trajectory);
            }
            speed *= SLOWER;
        }
        Err(why.map_or_else(String::new, |why| format!("the safety filter would not let it pass: {why}")))
    }
}

/// A motion that could not be stopped in time is tried so many times, each time at this share of the speed.
const SPEEDS_TRIED: usize = 4;
const SLOWER: f64 = 0.6;

/// Descents of the inverse kinematics for one palm pose: CURI's mounting leaves nearly every pose several solutions.
const IK_STARTS: usize = 24;
/// Descents for a palm pose about which the map knows nothing that is reached: enough for the nearest miss.
const HOPELESS_STARTS: usize = 4;

fn why(stop: &CartesianStop) -> String {
    match stop {
        CartesianStop::Unreachable { position_miss_m, rotation_miss_rad } => {
            format!("out of reach by {position_miss_m:.3} m and {rotation_miss_rad:.2} rad")
        }
        CartesianStop::JointJump { joint, jump_rad } => format!("joint {joint:?} would have to jump by {jump_rad:.2} rad"),
        CartesianStop::Deviation { deviation_m, .. } => format!("the palm would leave the straight way by {deviation_m:.3} m"),
        CartesianStop::Collision(contact) => contact.to_string(),
    }
}

fn table(height_m: f64) -> Obstacle {
    Obstacle {
        name: TABLE.to_owned(),
        shape: Shape::Cuboid {
            half_extents_m: [(TABLE_X_M.1 - TABLE_X_M.0) / 2.0, TABLE_HALF_WIDTH_M, TABLE_HALF_THICKNESS_M].into(),
        },
        pose_in_base: Pose::translation((TABLE_X_M.0 + TABLE_X_M.1) / 2.0, 0.0, height_m - TABLE_HALF_THICKNESS_M),
    }
}

/// A cluster from the table up, as an upright cylinder or box.
fn obstacle(cluster: &ObjectCluster, name: &str, table_height_m: f64, margin_m: f64) -> Obstacle {
    let height_m = (cluster.centre_in_base.z + cluster.size_m.z / 2.0 - table_height_m).max(0.01) + margin_m;
    let centre = cluster.centre_in_base;
    let across = |size_m: f64| (size_m / 2.0).max(LEAST_HALF_M) + margin_m;
    let upright = Pose::new(
        nalgebra::Vector3::new(centre.x, centre.y, table_height_m + height_m / 2.0),
        nalgebra::Vector3::z() * cluster.yaw_rad,
    );
    let shape = match cluster.shape {
        ShapeClass::UprightCylinder | ShapeClass::WideRound => {
            Shape::Cylinder { radius_m: across(cluster.size_m.x.max(cluster.size_m.y)), half_length_m: height_m / 2.0 }
        }
        _ => Shape::Cuboid { half_extents_m: [across(cluster.size_m.x), across(cluster.size_m.y), height_m / 2.0].into() },
    };
    Obstacle { name: name.to_owned(), shape, pose_in_base: upright }
}
