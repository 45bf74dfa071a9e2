//! Does an arm with its hand, and what it holds, touch anything? Or do both arms, or arms and torso?
//!
//! Everything that moves with the chain is covered by balls; the robot's other bodies and the obstacles keep their exact shapes, so
//! that one distance formula per shape answers all. The covering exceeds the arm by about 1 cm: verdicts err towards contact.

mod bodies;
mod nearest;

pub use nearest::Gap;

use crate::batch::{Batch, MAX_JOINTS};
use crate::error::PlanningError;
use crate::points::PointObstacles;
use crate::shapes::{Obstacle, bounding_radius_m, signed_distance_m};
use sfg_kinematics::{Chain, JointGroup, RobotModel, Shape, Tree};
use sfg_types::{HandSide, Point, Pose};
use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;

/// How fine, how careful.
#[derive(Clone, Debug, PartialEq)]
pub struct CollisionSettings {
    /// How far balls may stand out of arm links. Default 0.008 m.
    pub arm_excess_m: f64,
    /// How far balls may stand out of hand links; they are thin and come near things. Default 0.004 m.
    pub hand_excess_m: f64,
    /// Distance to keep from obstacles. Default 0.005 m: the simulated arm tracks within 1 mm, the cameras see within 3 mm.
    pub clearance_m: f64,
    /// Distance that the robot's own links keep from each other. Default 0.003 m: from any configuration that is free by so much, the
    /// safety filter lets the arm go on.
    pub self_clearance_m: f64,
}

impl Default for CollisionSettings {
    fn default() -> Self {
        Self { arm_excess_m: 0.008, hand_excess_m: 0.004, clearance_m: 0.005, self_clearance_m: 0.003 }
    }
}

/// Parts of what moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyGroup {
    /// Links of the arm.
    Arm,
    /// Links of the hand.
    Hand,
    /// The thing that the hand holds.
    Attached,
}

/// A ball of a moving body in some configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySphere {
    /// Centre, base frame, metres.
    pub centre_in_base: Point,
    /// Radius, metres.
    pub radius_m: f64,
}

/// Two things that touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Contact {
    /// The link (or the attached object) that moves.
    pub link: String,
    /// What it touches: an obstacle, a link of the robot, or `points`.
    pub with: String,
    /// How deep, clearance included, metres.
    pub depth_m: f64,
}

impl fmt::Display for Contact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} touches {} by {:.1} mm", self.link, self.with, self.depth_m * 1e3)
    }
}

#[derive(Clone, Debug)]
struct Moving {
    name: String,
    group: BodyGroup,
    // Link of the chain that carries it: index into the chain's `link_names`.
    frame_idx: usize,
    // Joints between that link and this body, which do not move; the hand and what it holds count as one joint on.
    n_beyond: usize,
    spheres: Vec<(Point, f64)>,
    bound: (Point, f64),
}

#[derive(Clone, Debug)]
struct Cluster {
    frame_idx: usize,
    bodies: Range<usize>,
    bound: (Point, f64),
}

#[derive(Clone, Debug)]
struct Fixed {
    name: String,
    shape: Shape,
    shape_from_base: Pose,
    centre: Point,
    bound_m: f64,
}

/// The arm, the rest of the robot and the world.
#[derive(Clone, Debug)]
pub struct CollisionModel {
    chain: Chain,
    settings: CollisionSettings,
    hand_roots: Vec<String>,
    // Links that carry joints, by compiled joint.
    carriers: Vec<String>,
    // Whether a link of the chain belongs to the torso; empty when none does.
    trunk: Vec<bool>,
    self_pairs: SelfPairs,
    moving: Vec<Moving>,
    own_bodies: Vec<Fixed>,
    // Moving bodies of one chain link lie side by side in `moving` and share a bound: most tests end there.
    clusters: Vec<Cluster>,
    // Moving bodies that nearly always touch because they are built so, with an own body or with another moving body.
    built_on_own: BTreeSet<(String, usize)>,
    built_touching: BTreeSet<(String, String)>,
    // Moving body x own bodies: may touch.
    ignored: Vec<Vec<bool>>,
    // Moving body x those before it: must not meet.
    guarded: Vec<Vec<bool>>,
    obstacles: Vec<Fixed>,
    points: Option<PointObstacles>,
    allowed: Vec<(BodyGroup, String)>,
    // All of the above for eight configurations at once.
    batch: Batch,
}

