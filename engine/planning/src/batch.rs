//! The collision model compiled for eight configurations at once.
//!
//! Single precision and squared distances: verdicts agree with the exact ones where a gap exceeds a micrometre. The way of
//! testing eight configurations of one motion together is that of Thomason, Kingston and Kavraki (Motions in Microseconds, 2024).

#![allow(
    clippy::needless_range_loop,
    reason = "the same index in several arrays is what the compiler turns into one instruction"
)]

#[cfg(test)]
pub(crate) mod levels;

use crate::lanes::{Lanes, Lanes3, N_LANES, minus, norm2};
use crate::points::PointObstacles;
use multiversion::multiversion;
use sfg_kinematics::{Chain, ChainJoint, Shape};
use sfg_types::{Point, Pose};
use std::ops::Range;

/// A ball: centre in the frame behind its joint, radius; metres.
#[derive(Clone, Copy, Debug)]
struct Ball {
    centre: [f32; 3],
    radius: f32,
}

/// A compiled joint of the chain; those before it come first.
#[derive(Clone, Debug)]
struct Joint {
    parent: Option<usize>,
    /// Its value is `multiplier * q[q_idx] + offset`.
    q_idx: usize,
    multiplier: f32,
    offset: f32,
    /// Row-major.
    rotation: [f32; 9],
    translation: [f32; 3],
    is_revolute: bool,
    /// Farthest that it slides, metres; 0 when it turns.
    travel: f32,
    /// No ball behind the joint is farther than this from its axis, metres.
    reach: f32,
}

#[derive(Clone, Debug)]
struct Body {
    bound: Ball,
    balls: Range<usize>,
}

/// Bodies of one link.
#[derive(Clone, Debug)]
struct Cluster {
    joint_idx: usize,
    bound: Ball,
    bodies: Range<usize>,
}

/// A shape that does not move.
#[derive(Clone, Debug)]
struct Still {
    kind: Kind,
    centre: [f32; 3],
    /// Axes of the shape, base frame, row by row.
    axes: [f32; 9],
    /// Half extents; radius and half length of what is round.
    half: [f32; 3],
    bound: f32,
    /// Distance to keep.
    margin: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Cuboid,
    Round,
}

/// What may meet: bodies of two clusters.
#[derive(Clone, Debug)]
struct Meeting {
    clusters: (usize, usize),
    pairs: Vec<(usize, usize)>,
}

/// A compiled collision model.
#[derive(Clone, Debug, Default)]
pub(crate) struct Batch {
    joints: Vec<Joint>,
    clusters: Vec<Cluster>,
    bodies: Vec<Body>,
    balls: Vec<Ball>,
    stills: Vec<Still>,
    // Body x still: may touch.
    may_touch: Vec<bool>,
    meetings: Vec<Meeting>,
    points: Option<PointObstacles>,
    points_margin: f32,
    /// Distance that bodies of two clusters keep.
    self_margin: f32,
    // Bodies that may touch the cloud.
    may_touch_points: Vec<bool>,
}

/// One moving body for [`Batch::add_cluster`].
pub(crate) struct BodySpec<'a> {
    pub(crate) balls_in_link: &'a [(Point, f64)],
    pub(crate) may_touch_points: bool,
}

impl Batch {
    /// A chain without bodies.
    pub(crate) fn new(chain: &Chain) -> Self {
        let joints = (0..chain.link_names.len())
            .map(|idx| {
                let ChainJoint { parent, q_idx, multiplier, offset, before, is_revolute, .. } = chain.joint(idx);
                let (rotation, translation) = parts(&before);
                let limits = &chain.limits[q_idx];
                let value = |q: f64| (multiplier * q + offset).abs();
                let travel = if is_revolute { 0.0 } else { value(limits.lower).max(value(limits.upper)) as f32 };
                let (multiplier, offset) = (multiplier as f32, offset as f32);
                Joint { parent, q_idx, multiplier, offset, rotation, translation, is_revolute, travel, reach: 0.0 }
            })
            .collect();
        Self { joints, ..Self::default() }
    }

