//! Each suite passes a lawful implementation and names the law that a broken one breaks.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use super::*;
use crate::{
    AffordanceQuery, ClosingPlan, Driver, DriverInfo, FunctionalityRequest, GraspPolicy, GraspPolicyState, Grounder, LlmBackend,
    PolicyStep, PoseGenerator, PoseRequest, SelfSphere,
};
use sfg_types::{
    AffordanceMask, ColourName, FunctionalityAnswer, GraspFunctionality, GraspType, HandFeedback, HandProfile, HandSide,
    ObjectCluster, Observation, PalmPoseCandidate, Point, Pose, RobotCommand, RobotState, SceneInventory, ShapeClass,
    SynergyCoordinates, Task, Vector,
};

#[track_caller]
fn check(result: Result<(), Vec<String>>, expected: &[&str]) {
    let broken = result.err().unwrap_or_default();
    assert_eq!(broken.is_empty(), expected.is_empty(), "{broken:#?}");
    for part in expected {
        assert!(broken.iter().any(|law| law.contains(part)), "no law says {part:?}: {broken:#?}");
    }
}

/// Answers with one pose over the key point, after `spoil`.
struct OverKeyPoint(fn(&mut PalmPoseCandidate, usize) -> usize, usize);

impl PoseGenerator for OverKeyPoint {
    fn generate(&mut self, request: &PoseRequest<'_>, out: &mut [PalmPoseCandidate]) -> Result<usize, PluginError> {
        self.1 += 1;
        let Some(first) = out.first_mut().filter(|_| request.key_point.n_pixels > 0) else { return Ok(0) };
        first.base_from_palm = Pose::translation(0.0, 0.0, 0.1) * Pose::from(request.key_point.point_in_base.coords);
        first.hand_side = request.hand_side;
        first.stability = 0.5;
        Ok((self.0)(first, self.1))
    }
}

#[test]
fn pose_generator() {
    let run = |spoil| pose_generator_suite(&mut OverKeyPoint(spoil, 0), &hand_profile());
    check(run(|_, _| 1), &[]);
    check(run(|_, _| 99), &["99 candidates were claimed, there was room for 1"]);
    check(
        run(|pose, _| {
            pose.stability = f64::NAN;
            1
        }),
        &["the stability is not finite"],
    );
    check(
        run(|pose, call| {
            pose.stability = 1.0 / call as f64;
            1
        }),
        &["two different answers"],
    );
    check(
        run(|pose, _| {
            pose.hand_side = HandSide::Right;
            1
        }),
        &["for the right hand"],
    );
}

/// Finds saturated pixels and boxes them in.
struct ByColour {
    heed_robot: bool,
    mask_value: u8,
}

impl Grounder for ByColour {
    fn list_scene(&mut self, observation: &Observation, robot: &[SelfSphere]) -> Result<SceneInventory, PluginError> {
        let mut clusters: Vec<ObjectCluster> = Vec::new();
        for channel in [2_usize, 0] {
            let mut points = Vec::new();
            for view in &observation.views {
                for (pixel, rgb) in view.rgb.chunks(3).enumerate() {
                    let (column, row) = (pixel % view.intrinsics.width, pixel / view.intrinsics.width);
                    let depth = f64::from(view.depth_m[pixel]);
                    let point = view.base_from_camera * view.intrinsics.deproject(column as f64, row as f64, depth);
                    let own = |sphere: &SelfSphere| (point - sphere.centre_in_base).norm() < sphere.radius_m;
                    if depth > 0.0 && rgb[channel] > 150 && !(self.heed_robot && robot.iter().any(own)) {
                        points.push(point);
                    }
                }
            }
            if points.is_empty() {
                continue;
            }
            let low = points.iter().fold(Point::from([9.0; 3]), |a, b| a.inf(b));
            let high = points.iter().fold(Point::from([-9.0; 3]), |a, b| a.sup(b));
            clusters.push(ObjectCluster {
                id: clusters.len() as u32,
                size_m: high - low,
                yaw_rad: 0.0,
                centre_in_base: nalgebra::center(&low, &high),
                colour: ColourName::Red,
                shape: ShapeClass::Box,
                names: Vec::new(),
                points_in_base: points.iter().map(|point| point.cast()).collect(),
            });
        }
        Ok(SceneInventory { clusters, table_height_m: 0.75 })
    }

    fn ground(&mut self, _: &AffordanceQuery<'_>, out: &mut [AffordanceMask]) -> Result<(), PluginError> {
        out.iter_mut().for_each(|mask| mask.pixels[0] = self.mask_value);
        Ok(())
    }
}

#[test]
fn grounder() {
    check(grounder_suite(&mut ByColour { heed_robot: true, mask_value: 1 }), &[]);
    check(grounder_suite(&mut ByColour { heed_robot: false, mask_value: 1 }), &["the robot's own body was listed"]);
    check(grounder_suite(&mut ByColour { heed_robot: true, mask_value: 255 }), &["values other than 0 and 1"]);
}

/// Looks for the names of the inventory in the sentence, in order: object, then target.
struct ByWord {
    confidence: f64,
    refuses: bool,
}