/// Which bodies of the robot are looked at for touching each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SelfPairs {
    /// All but links up to two apart and those that touch in nearly every configuration, which is found by sampling.
    Sampled,
    /// All but these pairs of links, as an SRDF disables them.
    AllBut(BTreeSet<(String, String)>),
}

/// Name of the point cloud in contacts and permissions.
const POINTS: &str = "points";

impl CollisionModel {
    /// The robot without obstacles: one arm moves, all else stays as in the whole-robot configuration `q`.
    ///
    /// # Errors
    /// [`PlanningError::MeshShape`].
    ///
    /// # Panics
    /// If `q` is not a configuration of the whole robot.
    pub fn new(model: &RobotModel, side: HandSide, q: &[f64], settings: CollisionSettings) -> Result<Self, PlanningError> {
        let hand_roots = model.arm(side).hand_root_link.clone().into_iter().collect();
        Self::build(&model.tree, model.arm_chain(side).clone(), hand_roots, Vec::new(), q, SelfPairs::Sampled, settings)
    }

    /// The robot without obstacles: a group of joints moves ([`RobotModel::group`]), all else stays as in the whole-robot
    /// configuration `q`.
    ///
    /// Arms of the group are looked at for touching each other; each of its hands is a hand. Links of a moving torso are looked
    /// at for touching arms and the world, but not each other or the base: as drawn their boxes overlap, and their joints'
    /// limits keep them apart.
    ///
    /// # Errors
    /// [`PlanningError::MeshShape`] and [`PlanningError::TooManyJoints`].
    ///
    /// # Panics
    /// If `q` is not a configuration of the whole robot.
    pub fn of_group(
        model: &RobotModel,
        group: &JointGroup,
        q: &[f64],
        settings: CollisionSettings,
    ) -> Result<Self, PlanningError> {
        let is_arm = |link: &String| [&model.left, &model.right].iter().any(|arm| arm.chain.link_names.contains(link));
        let trunk = group.chain.link_names.iter().map(|link| !is_arm(link)).collect();
        Self::build(&model.tree, group.chain.clone(), group.hand_root_links.clone(), trunk, q, SelfPairs::Sampled, settings)
    }

    /// Any robot without obstacles: what hangs on `chain` moves, all else stays as in the configuration `q` of the whole tree.
    /// Links from `hand_root` on are the hand.
    ///
    /// # Errors
    /// [`PlanningError::MeshShape`] and [`PlanningError::TooManyJoints`].
    ///
    /// # Panics
    /// If `q` is not a configuration of the tree.
    pub fn of_tree(
        tree: &Tree,
        chain: Chain,
        hand_root: Option<&str>,
        q: &[f64],
        self_pairs: SelfPairs,
        settings: CollisionSettings,
    ) -> Result<Self, PlanningError> {
        Self::build(tree, chain, hand_root.map(str::to_owned).into_iter().collect(), Vec::new(), q, self_pairs, settings)
    }

