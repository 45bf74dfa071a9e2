//! How near things are and how that changes with the joints: what a controller needs beside the planner's yes or no.

use super::{CollisionModel, Contact, Fixed, Moving, POINTS, near};
use crate::shapes::signed_distance_m;
use sfg_kinematics::ChainJoint;
use sfg_types::{Point, Pose, Vector};

/// One ball of what moves, and something near it.
#[derive(Clone, Debug, PartialEq)]
pub struct Gap {
    /// Distance of the surfaces less the clearance to keep, negative where it is broken, metres.
    pub gap_m: f64,
    /// Its change with each joint, metres per radian (or metre).
    pub gradient: Vec<f64>,
}

/// What a ball is near to.
enum Other<'a> {
    Fixed(&'a Fixed),
    Moving(&'a Moving, &'a (Point, f64)),
    Points,
}

struct Near<'a> {
    gap_m: f64,
    body: &'a Moving,
    ball: &'a (Point, f64),
    other: Other<'a>,
}

/// Step of difference quotients of distances, metres.
const DIFFERENCE_M: f64 = 1e-6;

impl CollisionModel {
    /// The `n` smallest gaps below `within_m` in configuration `q`, smallest first, one for each body and thing near it.
    #[must_use]
    pub fn gaps(&self, q: &[f64], within_m: f64, n: usize) -> Vec<Gap> {
        let frames = self.chain.fk_all(q);
        let mut nearest = self.near(&frames, within_m);
        nearest.sort_by(|a, b| a.gap_m.total_cmp(&b.gap_m));
        nearest.truncate(n);
        let axes = self.axes(&frames);
        nearest.iter().map(|near| Gap { gap_m: near.gap_m, gradient: self.gradient(&frames, &axes, near) }).collect()
    }

    /// The smallest gap below `within_m` in configuration `q`.
    #[must_use]
    pub fn least_gap_m(&self, q: &[f64], within_m: f64) -> Option<f64> {
        let frames = self.chain.fk_all(q);
        self.near(&frames, within_m).iter().map(|near| near.gap_m).min_by(f64::total_cmp)
    }

