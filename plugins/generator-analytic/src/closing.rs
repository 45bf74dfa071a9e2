//! Quasi-static closing: every finger follows the synergy until its links meet the object or the table.
//!
//! When a link meets something, its joint and those before it stop while the joints behind go on, as in a tendon-driven hand.
//! A tip that meets the table slides on it. The object does not move. Steps are as long as the distance field allows (conservative advancement).

use crate::field::Field;
use crate::hand::{Finger, Frame, Hand};
use crate::wrench::Contact;
use sfg_types::{Point, Pose, Vector};

/// A link touches when it is this close, metres. Also the accuracy of the closing.
const TOUCH_M: f64 = 0.001;
/// A link that stopped this close counts as a contact, metres: the tendon presses it on.
const CONTACT_M: f64 = 0.002;
/// Smallest and largest step along the path, shares of it.
const STEP_RANGE: (f64, f64) = (0.004, 0.1);
/// Most steps of one finger.
const MAX_STEPS: usize = 150;
/// Most joints of a finger.
pub const MAX_JOINTS: usize = 8;
/// Smallest step by which the table pushes a knuckle back, radians: about a millimetre at the tip.
const PUSH_RAD: f64 = 0.015;
/// Shortest lever that turns a joint torque into a contact force, metres: half a phalanx.
const MIN_LEVER_M: f64 = 0.012;
/// Force that the palm and passive links can bear, newtons; they only react, so it never limits a grasp.
const PALM_CAP_NEWTONS: f64 = 100.0;
/// Palm balls whose top lies this close to the palm's surface belong to it, metres.
const PALM_SURFACE_M: f64 = 0.004;

/// Hand configurations along a synergy path, equally spaced.
#[derive(Clone, Debug, PartialEq)]
pub struct ClosingPath {
    /// `n >= 2` configurations in the joint order of the hand profile, radians.
    pub hand_qs: Vec<Vec<f64>>,
}

/// A link that met the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkContact {
    /// Index of the finger; `None` for the palm.
    pub finger_idx: Option<usize>,
    /// Where and how strongly.
    pub contact: Contact,
}

/// The hand after closing.
#[derive(Clone, Debug, PartialEq)]
pub struct Closed {
    /// Joint values, radians.
    pub hand_q: Vec<f64>,
    /// What touches the object.
    pub contacts: Vec<LinkContact>,
    /// Smallest gap between the hand and the table, metres.
    pub table_clearance_m: f64,
}

/// The scene as a hand at one palm pose sees it.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    field: &'a Field,
    base_from_palm: Frame,
    grid_from_palm: Frame,
    table_height_m: f64,
}

impl ClosingPath {
    /// Joint `idx` at `t` in [0, 1].
    #[inline]
    fn joint(&self, idx: usize, t: f64) -> f64 {
        let last = self.hand_qs.len() - 1;
        let at = t.clamp(0.0, 1.0) * last as f64;
        let low = (at as usize).min(last - 1);
        let share = at - low as f64;
        self.hand_qs[low][idx] * (1.0 - share) + self.hand_qs[low + 1][idx] * share
    }
}

impl<'a> Surroundings<'a> {
    /// The field and the table around a palm.
    #[must_use]
    pub fn new(field: &'a Field, base_from_palm: &Pose, table_height_m: f64) -> Self {
        let grid_from_palm = Frame::of(&(field.grid_from_base() * base_from_palm));
        Self { field, base_from_palm: Frame::of(base_from_palm), grid_from_palm, table_height_m }
    }

    /// Distance of a palm-frame point to the object, metres.
    #[inline]
    fn object_gap_m(&self, point_in_palm: &Vector) -> f64 {
        self.field.distance_in_grid(&Point::from(self.grid_from_palm.apply(point_in_palm)))
    }

    /// Height of a palm-frame point over the table, metres.
    #[inline]
    fn height_m(&self, point_in_palm: &Vector) -> f64 {
        self.base_from_palm.rotation.row(2).transpose().dot(point_in_palm) + self.base_from_palm.translation.z
            - self.table_height_m
    }

    /// Whether the hand with these balls keeps the given gaps to object and table.
    #[must_use]
    pub fn is_free(&self, balls_in_palm: &[crate::hand::Ball], object_gap_m: f64, table_gap_m: f64) -> bool {
        balls_in_palm.iter().all(|b| self.height_m(&b.centre) >= b.radius_m + table_gap_m)
            && balls_in_palm.iter().all(|b| self.object_gap_m(&b.centre) >= b.radius_m + object_gap_m)
    }