    fn build(
        tree: &Tree,
        chain: Chain,
        hand_roots: Vec<String>,
        trunk: Vec<bool>,
        q: &[f64],
        self_pairs: SelfPairs,
        settings: CollisionSettings,
    ) -> Result<Self, PlanningError> {
        if chain.link_names.len() > MAX_JOINTS {
            return Err(PlanningError::TooManyJoints { n_joints: chain.link_names.len(), most: MAX_JOINTS });
        }
        let mut collision = Self {
            batch: Batch::new(&chain),
            chain,
            settings,
            hand_roots,
            carriers: Vec::new(),
            trunk,
            self_pairs,
            moving: Vec::new(),
            own_bodies: Vec::new(),
            clusters: Vec::new(),
            built_on_own: BTreeSet::new(),
            built_touching: BTreeSet::new(),
            ignored: Vec::new(),
            guarded: Vec::new(),
            obstacles: Vec::new(),
            points: None,
            allowed: Vec::new(),
        };
        collision.place_bodies(tree, q)?;
        if collision.self_pairs == SelfPairs::Sampled {
            collision.find_built_contacts();
        }
        Ok(collision)
    }

    /// Takes over a new shape of the hand (and of all that does not move with the arm) from a whole-robot configuration.
    ///
    /// # Errors
    /// [`PlanningError::MeshShape`].
    ///
    /// # Panics
    /// If `q` is not a configuration of the whole robot.
    pub fn set_robot_q(&mut self, model: &RobotModel, q: &[f64]) -> Result<(), PlanningError> {
        self.place_bodies(&model.tree, q)
    }

    /// The chain whose configurations are judged.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Replaces the world.
    pub fn set_world(&mut self, obstacles: &[Obstacle], points: Option<PointObstacles>) {
        self.obstacles = obstacles.iter().map(|o| fixed(o.name.clone(), &o.shape, &o.pose_in_base)).collect();
        self.points = points;
        self.compile();
    }

    /// Lets a part touch an obstacle (`points` stands for the cloud): the hand its target, a held thing the table it leaves.
    pub fn allow(&mut self, group: BodyGroup, with: &str) {
        self.allowed.push((group, with.to_owned()));
        self.compile();
    }

    /// Takes all permissions back.
    pub fn clear_allowed(&mut self) {
        self.allowed.clear();
        self.compile();
    }

    /// Hangs a thing on the palm (of two, on the first): balls in the palm frame, metres.
    pub fn attach(&mut self, name: &str, spheres_in_palm: &[(Point, f64)]) {
        self.attach_to(0, name, spheres_in_palm);
    }

    /// As [`Self::attach`], on tip `tip_idx` of the chain.
    ///
    /// # Panics
    /// If there is no such tip, or it does not move.
    pub fn attach_to(&mut self, tip_idx: usize, name: &str, spheres_in_palm: &[(Point, f64)]) {
        let frame_idx = self.chain.tip_joint(tip_idx).expect("a joint of the chain moves the palm");
        let poses = self.chain.fk_all(&self.chain.middle());
        let link_from_palm = poses[frame_idx].inverse() * poses[self.chain.link_names.len() + tip_idx];
        let spheres = spheres_in_palm.iter().map(|(c, r)| (link_from_palm * c, *r)).collect();
        self.moving.push(moving(name.to_owned(), BodyGroup::Attached, frame_idx, 1, spheres));
        self.index();
    }

    /// Lets go of everything attached.
    pub fn detach(&mut self) {
        self.moving.retain(|m| m.group != BodyGroup::Attached);
        self.index();
    }

    /// All balls of what moves, in configuration `q`; also what a camera may see of this arm.
    #[must_use]
    pub fn spheres(&self, q: &[f64]) -> Vec<BodySphere> {
        let frames = self.chain.fk_all(q);
        let place = |m: &Moving, (c, r): &(Point, f64)| BodySphere { centre_in_base: frames[m.frame_idx] * c, radius_m: *r };
        self.moving.iter().flat_map(|m| m.spheres.iter().map(move |s| (m, s))).map(|(m, s)| place(m, s)).collect()
    }

    /// Whether nothing touches.
    #[must_use]
    pub fn is_free(&self, q: &[f64]) -> bool {
        self.scan(q, true).is_none()
    }

    /// The deepest contact in configuration `q`.
    #[must_use]
    pub fn contact(&self, q: &[f64]) -> Option<Contact> {
        self.scan(q, false)
    }

