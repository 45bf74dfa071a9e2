//! How near things are and how that changes with the joints: what a controller needs beside the planner's yes or no.

use super::{CollisionModel, Contact, Fixed, Moving, POINTS, near};
use crate::shapes::signed_distance_m;
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
        nearest.iter().map(|near| Gap { gap_m: near.gap_m, gradient: self.gradient(&frames, near) }).collect()
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
        for (idx, body) in self.moving.iter().enumerate() {
            let to_base = &frames[body.frame_idx];
            let centre = to_base * body.bound.0;
            let obstacles = self.obstacles.iter().filter(|o| !self.allows(body.group, &o.name)).map(|o| (o, clearance));
            let own = self
                .own_bodies
                .iter()
                .enumerate()
                .filter(|(own_idx, _)| !self.ignored[idx][*own_idx])
                .map(|(_, o)| (o, own_clearance));
            for (fixed, margin) in obstacles.chain(own) {
                if !near(&centre, body.bound.1 + margin + within_m, fixed) {
                    continue;
                }
                let gap = |ball: &(Point, f64)| {
                    signed_distance_m(&fixed.shape, &(fixed.shape_from_base * (to_base * ball.0))) - ball.1 - margin
                };
                found.extend(smallest(body, within_m, gap, |_| Other::Fixed(fixed)));
            }
            for (other_idx, other) in self.moving[..idx].iter().enumerate().filter(|(other_idx, _)| self.guarded[idx][*other_idx])
            {
                debug_assert!(other_idx < idx);
                let other_to_base = &frames[other.frame_idx];
                let bounds = (centre - other_to_base * other.bound.0).norm() - body.bound.1 - other.bound.1;
                if bounds > within_m + own_clearance {
                    continue;
                }
                for against in &other.spheres {
                    let place = other_to_base * against.0;
                    let gap = |ball: &(Point, f64)| (to_base * ball.0 - place).norm() - ball.1 - against.1 - own_clearance;
                    found.extend(smallest(body, within_m, gap, |_| Other::Moving(other, against)));
                }
            }
            if let Some(points) = self.points.as_ref().filter(|_| !self.allows(body.group, POINTS)) {
                let gap = |ball: &(Point, f64)| {
                    let depth = points.depth_m(&(to_base * ball.0), ball.1 + clearance + within_m);
                    depth.map_or(f64::INFINITY, |depth| within_m - depth)
                };
                found.extend(smallest(body, within_m, gap, |_| Other::Points));
            }
        }
        found
    }

    /// Change of a gap with each joint: both balls move with the joints before them.
    fn gradient(&self, frames: &[Pose], near: &Near<'_>) -> Vec<f64> {
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
        self.add_motion(frames, near.body.frame_idx, &centre, &normal, &mut gradient);
        if let Other::Moving(other, ball) = &near.other {
            self.add_motion(frames, other.frame_idx, &(frames[other.frame_idx] * ball.0), &-normal, &mut gradient);
        }
        gradient
    }

    /// Adds how far a point of link `frame_idx` moves along `direction` with each joint.
    fn add_motion(&self, frames: &[Pose], frame_idx: usize, point: &Point, direction: &Vector, gradient: &mut [f64]) {
        for joint_idx in std::iter::successors(Some(frame_idx), |idx| self.chain.joint(*idx).parent) {
            let joint = self.chain.joint(joint_idx);
            let base_from_axis = frames[joint_idx] * joint.axis_from_link.inverse();
            let axis = base_from_axis * Vector::z();
            let arm = point - base_from_axis * Point::origin();
            let along = if joint.is_revolute { axis.cross(&arm).dot(direction) } else { axis.dot(direction) };
            gradient[joint.q_idx] += joint.multiplier * along;
        }
    }

    /// Whether nothing comes nearer than `distance_m` beyond its clearance in any of these configurations, eight at a time.
    #[must_use]
    pub fn is_clear_at(&self, configurations: &[&[f64]], distance_m: f64) -> bool {
        self.batch.is_clear_at(configurations, distance_m as f32)
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

/// The ball of a body with the smallest gap, if it is below `within_m`.
fn smallest<'a>(
    body: &'a Moving,
    within_m: f64,
    gap: impl Fn(&(Point, f64)) -> f64,
    other: impl Fn(&(Point, f64)) -> Other<'a>,
) -> Option<Near<'a>> {
    let (ball, gap_m) = body.spheres.iter().map(|ball| (ball, gap(ball))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    (gap_m < within_m).then(|| Near { gap_m, body, ball, other: other(ball) })
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
            assert_eq!(collision.is_clear_at(&[&q], 0.0), gap.gap_m > 0.0, "{gap:?}");
            if gap.gap_m > 1e-5 {
                assert!(collision.is_clear_at(&[&q], gap.gap_m - 1e-5), "{gap:?}");
                assert!(!collision.is_clear_at(&[&q], gap.gap_m + 1e-5), "{gap:?}");
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