    /// Closes the hand along `path`; the palm counts as touching when its gap to the object is at most `palm_reach_m`.
    #[must_use]
    pub fn close(&self, hand: &Hand, path: &ClosingPath, palm_reach_m: Option<f64>) -> Closed {
        let mut hand_q = path.hand_qs[0].clone();
        let mut contacts = Vec::with_capacity(16);
        let mut table_clearance_m =
            hand.palm_balls.iter().map(|b| self.height_m(&b.centre) - b.radius_m).fold(f64::INFINITY, f64::min);
        for (finger_idx, finger) in hand.fingers.iter().enumerate() {
            let frames = self.close_finger(finger, path, &mut hand_q);
            self.finger_contacts(finger_idx, finger, &frames, path, &mut contacts);
            for (joint, frame) in finger.joints.iter().zip(&frames) {
                for ball in &joint.balls {
                    table_clearance_m = table_clearance_m.min(self.height_m(&frame.apply(&ball.centre)) - ball.radius_m);
                }
            }
        }
        if let Some(reach_m) = palm_reach_m {
            self.palm_contacts(hand, reach_m, &mut contacts);
        }
        Closed { hand_q, contacts, table_clearance_m }
    }

    /// Moves one finger as far as it goes; returns its link frames in the palm.
    fn close_finger(&self, finger: &Finger, path: &ClosingPath, hand_q: &mut [f64]) -> Vec<Frame> {
        let n = finger.joints.len();
        let mut frames = vec![Frame::of(&Pose::identity()); n];
        let mut n_stopped = 0;
        let mut t = 0.0;
        // How far the table has pushed each joint back from the path, radians.
        let mut pushed_rad = [0.0; MAX_JOINTS];
        for _ in 0..MAX_STEPS {
            for (joint, pushed) in finger.joints.iter().zip(pushed_rad).skip(n_stopped) {
                let idx = joint.hand_q_idx;
                hand_q[idx] = (path.joint(idx, t) - pushed).max(path.joint(idx, 0.0).min(path.joint(idx, t)));
            }
            for k in n_stopped..n {
                let parent = if k == 0 { Frame::of(&Pose::identity()) } else { frames[k - 1] };
                frames[k] = finger.joints[k].link_frame(&parent, hand_q[finger.joints[k].hand_q_idx]);
            }
            if t >= 1.0 {
                break;
            }
            // Joint speeds over the next stretch, per unit of t.
            let ahead = (t + STEP_RANGE.1).min(1.0);
            let mut rates = [0.0; MAX_JOINTS];
            for (j, joint) in finger.joints.iter().enumerate().skip(n_stopped) {
                rates[j] = (path.joint(joint.hand_q_idx, ahead) - path.joint(joint.hand_q_idx, t)).abs() / (ahead - t);
            }
            let mut step = STEP_RANGE.1;
            let mut touched = None;
            let mut table_gap = f64::INFINITY;
            for (k, joint) in finger.joints.iter().enumerate().skip(n_stopped) {
                let gap = joint
                    .balls
                    .iter()
                    .map(|b| {
                        let centre = frames[k].apply(&b.centre);
                        table_gap = table_gap.min(self.height_m(&centre) - b.radius_m);
                        self.object_gap_m(&centre) - b.radius_m
                    })
                    .fold(f64::INFINITY, f64::min);
                let speed: f64 = (n_stopped..=k).map(|j| rates[j] * finger.joints[j].reach_m[k]).sum();
                if gap <= TOUCH_M {
                    // A link that does not move (a passive knuckle) does not hold the others back.
                    if speed > 1e-9 {
                        touched = Some(k);
                    }
                } else if speed > 1e-9 {
                    step = step.min((gap - 0.5 * TOUCH_M) / speed);
                }
            }
            if table_gap < TOUCH_M {
                // The tip slides on the table: the joint nearest to the palm that still can gives way, the rest goes on curling.
                let gives = |j: usize| {
                    let idx = finger.joints[j].hand_q_idx;
                    is_driven(path, idx) && hand_q[idx] > path.joint(idx, 0.0) + 1e-9
                };
                let Some(pivot) = (n_stopped..n - 1).find(|&j| gives(j)) else { break };
                pushed_rad[pivot] += ((TOUCH_M - table_gap) / finger.joints[pivot].reach_m[n - 1]).max(PUSH_RAD);
                if touched.is_none() {
                    continue;
                }
            } else {
                let speed: f64 = (n_stopped..n).map(|j| rates[j] * finger.joints[j].reach_m[n - 1]).sum();
                if speed > 1e-9 {
                    step = step.min((table_gap - 0.5 * TOUCH_M).max(0.0) / speed);
                }
            }
            if let Some(k) = touched {
                n_stopped = k + 1;
                if n_stopped == n {
                    break;
                }
                continue;
            }
            t = (t + step.max(STEP_RANGE.0)).min(1.0);
        }
        frames
    }

