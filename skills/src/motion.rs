//! Following arm trajectories, shared by the skills that move.

use crate::arm::ArmScene;
use crate::context::{SkillContext, SkillFailure, StageNote, hash_of};
use crate::robot::Robot;
use crate::saved::starts_anew;
use sfg_tree::{Action, Literal, Outcome, PortSpec, Progress, Registry, Tick};
use sfg_types::{FailureReason, JointTrajectory, SceneInventory};

/// A measured joint farther than this from its set point means that something blocks or drives the arm, radians.
const MAX_TRACKING_ERROR_RAD: f64 = 0.15;
/// Time given to come to rest at the end.
const SETTLE_SECS: f64 = 0.1;

/// Follows one trajectory.
#[derive(Clone, Debug)]
pub struct Follower {
    trajectory: JointTrajectory,
    start_secs: Option<f64>,
    /// Share of the trajectory's own speed that is asked for, and that is gone at now.
    pace: (f64, f64),
    /// How far a pace below 1 has put the motion behind, seconds; negative when it begins in the middle.
    lag_secs: f64,
    /// Where the arm stood beside the trajectory when it took it up.
    beside: Vec<f64>,
    /// Periods in which the robot had been held, and the time in the trajectory, at the last set point.
    last: (u64, f64),
}

/// An arm farther from a motion than this does not take it up: the way there was not checked, radians.
pub(crate) const MAX_BESIDE_RAD: f64 = 0.2;
/// An arm that takes up a trajectory in the middle is on it after this time.
const TAKE_UP_SECS: f64 = 1.0;

/// A ramp to rest ends within this time; the nearest of so many places is where the motion goes on.
const RAMP_SECS: f64 = 1.0;
const GO_ON_STEPS: u32 = 100;

/// The pace changes by this much a second at most, so that the arm does not jerk.
const PACE_CHANGE_PER_SEC: f64 = 1.0;

impl Follower {
    /// Follows `trajectory` from the next period on.
    #[must_use]
    pub fn new(trajectory: JointTrajectory) -> Self {
        Self { trajectory, start_secs: None, pace: (1.0, 1.0), lag_secs: 0.0, beside: Vec::new(), last: (0, 0.0) }
    }

    /// Follows `trajectory` from where it passes nearest to `q`, beginning at rest; and that distance, radians.
    #[must_use]
    pub fn taken_up(trajectory: JointTrajectory, q: &[f64]) -> (Self, f64) {
        let distance = |sample: &Vec<f64>| sample.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let nearest = (0..trajectory.q.len()).min_by(|&a, &b| distance(&trajectory.q[a]).total_cmp(&distance(&trajectory.q[b])));
        let Some(nearest) = nearest else { return (Self::new(trajectory), f64::INFINITY) };
        let distance_rad = distance(&trajectory.q[nearest]);
        let beside = q.iter().zip(&trajectory.q[nearest]).map(|(q, sample)| q - sample).collect();
        let lag_secs = -trajectory.stamps_secs[nearest];
        (Self { trajectory, start_secs: None, pace: (1.0, 0.0), lag_secs, beside, last: (0, 0.0) }, distance_rad)
    }

    /// Goes on after the robot was held: from rest at `q`, which a ramp to rest has put a little ahead and beside.
    fn go_on(&mut self, q: &[f64]) {
        let t_secs = self.last.1;
        let distance = |sample: &[f64]| sample.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let times = (0..=GO_ON_STEPS).map(|step| t_secs + RAMP_SECS * f64::from(step) / f64::from(GO_ON_STEPS));
        let samples = times.map(|t_secs| (t_secs, self.trajectory.sample(t_secs).0));
        let nearest = samples.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
        let Some((t_secs, sample)) = nearest else { return };
        self.beside = q.iter().zip(&sample).map(|(q, sample)| q - sample).collect();
        (self.start_secs, self.lag_secs, self.pace.1) = (None, -t_secs, 0.0);
    }

    /// Goes on at this share of the trajectory's own speed, 0 to 1, reached gradually.
    pub fn set_pace(&mut self, pace: f64) {
        self.pace.0 = pace.clamp(0.0, 1.0);
    }

