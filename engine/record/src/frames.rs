//! Where the links are: `/tf_static`, `/tf`, `/joint_states`.

use crate::messages::{JointHeader, RunHeader, nanos};
use crate::recording::{timestamp, typed};
use foxglove::messages::{FrameTransform, FrameTransforms, JointState, JointStates, Quaternion, Vector3};
use foxglove::{Channel, Context};
use sfg_types::layout::PoseLayout;
use sfg_types::{Pose, RobotState, Vector};
use std::sync::Arc;

/// A joint that moves in this run.
struct Moving {
    parent: String,
    child: String,
    joint: JointHeader,
}

pub(crate) struct Frames {
    fixed: Channel<FrameTransforms>,
    moving: Channel<FrameTransforms>,
    joints: Channel<JointStates>,
    base: String,
    arm_joints: Vec<String>,
    motors: [String; 2],
    links: Vec<Moving>,
    objects: Vec<String>,
    /// Where each link and object was, whether that was written, and when all were written last.
    last: Vec<(PoseLayout, bool)>,
    last_ns: u64,
    whole_ns: Option<u64>,
}

/// Smaller motions are noise of the simulation: metres, and parts of a unit quaternion.
const STILL: f64 = 2e-4;
/// So often everything is written, so that a viewer that jumps to a moment has all of it.
const WHOLE_EVERY_NS: u64 = 1_000_000_000;

fn has_moved(a: &PoseLayout, b: &PoseLayout) -> bool {
    let values = |pose: &PoseLayout| pose.translation.into_iter().chain(pose.rotation);
    values(a).zip(values(b)).any(|(a, b)| (a - b).abs() > STILL)
}

/// Name of an object's frame.
pub(crate) fn object_frame(name: &str) -> String {
    format!("object/{name}")
}

/// Name of a camera's frame.
pub(crate) fn camera_frame(name: &str) -> String {
    format!("camera/{name}")
}

/// Name of the frame that everything without one of its own is in.
pub(crate) fn base_frame(header: &RunHeader) -> String {
    header.links.first().map_or_else(|| "base".to_owned(), |link| link.name.clone())
}

fn pose_of(layout: &PoseLayout) -> Pose {
    let [x, y, z, w] = layout.rotation;
    let rotation = nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, x, y, z));
    let [x, y, z] = layout.translation;
    Pose::from_parts(nalgebra::Translation3::new(x, y, z), rotation)
}

/// `parent_from_link` at `q`.
fn parent_from_link(joint: &JointHeader, q: &[f64]) -> Pose {
    let origin = pose_of(&joint.origin);
    let Some(source) = &joint.source else { return origin };
    let value = source.multiplier * q.get(source.q).copied().unwrap_or(0.0) + source.offset;
    let axis = Vector::from(joint.axis);
    match joint.kind.as_str() {
        "revolute" => origin * nalgebra::UnitQuaternion::from_scaled_axis(axis * value),
        "prismatic" => origin * nalgebra::Translation3::from(axis * value),
        _ => origin,
    }
}

fn transform(log_time_ns: u64, parent: &str, child: &str, pose: &PoseLayout) -> FrameTransform {
    let ([x, y, z], [rx, ry, rz, rw]) = (pose.translation, pose.rotation);
    FrameTransform {
        timestamp: Some(timestamp(log_time_ns)),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(Vector3 { x, y, z }),
        rotation: Some(Quaternion { x: rx, y: ry, z: rz, w: rw }),
    }
}

impl Frames {
    pub(crate) fn new(context: &Arc<Context>) -> Self {
        Self {
            fixed: typed(context, "/tf_static"),
            moving: typed(context, "/tf"),
            joints: typed(context, "/joint_states"),
            base: String::new(),
            arm_joints: Vec::new(),
            motors: Default::default(),
            links: Vec::new(),
            objects: Vec::new(),
            last: Vec::new(),
            last_ns: 0,
            whole_ns: None,
        }
    }

    /// Name of the base link.
    pub(crate) fn base(&self) -> &str {
        &self.base
    }