    /// Lever of a contact about joint `j`, positive when pressing there is closing, metres.
    fn lever(&self, finger: &Finger, frames: &[Frame], j: usize, point_in_base: &Point, inward_normal: &Vector) -> f64 {
        let axis = self.base_from_palm.rotation * (frames[j].rotation * finger.joints[j].axis.into_inner());
        let arm = point_in_base.coords - self.base_from_palm.apply(&frames[j].translation);
        axis.cross(&arm).dot(inward_normal)
    }

    fn finger_contacts(
        &self,
        finger_idx: usize,
        finger: &Finger,
        frames: &[Frame],
        path: &ClosingPath,
        contacts: &mut Vec<LinkContact>,
    ) {
        let mut first_loaded = 0;
        for (k, joint) in finger.joints.iter().enumerate() {
            let nearest = joint
                .balls
                .iter()
                .map(|b| (frames[k].apply(&b.centre), b.radius_m))
                .map(|(centre, radius_m)| (self.object_gap_m(&centre) - radius_m, centre, radius_m))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((gap, centre, radius_m)) = nearest else { continue };
            if gap > CONTACT_M {
                continue;
            }
            let (point_in_base, inward_normal) = self.surface_below(&centre, radius_m + gap);
            let mut cap_newtons = PALM_CAP_NEWTONS;
            // Joints before the last touching link are propped up by that link.
            for j in first_loaded..=k {
                let loaded = &finger.joints[j];
                if !is_driven(path, loaded.hand_q_idx) {
                    continue;
                }
                let lever_m = self.lever(finger, frames, j, &point_in_base, &inward_normal).abs().max(MIN_LEVER_M);
                cap_newtons = cap_newtons.min(loaded.max_torque_nm / lever_m);
            }
            first_loaded = k + 1;
            contacts.push(LinkContact {
                finger_idx: Some(finger_idx),
                contact: Contact { point_in_base, inward_normal, cap_newtons },
            });
        }
    }

    /// Up to three points of the palm's surface: the nearest and the two furthest from each other.
    fn palm_contacts(&self, hand: &Hand, reach_m: f64, contacts: &mut Vec<LinkContact>) {
        let on_surface = |b: &&crate::hand::Ball| b.centre.z + b.radius_m > -PALM_SURFACE_M && b.centre.z + b.radius_m < 0.02;
        let mut near: Vec<(f64, Vector, f64)> = hand
            .palm_balls
            .iter()
            .filter(on_surface)
            .map(|b| (self.object_gap_m(&b.centre) - b.radius_m, b.centre, b.radius_m))
            .filter(|(gap, ..)| *gap <= reach_m)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(&nearest) = near.first() else { return };
        near.retain(|(gap, ..)| *gap <= nearest.0 + TOUCH_M);
        let far = |from: &Vector| near.iter().max_by(|a, b| (a.1 - from).norm().total_cmp(&(b.1 - from).norm())).copied();
        let mut chosen = vec![nearest];
        if let Some(second) = far(&nearest.1) {
            chosen.push(second);
            chosen.extend(far(&second.1));
        }
        let mut places: Vec<Vector> = Vec::new();
        chosen.retain(|(_, centre, _)| {
            let is_new = !places.contains(centre);
            places.push(*centre);
            is_new
        });
        for (gap, centre, radius_m) in chosen {
            let (point_in_base, inward_normal) = self.surface_below(&centre, radius_m + gap);
            let contact = Contact { point_in_base, inward_normal, cap_newtons: PALM_CAP_NEWTONS };
            contacts.push(LinkContact { finger_idx: None, contact });
        }
    }

    /// Object surface nearest to a ball and the normal into the object, base frame.
    fn surface_below(&self, centre_in_palm: &Vector, distance_m: f64) -> (Point, Vector) {
        let centre = Point::from(self.base_from_palm.apply(centre_in_palm));
        let outward = self.field.outward_normal(&centre);
        (centre - outward * distance_m, -outward)
    }
}

fn is_driven(path: &ClosingPath, hand_q_idx: usize) -> bool {
    let first = path.hand_qs[0][hand_q_idx];
    path.hand_qs.iter().any(|q| (q[hand_q_idx] - first).abs() > 1e-6)
}