    /// The first contact on the straight way between two configurations, checked every `step_rad`, ends included.
    #[must_use]
    pub fn contact_between(&self, a: &[f64], b: &[f64], step_rad: f64) -> Option<Contact> {
        if self.is_free_between(a, b, step_rad) {
            return None;
        }
        let n = (distance(a, b) / step_rad).ceil().max(1.0) as usize;
        // Coarse first: obstacles are wider than a step, so most blocked ways are seen early.
        const STRIDE: usize = 8;
        for offset in 0..STRIDE {
            for i in (offset..=n).step_by(STRIDE) {
                let contact = self.scan(&mix(a, b, i as f64 / n as f64), true);
                if contact.is_some() {
                    return contact;
                }
            }
        }
        None
    }

    /// Whether nothing touches on the straight way between two configurations, checked every `step_rad` or closer, end included.
    ///
    /// Eight configurations are looked at together: the planner's inner loop. The start of a way is the end of another.
    #[must_use]
    pub fn is_free_between(&self, a: &[f64], b: &[f64], step_rad: f64) -> bool {
        self.batch.is_free_between(a, b, step_rad)
    }

    /// As [`Self::is_free_between`] with both ends included, for small steps: stretches far from everything are passed over by a
    /// bound on how far the arm can move there.
    #[must_use]
    pub fn is_free_closely(&self, a: &[f64], b: &[f64], step_rad: f64) -> bool {
        self.batch.is_free_closely(a, b, step_rad)
    }

    /// The first contact along a path of configurations, checked every `step_rad`.
    #[must_use]
    pub fn contact_along(&self, path: &[Vec<f64>], step_rad: f64) -> Option<Contact> {
        if let Some(contact) = path.first().and_then(|q| self.contact(q)) {
            return Some(contact);
        }
        path.windows(2).find_map(|pair| self.contact_between(&pair[0], &pair[1], step_rad))
    }

    fn scan(&self, q: &[f64], first_only: bool) -> Option<Contact> {
        let frames = self.chain.fk_all(q);
        let bounds: Vec<Point> = self.moving.iter().map(|m| frames[m.frame_idx] * m.bound.0).collect();
        let mut worst: Option<Contact> = None;
        let mut note = |link: &str, with: &str, depth_m: f64| {
            if depth_m > 0.0 && worst.as_ref().is_none_or(|w| depth_m > w.depth_m) {
                worst = Some(Contact { link: link.to_owned(), with: with.to_owned(), depth_m });
            }
            first_only && worst.is_some()
        };
        let (margin, own_margin) = (self.settings.clearance_m, self.settings.self_clearance_m);
        for cluster in &self.clusters {
            let to_base = &frames[cluster.frame_idx];
            let (centre, reach) = (to_base * cluster.bound.0, cluster.bound.1);
            let bodies = || cluster.bodies.clone().map(|idx| (idx, &self.moving[idx]));
            for obstacle in self.obstacles.iter().filter(|o| near(&centre, reach + margin, o)) {
                for (idx, body) in bodies() {
                    if near(&bounds[idx], body.bound.1 + margin, obstacle)
                        && !self.allows(body.group, &obstacle.name)
                        && note(&body.name, &obstacle.name, depth(body, to_base, obstacle) + margin)
                    {
                        return worst;
                    }
                }
            }
            if let Some(points) = &self.points {
                for (_, body) in bodies().filter(|(_, body)| !self.allows(body.group, POINTS)) {
                    for (centre, radius) in &body.spheres {
                        let depth = points.depth_m(&(to_base * centre), radius + margin);
                        if depth.is_some_and(|depth| note(&body.name, POINTS, depth)) {
                            return worst;
                        }
                    }
                }
            }
            for (own_idx, own) in self.own_bodies.iter().enumerate().filter(|(_, own)| near(&centre, reach + own_margin, own)) {
                for (idx, body) in bodies() {
                    if !self.ignored[idx][own_idx]
                        && near(&bounds[idx], body.bound.1 + own_margin, own)
                        && note(&body.name, &own.name, depth(body, to_base, own) + own_margin)
                    {
                        return worst;
                    }
                }
            }
            for other in self.clusters.iter().take_while(|o| o.bodies.start < cluster.bodies.start) {
                let other_to_base = &frames[other.frame_idx];
                if (centre - other_to_base * other.bound.0).norm() > reach + other.bound.1 + own_margin {
                    continue;
                }
                for (idx, body) in bodies() {
                    for other_idx in other.bodies.clone() {
                        let against = &self.moving[other_idx];
                        let gap = (bounds[idx] - bounds[other_idx]).norm() - body.bound.1 - against.bound.1;
                        if gap < own_margin
                            && self.guarded[idx][other_idx]
                            && note(&body.name, &against.name, depth_between(body, to_base, against, other_to_base) + own_margin)
                        {
                            return worst;
                        }
                    }
                }
            }
        }
        worst
    }