    /// Adds the bodies of one link.
    pub(crate) fn add_cluster(&mut self, chain: &Chain, joint_idx: usize, bodies: &[BodySpec<'_>]) {
        let axis_from_link = chain.joint(joint_idx).axis_from_link;
        let first_body = self.bodies.len();
        let first_ball = self.balls.len();
        for body in bodies {
            let begin = self.balls.len();
            self.balls.extend(body.balls_in_link.iter().map(|(centre, radius)| {
                let centre = axis_from_link * centre;
                Ball { centre: [centre.x as f32, centre.y as f32, centre.z as f32], radius: *radius as f32 }
            }));
            self.bodies.push(Body { bound: bound(&self.balls[begin..]), balls: begin..self.balls.len() });
            self.may_touch_points.push(body.may_touch_points);
        }
        let mut reach = (self.balls[first_ball..].iter())
            .map(|ball| ball.centre.iter().map(|c| c * c).sum::<f32>().sqrt() + ball.radius)
            .fold(0.0, f32::max);
        let mut at = Some(joint_idx);
        while let Some(idx) = at {
            let joint = &mut self.joints[idx];
            joint.reach = joint.reach.max(reach);
            reach += joint.translation.iter().map(|t| t * t).sum::<f32>().sqrt() + joint.travel;
            at = joint.parent;
        }
        let bodies = first_body..self.bodies.len();
        self.clusters.push(Cluster { joint_idx, bound: bound(&self.balls[first_ball..]), bodies });
    }

    /// Adds a shape that does not move; `may_touch` tells for each body whether touching it is allowed.
    pub(crate) fn add_still(&mut self, shape: &Shape, base_from_shape: &Pose, margin_m: f64, may_touch: impl Fn(usize) -> bool) {
        let (kind, half) = match shape {
            Shape::Cuboid { half_extents_m: h } => (Kind::Cuboid, [h.x, h.y, h.z]),
            Shape::Cylinder { radius_m, half_length_m } => (Kind::Round, [*radius_m, *half_length_m, 0.0]),
            // A thin rod with a wide margin.
            Shape::Capsule { radius_m, half_length_m } => (Kind::Round, [0.0, *half_length_m, *radius_m]),
            Shape::Sphere { radius_m } => (Kind::Round, [0.0, 0.0, *radius_m]),
            Shape::Mesh { .. } => return,
        };
        let (rotation, centre) = parts(base_from_shape);
        // Rows of the transposed rotation.
        let r = rotation;
        let axes = [r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]];
        let (half, margin) = match kind {
            Kind::Cuboid => (half, margin_m),
            Kind::Round => ([half[0], half[1], 0.0], margin_m + half[2]),
        };
        let bound = crate::shapes::bounding_radius_m(shape) + margin_m;
        let half = half.map(|h| h as f32);
        self.stills.push(Still { kind, centre, axes, half, bound: bound as f32, margin: margin as f32 });
        let n_stills = self.stills.len();
        // Stored still by still: one row for each.
        self.may_touch.extend((0..self.bodies.len()).map(may_touch));
        debug_assert_eq!(self.may_touch.len(), n_stills * self.bodies.len());
    }

    /// Declares that these bodies of two clusters must not meet.
    pub(crate) fn add_meeting(&mut self, clusters: (usize, usize), pairs: Vec<(usize, usize)>) {
        if !pairs.is_empty() {
            self.meetings.push(Meeting { clusters, pairs });
        }
    }

    /// Sets the distance that moving bodies keep from each other.
    pub(crate) fn set_self_margin(&mut self, margin_m: f64) {
        self.self_margin = margin_m as f32;
    }

    /// Sets the cloud.
    pub(crate) fn set_points(&mut self, points: Option<PointObstacles>, margin_m: f64) {
        self.points = points;
        self.points_margin = margin_m as f32;
    }