    /// Sets the coming set point.
    ///
    /// # Errors
    /// [`FailureReason::TrackingLost`] when the arm does not follow.
    pub fn poll(&mut self, robot: &mut Robot) -> Result<Progress, SkillFailure> {
        if self.start_secs.is_some() && self.last.0 != robot.n_held() {
            self.go_on(&robot.sent().q);
        }
        let start_secs = *self.start_secs.get_or_insert(robot.active_secs());
        let (joint, error_rad) = worst_tracking_error(robot);
        if error_rad > MAX_TRACKING_ERROR_RAD {
            return Err(SkillFailure::new(
                FailureReason::TrackingLost,
                format!("joint {:?} is {error_rad:.2} rad from its set point", robot.chain().joint_names[joint]),
            ));
        }
        let (wanted, pace) = &mut self.pace;
        let change = PACE_CHANGE_PER_SEC * robot.period_secs();
        *pace += (*wanted - *pace).clamp(-change, change);
        self.lag_secs += robot.period_secs() * (1.0 - *pace);
        let t_secs = robot.active_secs() - start_secs + robot.period_secs() - self.lag_secs;
        self.last = (robot.n_held(), t_secs);
        let (mut q, dq) = self.trajectory.sample(t_secs);
        let mut dq: Vec<f64> = dq.into_iter().map(|velocity| velocity * *pace).collect();
        if !self.beside.is_empty() {
            let s = ((robot.active_secs() - start_secs + robot.period_secs()) / TAKE_UP_SECS).min(1.0);
            // Begins and ends at rest.
            let rest = 1.0 - s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
            let change_per_sec = -30.0 * s * s * (1.0 - s).powi(2) / TAKE_UP_SECS;
            for (joint, beside) in self.beside.iter().enumerate() {
                q[joint] += rest * beside;
                dq[joint] += change_per_sec * beside;
            }
        }
        robot.set_arm(q, dq);
        Ok(if t_secs >= self.trajectory.duration_secs() + SETTLE_SECS { Progress::Success } else { Progress::Running })
    }
}

fn worst_tracking_error(robot: &Robot) -> (usize, f64) {
    let errors = robot.state().q.iter().zip(&robot.sent().q).map(|(measured, sent)| (measured - sent).abs());
    errors.enumerate().fold((0, 0.0), |worst, (joint, error)| if error > worst.1 { (joint, error) } else { worst })
}

/// `move_joints`: moves the acting arm to a configuration, clear of the robot itself.
///
/// | port | direction | type | meaning |
/// |---|---|---|---|
/// | `q_rad` | setting | list of numbers | joint positions, one a joint of the arm |
/// | `speed` | setting | number | share of the speed limits, 0 to 1 |
///
/// Success at the goal; Failure `no_path`, `limit_violated` or `tracking_lost`; halt brings the arm to rest.
#[derive(Default)]
struct MoveJoints {
    follower: Option<Follower>,
}

impl Action<SkillContext> for MoveJoints {
    fn start(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let q_goal = tick.get::<Vec<f64>>("q_rad")?;
        let speed = tick.get::<f64>("speed")?;
        let context = &mut *tick.context;
        let outcome = plan_to(context, &SceneInventory::default(), &q_goal, speed).map(|trajectory| {
            let note = StageNote {
                summary: format!("{:.1} s of motion to {q_goal:.2?}", trajectory.duration_secs()),
                input_sha256: hash_of(&(&context.robot.sent().q, &q_goal)),
                details: serde_json::json!({"duration_secs": trajectory.duration_secs()}),
            };
            (trajectory, note)
        });
        let trajectory = context.finish_stage("move_joints", outcome)?;
        self.follower = Some(Follower::new(trajectory));
        self.poll(tick)
    }

    fn poll(&mut self, tick: &mut Tick<'_, SkillContext>) -> Outcome {
        let Some(follower) = &mut self.follower else { return Ok(Progress::Success) };
        Ok(follower.poll(&mut tick.context.robot)?)
    }

    fn save(&self) -> Option<Literal> {
        starts_anew()
    }
}

/// A motion among the things of `inventory`; without a table height there is no table.
fn plan_to(
    context: &SkillContext,
    inventory: &SceneInventory,
    q_goal: &[f64],
    speed: f64,
) -> Result<JointTrajectory, SkillFailure> {
    let robot = &context.robot;
    let n_joints = robot.chain().n_joints();
    if q_goal.len() != n_joints {
        let explanation = format!("{} joint positions were given, the arm has {n_joints} joints", q_goal.len());
        return Err(SkillFailure::new(FailureReason::LimitViolated, explanation));
    }
    let scene = ArmScene::new(robot, inventory, None, robot.synergy(), context.seed);
    scene.plan(&robot.sent().q, q_goal, speed).map_err(|why| SkillFailure::new(FailureReason::NoPath, why))
}

/// Registers `move_joints`.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [
        PortSpec::setting::<Vec<f64>>("q_rad").doc("Joint positions of the acting arm, radians."),
        PortSpec::setting::<f64>("speed").default_value(0.5).range(0.01, 1.0).doc("Share of the speed limits."),
    ];
    registry
        .action("move_joints", ports, MoveJoints::default)
        .fails_with([FailureReason::NoPath, FailureReason::LimitViolated, FailureReason::TrackingLost].map(FailureReason::name))
        .doc("Moves the acting arm to a configuration.")
        .occupies(["arm"])
        .takes_secs(4.0);
}