    fn near(&self, frames: &[Pose], within_m: f64) -> Vec<Near<'_>> {
        let mut found = Vec::new();
        let (clearance, own_clearance) = (self.settings.clearance_m, self.settings.self_clearance_m);
        let centres: Vec<Point> = self.moving.iter().map(|body| frames[body.frame_idx] * body.bound.0).collect();
        for cluster in &self.clusters {
            let to_base = &frames[cluster.frame_idx];
            let (centre, reach) = (to_base * cluster.bound.0, cluster.bound.1);
            let bodies = || cluster.bodies.clone().map(|idx| (idx, &self.moving[idx]));
            let obstacles = self.obstacles.iter().map(|obstacle| (obstacle, clearance, None));
            let own = self.own_bodies.iter().enumerate().map(|(own_idx, own)| (own, own_clearance, Some(own_idx)));
            for (fixed, margin, own_idx) in obstacles.chain(own) {
                if !near(&centre, reach + margin + within_m, fixed) {
                    continue;
                }
                let to_shape = fixed.shape_from_base * to_base;
                for (idx, body) in bodies() {
                    let may_touch =
                        own_idx.map_or_else(|| self.allows(body.group, &fixed.name), |own_idx| self.ignored[idx][own_idx]);
                    if may_touch || !near(&centres[idx], body.bound.1 + margin + within_m, fixed) {
                        continue;
                    }
                    let gap = |ball: &(Point, f64)| signed_distance_m(&fixed.shape, &(to_shape * ball.0)) - ball.1 - margin;
                    found.extend(
                        smallest(body, within_m, gap).map(|(ball, gap_m)| self.near_of(gap_m, idx, ball, Other::Fixed(fixed))),
                    );
                }
            }
            for other in self.clusters.iter().take_while(|o| o.bodies.start < cluster.bodies.start) {
                let other_to_base = &frames[other.frame_idx];
                let apart = (centre - other_to_base * other.bound.0).norm();
                if apart > reach + other.bound.1 + own_clearance + within_m {
                    continue;
                }
                for (idx, body) in bodies() {
                    for other_idx in other.bodies.clone().filter(|other_idx| self.guarded[idx][*other_idx]) {
                        let against = &self.moving[other_idx];
                        let bounds = (centres[idx] - centres[other_idx]).norm() - body.bound.1 - against.bound.1;
                        if bounds > within_m + own_clearance {
                            continue;
                        }
                        let of_pair = against.spheres.iter().filter_map(|second| {
                            let place = other_to_base * second.0;
                            let gap = |ball: &(Point, f64)| (to_base * ball.0 - place).norm() - ball.1 - second.1 - own_clearance;
                            smallest(body, within_m, gap).map(|(ball, gap_m)| (ball, second, gap_m))
                        });
                        if let Some((ball, second, gap_m)) = of_pair.min_by(|a, b| a.2.total_cmp(&b.2)) {
                            found.push(self.near_of(gap_m, idx, ball, Other::Moving(against, second)));
                        }
                    }
                }
            }
            let Some(points) = &self.points else { continue };
            for (idx, body) in bodies().filter(|(_, body)| !self.allows(body.group, POINTS)) {
                let gap = |ball: &(Point, f64)| {
                    let depth = points.depth_m(&(to_base * ball.0), ball.1 + clearance + within_m);
                    depth.map_or(f64::INFINITY, |depth| within_m - depth)
                };
                found.extend(smallest(body, within_m, gap).map(|(ball, gap_m)| self.near_of(gap_m, idx, ball, Other::Points)));
            }
        }
        found
    }

    fn near_of<'a>(&'a self, gap_m: f64, idx: usize, ball: &'a (Point, f64), other: Other<'a>) -> Near<'a> {
        Near { gap_m, body: &self.moving[idx], ball, other }
    }

    /// Change of a gap with each joint: both balls move with the joints before them.
    fn gradient(&self, frames: &[Pose], axes: &[Axis], near: &Near<'_>) -> Vec<f64> {
        let centre = frames[near.body.frame_idx] * near.ball.0;
        let normal = match &near.other {
            Other::Fixed(fixed) => slope(&centre, |p| signed_distance_m(&fixed.shape, &(fixed.shape_from_base * p))),
            Other::Moving(other, ball) => {
                (centre - frames[other.frame_idx] * ball.0).try_normalize(1e-9).unwrap_or_else(Vector::z)
            }
            Other::Points => {
                let reach = near.ball.1 + self.settings.clearance_m + near.gap_m.abs() + 0.01;
                let points = self.points.as_ref();
                slope(&centre, |p| -points.and_then(|points| points.depth_m(p, reach)).unwrap_or(0.0))
            }
        };
        let mut gradient = vec![0.0; self.chain.n_joints()];
        add_motion(axes, near.body.frame_idx, &centre, &normal, &mut gradient);
        if let Other::Moving(other, ball) = &near.other {
            add_motion(axes, other.frame_idx, &(frames[other.frame_idx] * ball.0), &-normal, &mut gradient);
        }
        gradient
    }

    fn axes(&self, frames: &[Pose]) -> Vec<Axis> {
        (0..self.chain.link_names.len())
            .map(|idx| {
                let joint = self.chain.joint(idx);
                let base_from_axis = frames[idx] * joint.axis_from_link.inverse();
                let (direction, origin) = (base_from_axis * Vector::z(), base_from_axis * Point::origin());
                Axis { joint, direction, origin }
            })
            .collect()
    }

    /// Whether in all of these configurations everything is farther than `distance_m` beyond its clearance from what stands still, and
    /// than `pair_m` from what moves as well. Eight configurations are looked at together.
    #[must_use]
    pub fn is_clear_at(&self, configurations: &[&[f64]], distance_m: f64, pair_m: f64) -> bool {
        self.batch.is_clear_at(configurations, distance_m as f32, pair_m as f32)
    }

    /// How far what hangs on each joint can be moved by a radian (or metre) of it, metres.
    #[must_use]
    pub fn reaches_m(&self) -> Vec<f64> {
        self.batch.reaches_m()
    }

    /// The deepest contact in configuration `q` when everything is to keep `distance_m` more than its clearance; such a contact is as deep
    /// as things are too near.
    pub(crate) fn contact_within(&self, q: &[f64], distance_m: f64) -> Option<Contact> {
        let frames = self.chain.fk_all(q);
        let mut near = self.near(&frames, distance_m);
        near.sort_by(|a, b| a.gap_m.total_cmp(&b.gap_m));
        let Near { gap_m, body, other, .. } = near.first()?;
        let with = match other {
            Other::Fixed(fixed) => fixed.name.clone(),
            Other::Moving(other, _) => other.name.clone(),
            Other::Points => POINTS.to_owned(),
        };
        Some(Contact { link: body.name.clone(), with, depth_m: distance_m - gap_m })
    }

    /// Keeps other distances than the model was made with: from obstacles, and of the robot's links from each other, metres.
    pub fn set_clearance(&mut self, clearance_m: f64, self_clearance_m: f64) {
        (self.settings.clearance_m, self.settings.self_clearance_m) = (clearance_m, self_clearance_m);
        self.compile();
    }
}