    /// How far a radian of each joint moves what hangs on it, metres; 1 where the joint slides.
    pub(crate) fn reaches_m(&self) -> Vec<f64> {
        let mut reaches = vec![0.0; self.joints.iter().map(|joint| joint.q_idx + 1).max().unwrap_or(0)];
        for joint in &self.joints {
            reaches[joint.q_idx] += f64::from(joint.multiplier.abs() * if joint.is_revolute { joint.reach } else { 1.0 });
        }
        reaches
    }

    /// Whether all bodies are farther than `ball` from what stands still and than `pair` from each other in all of these configurations.
    pub(crate) fn is_clear_at(&self, configurations: &[&[f64]], ball: f32, pair: f32) -> bool {
        configurations.chunks(N_LANES).all(|eight| !any_contact_at(self, eight, Moved { ball, pair }))
    }

    /// Whether the straight way from `a` to `b` is free when looked at every `step_rad`, ends included.
    ///
    /// Stretches on which nothing comes nearer than the farthest ball can move are passed over: those are free between the
    /// looks, too.
    pub(crate) fn is_free_closely(&self, a: &[f64], b: &[f64], step_rad: f64) -> bool {
        let length = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        is_free_closely(self, a, b, (length / step_rad).max(1.0), self.moved(a, b))
    }

    /// How far a ball moves over the whole way, and how far two balls move against each other, at most.
    fn moved(&self, a: &[f64], b: &[f64]) -> Moved {
        let mut behind = [0.0_f32; MAX_JOINTS];
        let mut moved = Moved { ball: 0.0, pair: 0.0 };
        for (idx, joint) in self.joints.iter().enumerate() {
            let turn = joint.multiplier.abs() * (a[joint.q_idx] - b[joint.q_idx]).abs() as f32;
            let own = if joint.is_revolute { joint.reach * turn } else { turn };
            behind[idx] = own + joint.parent.map_or(0.0, |parent| behind[parent]);
            moved.ball = moved.ball.max(behind[idx]);
            moved.pair += own;
        }
        // Two balls share the joints below both; at worst, each has moved as far as any can.
        moved.pair = moved.pair.min(2.0 * moved.ball);
        moved
    }

    /// Whether the whole straight way from `a` to `b` is free when looked at every `step_rad`, ends included.
    pub(crate) fn is_free_between(&self, a: &[f64], b: &[f64], step_rad: f64) -> bool {
        let length = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
        let n_blocks = ((length / step_rad).ceil() / N_LANES as f64).ceil().max(1.0) as usize;
        any_contact_between(self, a, b, n_blocks).is_none()
    }
}

/// The first of `n_blocks` blocks of configurations in which something touches.
///
/// A block is spread over the whole way, so that what is in the way is mostly met by the first one.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn any_contact_between(batch: &Batch, a: &[f64], b: &[f64], n_blocks: usize) -> Option<usize> {
    let n = a.len();
    let mut q = [Lanes::splat(0.0); MAX_JOINTS];
    for block in 0..n_blocks {
        for (lane_q, (a, b)) in q.iter_mut().zip(a.iter().zip(b)) {
            for lane in 0..N_LANES {
                // The first block holds the end, and the last one of several the start.
                let share = ((lane + 1) * n_blocks - block) as f64 / (N_LANES * n_blocks) as f64;
                lane_q.0[lane] = (a + share * (b - a)) as f32;
            }
        }
        if touches(batch, &q[..n], STILL) {
            return Some(block);
        }
    }
    None
}

/// Whether anything comes nearer than `apart` in any of at most eight configurations.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn any_contact_at(batch: &Batch, configurations: &[&[f64]], apart: Moved) -> bool {
    let n = configurations[0].len();
    let mut q = [Lanes::splat(0.0); MAX_JOINTS];
    for lane in 0..N_LANES {
        // Lanes without a configuration repeat the last one.
        let configuration = configurations[lane.min(configurations.len() - 1)];
        for (lane_q, value) in q.iter_mut().zip(configuration) {
            lane_q.0[lane] = *value as f32;
        }
    }
    touches(batch, &q[..n], apart)
}