    /// Sorts the joints into those that move and those that rest, and records the latter and the cameras.
    pub(crate) fn begin(&mut self, header: &RunHeader) {
        self.base = base_frame(header);
        self.arm_joints = header.arm_q.iter().filter_map(|q| header.q_names.get(*q).cloned()).collect();
        self.motors = [1, 2].map(|nth| format!("{}_hand_motor_{nth}", header.arm));
        self.objects = header.objects.iter().map(|object| object_frame(&object.name)).collect();
        let mut fixed = Vec::new();
        for link in &header.links {
            let (Some(parent), Some(joint)) = (link.parent.and_then(|parent| header.links.get(parent)), &link.joint) else {
                continue;
            };
            let moves = joint.source.is_some_and(|source| header.arm_q.contains(&source.q) || header.hand_q.contains(&source.q));
            if moves {
                self.links.push(Moving { parent: parent.name.clone(), child: link.name.clone(), joint: joint.clone() });
            } else {
                let pose = parent_from_link(joint, &header.rest_q);
                fixed.push(transform(0, &parent.name, &link.name, &PoseLayout::from(pose)));
            }
        }
        for camera in &header.cameras {
            fixed.push(transform(0, &self.base, &camera_frame(&camera.name), &camera.base_from_camera));
        }
        self.fixed.log_with_time(&FrameTransforms { transforms: fixed }, 0);
        self.transforms(0.0, &header.rest_q, &[]);
    }

    /// What moved since the last call; what begins to move also where it was then, so that viewers do not start it too early.
    pub(crate) fn transforms(&mut self, stamp_secs: f64, q: &[f64], objects: &[PoseLayout]) {
        let log_time_ns = nanos(stamp_secs);
        let links = self.links.iter().map(|link| PoseLayout::from(parent_from_link(&link.joint, q)));
        let poses: Vec<PoseLayout> = links.chain(objects.iter().copied()).collect();
        let is_whole = self.last.len() != poses.len() || self.whole_ns.is_none_or(|last| log_time_ns >= last + WHOLE_EVERY_NS);
        let name = |idx: usize| match self.links.get(idx) {
            Some(link) => Some((link.parent.as_str(), link.child.as_str())),
            None => self.objects.get(idx - self.links.len()).map(|object| (self.base.as_str(), object.as_str())),
        };
        let mut transforms = Vec::new();
        let mut last = Vec::with_capacity(poses.len());
        for (idx, pose) in poses.into_iter().enumerate() {
            let Some((parent, child)) = name(idx) else { break };
            let old = self.last.get(idx).filter(|_| !is_whole);
            match old {
                Some((old, _)) if !has_moved(old, &pose) => {
                    last.push((*old, false));
                    continue;
                }
                Some((old, false)) => transforms.push(transform(self.last_ns, parent, child, old)),
                _ => {}
            }
            transforms.push(transform(log_time_ns, parent, child, &pose));
            last.push((pose, true));
        }
        (self.last, self.last_ns) = (last, log_time_ns);
        if is_whole {
            self.whole_ns = Some(log_time_ns);
        }
        if !transforms.is_empty() {
            self.moving.log_with_time(&FrameTransforms { transforms }, log_time_ns);
        }
    }

    pub(crate) fn joint_states(&self, state: &RobotState) {
        let log_time_ns = nanos(state.stamp_secs);
        let arm = self.arm_joints.iter().zip(state.q.iter().zip(&state.dq)).map(|(name, (q, dq))| JointState {
            name: name.clone(),
            position: Some(*q),
            velocity: Some(*dq),
            ..JointState::default()
        });
        let motors = self.motors.iter().zip(state.hand.motor_positions).map(|(name, position)| JointState {
            name: name.clone(),
            position: Some(position),
            ..JointState::default()
        });
        let message = JointStates { timestamp: Some(timestamp(log_time_ns)), joints: arm.chain(motors).collect() };
        self.joints.log_with_time(&message, log_time_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::JointSourceHeader;

    #[test]
    fn what_stands_still_is_not_written_again() {
        let rest = PoseLayout { rotation: [0.0, 0.0, 0.0, 1.0], translation: [1.0, 0.0, 0.0] };
        let near = PoseLayout { translation: [1.0 + STILL / 2.0, 0.0, 0.0], ..rest };
        let far = PoseLayout { translation: [1.001, 0.0, 0.0], ..rest };
        assert!(!has_moved(&rest, &near) && has_moved(&rest, &far));
    }

    #[test]
    fn joints_turn_and_slide() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let joint = JointHeader {
            name: "a".to_owned(),
            kind: "revolute".to_owned(),
            origin: PoseLayout { rotation: [0.0, 0.0, 0.0, 1.0], translation: [1.0, 0.0, 0.0] },
            axis: [0.0, 0.0, 1.0],
            source: Some(JointSourceHeader { q: 1, multiplier: 0.5, offset: quarter / 2.0 }),
        };
        let turned = parent_from_link(&joint, &[9.0, quarter]) * sfg_types::Point::new(1.0, 0.0, 0.0);
        assert!((turned - sfg_types::Point::new(1.0, 1.0, 0.0)).norm() < 1e-12, "{turned}");
        let slide = JointHeader { kind: "prismatic".to_owned(), ..joint };
        assert!((parent_from_link(&slide, &[0.0, quarter]).translation.z - quarter).abs() < 1e-12);
    }
}