/// A joint's axis in the base frame.
struct Axis {
    joint: ChainJoint,
    direction: Vector,
    origin: Point,
}

/// Adds how far a point of link `frame_idx` moves along `direction` with each joint.
fn add_motion(axes: &[Axis], frame_idx: usize, point: &Point, direction: &Vector, gradient: &mut [f64]) {
    let mut at = Some(frame_idx);
    while let Some(idx) = at {
        let Axis { joint, direction: axis, origin } = &axes[idx];
        let along = if joint.is_revolute { axis.cross(&(point - origin)).dot(direction) } else { axis.dot(direction) };
        gradient[joint.q_idx] += joint.multiplier * along;
        at = joint.parent;
    }
}

/// The ball of a body with the smallest gap, if it is below `within_m`.
fn smallest(body: &Moving, within_m: f64, gap: impl Fn(&(Point, f64)) -> f64) -> Option<(&(Point, f64), f64)> {
    let nearest = body.spheres.iter().map(|ball| (ball, gap(ball))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    (nearest.1 < within_m).then_some(nearest)
}

/// Direction in which a distance grows.
fn slope(at: &Point, distance: impl Fn(&Point) -> f64) -> Vector {
    let along = |axis: usize| {
        let mut step = Vector::zeros();
        step[axis] = DIFFERENCE_M;
        (distance(&(at + step)) - distance(&(at - step))) / (2.0 * DIFFERENCE_M)
    };
    Vector::new(along(0), along(1), along(2)).try_normalize(1e-9).unwrap_or_else(Vector::z)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use crate::{CollisionModel, CollisionSettings, Obstacle};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use sfg_kinematics::ik::random_q;
    use sfg_kinematics::{RobotModel, Shape};
    use sfg_types::{HandSide, Pose, Vector};
    use std::path::Path;

    #[test]
    fn gaps_change_as_their_gradients_say() {
        let model = RobotModel::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml")).unwrap();
        let mut collision = CollisionModel::new(&model, HandSide::Left, &model.home_q, CollisionSettings::default()).unwrap();
        let table = Shape::Cuboid { half_extents_m: Vector::new(0.35, 0.7, 0.02) };
        let can = Shape::Cylinder { radius_m: 0.05, half_length_m: 0.12 };
        let obstacles = [(table, [0.8, 0.0, 0.73]), (can, [0.7, 0.3, 0.9])].map(|(shape, [x, y, z])| Obstacle {
            name: format!("{shape:?}"),
            shape,
            pose_in_base: Pose::translation(x, y, z),
        });
        collision.set_world(&obstacles, None);
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let (mut n_compared, mut n_steep) = (0, 0);
        for _ in 0..300 {
            let q = random_q(collision.chain(), &mut rng);
            let Some(gap) = collision.gaps(&q, 0.05, 1).pop() else { continue };
            assert_eq!(collision.least_gap_m(&q, 0.05), Some(gap.gap_m));
            assert_eq!(collision.is_clear_at(&[&q], 0.0, 0.0), gap.gap_m > 0.0, "{gap:?}");
            if gap.gap_m > 1e-5 {
                assert!(collision.is_clear_at(&[&q], gap.gap_m - 1e-5, gap.gap_m - 1e-5), "{gap:?}");
                assert!(!collision.is_clear_at(&[&q], gap.gap_m + 1e-5, gap.gap_m + 1e-5), "{gap:?}");
            }
            for joint in 0..q.len() {
                let moved = |step: f64| {
                    let mut q = q.clone();
                    q[joint] += step;
                    collision.least_gap_m(&q, 0.1).unwrap()
                };
                let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                // Where another pair becomes the nearest, or at an edge inside a box, there is no slope.
                n_steep += usize::from((slope - gap.gradient[joint]).abs() > 1e-3);
                n_compared += 1;
            }
        }
        assert!(n_compared > 500 && n_steep * 50 < n_compared, "{n_steep} of {n_compared} differ");
    }
}