/// Bounds of a motion, metres.
#[derive(Clone, Copy, Debug)]
struct Moved {
    ball: f32,
    pair: f32,
}

/// Nothing moves.
const STILL: Moved = Moved { ball: 0.0, pair: 0.0 };

/// Stretches are split in so many when something is near.
const SPLIT: f64 = 4.0;
/// Stretches that wait to be looked at.
const MAX_WAITING: usize = 64;

/// As [`Batch::is_free_closely`]; `n_steps` looks in all.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx2+fma", "x86_64+avx2+fma"))]
fn is_free_closely(batch: &Batch, a: &[f64], b: &[f64], n_steps: f64, moved: Moved) -> bool {
    let n = a.len();
    let mut q = [Lanes::splat(0.0); MAX_JOINTS];
    // Begin and length of stretches, shares of the way.
    let mut waiting = [(0.0, 0.0); MAX_WAITING];
    waiting[0] = (0.0, 1.0);
    let mut n_waiting = 1;
    while n_waiting > 0 {
        n_waiting -= 1;
        let (begin, width) = waiting[n_waiting];
        // Looks at both ends of the stretch and between.
        let spacing = width / (N_LANES - 1) as f64;
        for (lane_q, (a, b)) in q.iter_mut().zip(a.iter().zip(b)) {
            for lane in 0..N_LANES {
                lane_q.0[lane] = (a + (begin + lane as f64 * spacing) * (b - a)) as f32;
            }
        }
        let is_last = spacing * n_steps <= 1.0;
        // Nothing between two looks is farther from one of them than half of their distance.
        let half = 0.5 * spacing as f32;
        let inflation = Moved { ball: half * moved.ball, pair: half * moved.pair };
        // A coarse look that must inflate by much tells nothing.
        if inflation.pair <= MAX_INFLATION && !touches(batch, &q[..n], inflation) {
            continue;
        }
        if is_last {
            if touches(batch, &q[..n], STILL) {
                return false;
            }
            continue;
        }
        if n_waiting + SPLIT as usize > MAX_WAITING {
            return false;
        }
        for part in 0..SPLIT as usize {
            waiting[n_waiting] = (begin + part as f64 * width / SPLIT, width / SPLIT);
            n_waiting += 1;
        }
    }
    true
}

/// Largest inflation with which a stretch is looked at, metres.
const MAX_INFLATION: f32 = 0.03;

/// Most compiled joints of a chain, those that mimic others included.
pub(crate) const MAX_JOINTS: usize = 24;

/// Frames behind the joints.
struct Frames {
    rotations: [[Lanes; 9]; MAX_JOINTS],
    translations: [Lanes3; MAX_JOINTS],
}

impl Frames {
    #[inline(always)]
    fn place(&self, joint_idx: usize, ball: &Ball) -> Lanes3 {
        let (r, t) = (&self.rotations[joint_idx], &self.translations[joint_idx]);
        let [x, y, z] = ball.centre;
        [t[0] + r[0] * x + r[1] * y + r[2] * z, t[1] + r[3] * x + r[4] * y + r[5] * z, t[2] + r[6] * x + r[7] * y + r[8] * z]
    }
}