impl LlmBackend for ByWord {
    fn infer(&mut self, request: &FunctionalityRequest<'_>) -> Result<FunctionalityAnswer, PluginError> {
        let mut named =
            request.inventory.clusters.iter().filter(|cluster| request.instruction.as_str().contains(&cluster.names[0].name));
        let reference =
            |cluster: &ObjectCluster| sfg_types::ObjectRef { cluster_id: cluster.id, name: cluster.names[0].name.clone() };
        let Some(object) = named.next() else {
            return Ok(match self.refuses {
                true => FunctionalityAnswer::Refuse { reason: "nothing of that name is on the table".to_owned() },
                false => FunctionalityAnswer::Ask { question: "what?".to_owned(), choices: vec!["this".to_owned()] },
            });
        };
        Ok(FunctionalityAnswer::Act(GraspFunctionality {
            object: reference(object),
            task: Task::Pour,
            target: named.next().map(reference),
            affordance: "body".to_owned(),
            grasp_type: GraspType::MediumWrap,
            confidence: self.confidence,
            rationale: vec!["the sentence names it".to_owned()],
        }))
    }
}

#[test]
fn llm_backend() {
    check(llm_backend_suite(&mut ByWord { confidence: 0.5, refuses: true }), &[]);
    check(llm_backend_suite(&mut ByWord { confidence: 1.5, refuses: true }), &["confidence 1.5 is outside [0, 1]"]);
    check(llm_backend_suite(&mut ByWord { confidence: 0.5, refuses: false }), &["is not refused", "leaves 1 choices"]);
}

/// Closes at a steady speed until the target or the current limit.
struct Steady {
    target: SynergyCoordinates,
    max_current_amps: f64,
    speed: f64,
}

impl GraspPolicy for Steady {
    fn start(&mut self, plan: &ClosingPlan, hand: &HandProfile) -> Result<(), PluginError> {
        (self.target, self.max_current_amps) = (plan.target, 0.5 * hand.max_current_amps);
        Ok(())
    }

    fn step(&mut self, state: &GraspPolicyState, feedback: &HandFeedback) -> Result<PolicyStep, PluginError> {
        let next = state.synergy.c1 + self.speed * state.period_secs;
        let met = feedback.motor_currents_amps.iter().any(|current| *current > self.max_current_amps);
        Ok(PolicyStep {
            synergy: SynergyCoordinates::new(next, 0.0),
            palm_correction: [0.0; 6],
            done: met || next >= self.target.c1,
        })
    }
}

#[test]
fn grasp_policy() {
    let run = |speed| {
        let mut policy = Steady { target: SynergyCoordinates::OPEN, max_current_amps: 0.5, speed };
        grasp_policy_suite(&mut policy, &hand_profile())
    };
    check(run(1.0), &[]);
    check(run(0.0), &["not done after 20 s"]);
    check(run(-1.0), &["is outside [0, 1] x [-1, 1]"]);
    check(run(f64::NAN), &["the set point (NaN, 0) is outside"]);
}

/// A robot that is at once where it is told to be.
struct Puppet {
    state: RobotState,
    next: Vec<f64>,
    checks: bool,
    clock_error_secs: f64,
}

impl Driver for Puppet {
    fn info(&self) -> DriverInfo {
        DriverInfo { name: "puppet".to_owned(), period_secs: 0.01, side: HandSide::Left }
    }

    fn observe(&mut self) -> Result<Observation, PluginError> {
        Ok(table_observation(&[]))
    }

    fn state(&mut self) -> Result<RobotState, PluginError> {
        Ok(self.state.clone())
    }

    fn command(&mut self, command: &RobotCommand) -> Result<(), PluginError> {
        let hand = [command.hand.synergy, command.hand.manipulation];
        let finite = command.q.iter().chain(&command.dq).chain(&hand).all(|value| value.is_finite());
        if self.checks && !(finite && command.q.len() == self.state.q.len()) {
            return Err(PluginError::Failed { plugin: "puppet".to_owned(), message: "not a command".to_owned() });
        }
        self.next.clone_from(&command.q);
        Ok(())
    }

    fn advance(&mut self) -> Result<(), PluginError> {
        self.state.q.clone_from(&self.next);
        self.state.stamp_secs += 0.01 + self.clock_error_secs;
        Ok(())
    }

    fn stop(&mut self) -> Result<(), PluginError> {
        self.next.clone_from(&self.state.q);
        Ok(())
    }
}

#[test]
fn driver() {
    let run = |checks, clock_error_secs| {
        let state = RobotState { q: vec![0.1, -0.2], dq: vec![0.0; 2], ..RobotState::default() };
        driver_suite(&mut Puppet { next: state.q.clone(), state, checks, clock_error_secs })
    };
    check(run(true, 0.0), &[]);
    check(run(false, 0.0), &["a command with a joint position that is not a number was accepted"]);
    check(run(true, 0.001), &["the clock is"]);
}

#[test]
fn a_block_is_seen_where_it_stands() {
    let block = Block { at_m: [0.65, 0.1], size_m: [0.08, 0.06, 0.16], rgb: [200, 40, 40] };
    for view in table_observation(&[block]).views {
        let top = view.base_from_camera.inverse_transform_point(&(block.centre_in_base() + Vector::z() * 0.08));
        let pixel = view.intrinsics.project(&top).unwrap();
        let index = pixel.y.round() as usize * view.intrinsics.width + pixel.x.round() as usize;
        assert!((f64::from(view.depth_m[index]) - top.z).abs() < 0.002, "camera {}", view.camera);
        assert_eq!(view.rgb[3 * index..3 * index + 3], block.rgb);
    }
}