    pub(crate) fn obstacle_shapes(&self) -> impl Iterator<Item = (&str, &Shape, Pose)> {
        self.obstacles.iter().map(|o| (o.name.as_str(), &o.shape, o.shape_from_base.inverse()))
    }

    #[cfg(test)]
    pub(crate) fn batch(&self) -> &Batch {
        &self.batch
    }

    pub(crate) fn allows(&self, group: BodyGroup, with: &str) -> bool {
        self.allowed.iter().any(|(g, name)| *g == group && name == with)
    }
}

/// Euclidean distance of two configurations, radians.
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The configuration at share `s` of the straight way.
pub(crate) fn mix(a: &[f64], b: &[f64], s: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + s * (b - a)).collect()
}

fn fixed(name: String, shape: &Shape, pose: &Pose) -> Fixed {
    Fixed {
        name,
        shape: shape.clone(),
        shape_from_base: pose.inverse(),
        centre: pose.translation.vector.into(),
        bound_m: bounding_radius_m(shape),
    }
}

fn moving(name: String, group: BodyGroup, frame_idx: usize, n_beyond: usize, spheres: Vec<(Point, f64)>) -> Moving {
    let bound = bound(spheres.iter());
    Moving { name, group, frame_idx, n_beyond, spheres, bound }
}

/// A ball about the mean centre that holds all balls.
fn bound<'a>(spheres: impl Iterator<Item = &'a (Point, f64)> + Clone) -> (Point, f64) {
    let n = spheres.clone().count().max(1) as f64;
    let centre = Point::from(spheres.clone().map(|(c, _)| c.coords).sum::<sfg_types::Vector>() / n);
    (centre, spheres.map(|(c, r)| (c - centre).norm() + r).fold(0.0, f64::max))
}

fn near(centre: &Point, radius_m: f64, body: &Fixed) -> bool {
    let reach = radius_m + body.bound_m;
    (centre - body.centre).norm_squared() < reach * reach
        && signed_distance_m(&body.shape, &(body.shape_from_base * centre)) < radius_m
}

fn depth(body: &Moving, base_from_frame: &Pose, fixed: &Fixed) -> f64 {
    let to_shape = fixed.shape_from_base * base_from_frame;
    body.spheres.iter().map(|(c, r)| r - signed_distance_m(&fixed.shape, &(to_shape * c))).fold(f64::NEG_INFINITY, f64::max)
}

fn depth_between(a: &Moving, base_from_a: &Pose, b: &Moving, base_from_b: &Pose) -> f64 {
    let b_from_a = base_from_b.inverse() * base_from_a;
    let mut deepest = f64::NEG_INFINITY;
    for (centre, radius) in &a.spheres {
        let centre = b_from_a * centre;
        for (other, other_radius) in &b.spheres {
            deepest = deepest.max(radius + other_radius - (centre - other).norm());
        }
    }
    deepest
}

#[cfg(test)]
mod tests;