#[inline(always)]
fn frames(joints: &[Joint], q: &[Lanes]) -> Frames {
    let zero = Lanes::splat(0.0);
    let mut frames = Frames { rotations: [[zero; 9]; MAX_JOINTS], translations: [[zero; 3]; MAX_JOINTS] };
    for (idx, joint) in joints.iter().enumerate() {
        let (c, d) = (&joint.rotation, &joint.translation);
        let (mut r, mut t) = ([zero; 9], [zero; 3]);
        if let Some(parent) = joint.parent {
            let (p, o) = (&frames.rotations[parent], &frames.translations[parent]);
            for row in 0..3 {
                let p = &p[3 * row..3 * row + 3];
                for column in 0..3 {
                    r[3 * row + column] = p[0] * c[column] + p[1] * c[3 + column] + p[2] * c[6 + column];
                }
                t[row] = o[row] + p[0] * d[0] + p[1] * d[1] + p[2] * d[2];
            }
        } else {
            for i in 0..9 {
                r[i] = Lanes::splat(c[i]);
            }
            for i in 0..3 {
                t[i] = Lanes::splat(d[i]);
            }
        }
        let value = q[joint.q_idx] * joint.multiplier + joint.offset;
        if joint.is_revolute {
            let (sin, cos) = value.sin_cos();
            for row in 0..3 {
                let (x, y) = (r[3 * row], r[3 * row + 1]);
                r[3 * row] = x * cos + y * sin;
                r[3 * row + 1] = y * cos - x * sin;
            }
        } else {
            for row in 0..3 {
                t[row] = t[row] + r[3 * row + 2] * value;
            }
        }
        (frames.rotations[idx], frames.translations[idx]) = (r, t);
    }
    frames
}

/// Whether anything touches in any of the eight configurations.
#[inline(always)]
fn touches(batch: &Batch, q: &[Lanes], moved: Moved) -> bool {
    let (inflation, pair) = (moved.ball, moved.pair + batch.self_margin);
    let frames = frames(&batch.joints, q);
    let n_bodies = batch.bodies.len();
    let mut cluster_centres = [[Lanes::splat(0.0); 3]; MAX_CLUSTERS];
    for (cluster, centre) in batch.clusters.iter().zip(&mut cluster_centres) {
        *centre = frames.place(cluster.joint_idx, &cluster.bound);
    }
    for (cluster, centre) in batch.clusters.iter().zip(&cluster_centres) {
        for (still_idx, still) in batch.stills.iter().enumerate() {
            if !is_near(still, centre, cluster.bound.radius + inflation) {
                continue;
            }
            let may_touch = &batch.may_touch[still_idx * n_bodies..(still_idx + 1) * n_bodies];
            for body_idx in cluster.bodies.clone() {
                let body = &batch.bodies[body_idx];
                if may_touch[body_idx]
                    || (cluster.bodies.len() > 1
                        && !meets(still, &frames.place(cluster.joint_idx, &body.bound), body.bound.radius + inflation))
                {
                    continue;
                }
                for ball in &batch.balls[body.balls.clone()] {
                    if meets(still, &frames.place(cluster.joint_idx, ball), ball.radius + inflation) {
                        return true;
                    }
                }
            }
        }
    }
    for Meeting { clusters, pairs } in &batch.meetings {
        let (a, b) = (&batch.clusters[clusters.0], &batch.clusters[clusters.1]);
        let gap = minus(&cluster_centres[clusters.0], &cluster_centres[clusters.1]);
        if !within(&gap, a.bound.radius + b.bound.radius + pair) {
            continue;
        }
        for (first, second) in pairs {
            let mut sides = [(a.joint_idx, &batch.bodies[*first]), (b.joint_idx, &batch.bodies[*second])];
            // Few balls of the body with more of them come near the other body.
            if sides[0].1.balls.len() < sides[1].1.balls.len() {
                sides.swap(0, 1);
            }
            let [(many_idx, many), (few_idx, few)] = sides;
            let few_centre = frames.place(few_idx, &few.bound);
            let gap = minus(&frames.place(many_idx, &many.bound), &few_centre);
            if !within(&gap, many.bound.radius + few.bound.radius + pair) {
                continue;
            }
            for ball in &batch.balls[many.balls.clone()] {
                let centre = frames.place(many_idx, ball);
                if few.balls.len() > 1 && !within(&minus(&centre, &few_centre), ball.radius + few.bound.radius + pair) {
                    continue;
                }
                for other in &batch.balls[few.balls.clone()] {
                    if within(&minus(&centre, &frames.place(few_idx, other)), ball.radius + other.radius + pair) {
                        return true;
                    }
                }
            }
        }
    }
    batch.points.as_ref().is_some_and(|points| touches_points(batch, points, &frames, inflation))
}

/// Most clusters: one a joint and what is attached.
const MAX_CLUSTERS: usize = 2 * MAX_JOINTS;

/// The cloud is asked ball by ball.
fn touches_points(batch: &Batch, points: &PointObstacles, frames: &Frames, inflation: f32) -> bool {
    batch.clusters.iter().any(|cluster| {
        cluster.bodies.clone().filter(|body_idx| !batch.may_touch_points[*body_idx]).any(|body_idx| {
            batch.balls[batch.bodies[body_idx].balls.clone()].iter().any(|ball| {
                let centre = frames.place(cluster.joint_idx, ball);
                (0..N_LANES).any(|lane| {
                    let centre = Point::new(centre[0].0[lane].into(), centre[1].0[lane].into(), centre[2].0[lane].into());
                    points.depth_m(&centre, f64::from(ball.radius + batch.points_margin + inflation)).is_some()
                })
            })
        })
    })
}

#[inline(always)]
fn within(gap: &Lanes3, reach: f32) -> bool {
    norm2(gap).any_below(reach * reach)
}

/// Whether a ball's bound may reach a shape: balls first, then the shape itself.
#[inline(always)]
fn is_near(still: &Still, centre: &Lanes3, radius: f32) -> bool {
    let c = &still.centre;
    let gap = [centre[0] - c[0], centre[1] - c[1], centre[2] - c[2]];
    within(&gap, radius + still.bound) && meets_at(still, &gap, radius)
}

/// Whether a ball meets a shape.
#[inline(always)]
fn meets(still: &Still, centre: &Lanes3, radius: f32) -> bool {
    let c = &still.centre;
    meets_at(still, &[centre[0] - c[0], centre[1] - c[1], centre[2] - c[2]], radius)
}

#[inline(always)]
fn meets_at(still: &Still, from_centre: &Lanes3, radius: f32) -> bool {
    let reach = radius + still.margin;
    let (v, a) = (from_centre, &still.axes);
    let along = |row: usize| v[0] * a[3 * row] + v[1] * a[3 * row + 1] + v[2] * a[3 * row + 2];
    let gap2 = match still.kind {
        Kind::Cuboid => {
            let x = (along(0).abs() - still.half[0]).positive();
            let y = (along(1).abs() - still.half[1]).positive();
            let z = (along(2).abs() - still.half[2]).positive();
            x * x + y * y + z * z
        }
        Kind::Round => {
            let z = along(2);
            let across = ((norm2(v) - z * z).positive().sqrt() - still.half[0]).positive();
            let beyond = (z.abs() - still.half[1]).positive();
            across * across + beyond * beyond
        }
    };
    gap2.any_below(reach * reach)
}

fn parts(pose: &Pose) -> ([f32; 9], [f32; 3]) {
    let r = pose.rotation.to_rotation_matrix();
    let mut rotation = [0.0; 9];
    for row in 0..3 {
        for column in 0..3 {
            rotation[3 * row + column] = r[(row, column)] as f32;
        }
    }
    let t = pose.translation.vector;
    (rotation, [t.x as f32, t.y as f32, t.z as f32])
}

/// A ball about the mean centre that holds all balls.
fn bound(balls: &[Ball]) -> Ball {
    let n = balls.len().max(1) as f32;
    let mut centre = [0.0; 3];
    for (axis, value) in centre.iter_mut().enumerate() {
        *value = balls.iter().map(|ball| ball.centre[axis]).sum::<f32>() / n;
    }
    let distance = |ball: &Ball| (0..3).map(|i| (ball.centre[i] - centre[i]).powi(2)).sum::<f32>().sqrt();
    // A hair more than needed, for rounding.
    let radius = balls.iter().map(|ball| distance(ball) + ball.radius).fold(0.0, f32::max) + 1e-6;
    Ball { centre, radius }
}
